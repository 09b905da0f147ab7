"""
The lateral regulator: it brings back what a sensor measures the head to slip along the wall.

It works on top of the prediction and corrects what that cannot know: an estimator's drift, a wrong
nominal position. The measurement is late, so the regulator is mostly integral.

References
----------
Park et al., conclusion: the lateral disturbance compensated by a conventional regulator.
"""

from __future__ import annotations

import math

from facade_manipulator.parameters import parameter, settings

PROPORTIONAL = 0.3  # gain: low, because the measurement is late
FILTER_TIME = 0.1  # s, time constant of the filter on the measurement, for the proportional part
SPEED = 0.05  # m/s, highest of the shift
OLDEST_OFFSET = 0.3  # s, from which a measurement is not used; the shift is held


@settings
class LateralSettings:
    """Gains and limits of the lateral regulator."""

    enabled: bool = parameter(False, 'Whether lateral_offset is regulated')
    integral: float = parameter(1.5, 'Integral gain', unit='1/s', minimum=0.0, maximum=20.0)
    range: float = parameter(
        0.1, 'Furthest shift along the wall', unit='m', minimum=1e-3, maximum=1.0)


class LateralRegulator:
    """
    PI on the measured lateral offset, without wind-up.

    Attributes
    ----------
    shift : float
        Present shift of the goal along the wall [m].

    """

    def __init__(self, settings: LateralSettings) -> None:
        self.settings = settings
        self.shift = 0.0
        self._integral = 0.0
        self._filtered = 0.0
        self._measured_at = -math.inf
        self._measured = 0.0

    @property
    def idle(self) -> bool:
        """Whether a step would change nothing: switched off and never on."""
        return not self.settings.enabled and self.shift == self._integral == self._filtered == 0.0

    def add_measurement(self, stamp: float, offset: float) -> None:
        """Note where the head should be, from it along the wall, at a stamp [m, s]."""
        self._measured_at, self._measured = stamp, offset

    def step(self, now: float, interval: float, saturation_error: float) -> None:
        """
        Move the shift on.

        Parameters
        ----------
        now, interval : float
            Present time and the time since the last step [s].
        saturation_error : float
            By how much x is held back at the workspace limit: the shift goes no further there.

        """
        settings = self.settings
        fresh = settings.enabled and now - self._measured_at <= OLDEST_OFFSET
        measured = self._measured if fresh else 0.0
        share = 1.0 - math.exp(-interval / FILTER_TIME)
        self._filtered += share * (measured - self._filtered)
        integral = self._integral + settings.integral * interval * measured
        wanted = integral + PROPORTIONAL * self._filtered
        step = SPEED * interval
        shift = min(max(wanted, self.shift - step), self.shift + step)
        shift = min(max(shift, -settings.range), settings.range)
        blocked = saturation_error * (shift - self.shift) > 0.0
        self.shift = self.shift if blocked else shift
        if not blocked and abs(wanted - shift) < step:
            self._integral = integral
