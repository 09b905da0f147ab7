"""
The lateral regulator: what a sensor sees the head slip along the wall is brought back.

It works on top of the prediction and takes what that cannot see: an estimator's drift, a wrong
nominal place. The measurement is late, so the regulator is mostly integral.

References
----------
Park et al., conclusion: the lateral disturbance compensated by a conventional regulator.
"""

from __future__ import annotations

import math

from facade_manipulator.parameters import parameter, settings


@settings
class LateralSettings:
    """Gains and limits of the lateral regulator."""

    enabled: bool = parameter(False, 'Whether lateral_offset is regulated')
    proportional: float = parameter(0.3, 'Proportional gain', minimum=0.0, maximum=2.0)
    integral: float = parameter(1.5, 'Integral gain', unit='1/s', minimum=0.0, maximum=20.0)
    filter_time: float = parameter(
        0.1, 'Time constant of the filter on the measurement', unit='s', minimum=1e-3,
        maximum=5.0)
    range: float = parameter(
        0.1, 'Furthest shift along the wall', unit='m', minimum=1e-3, maximum=1.0)
    speed: float = parameter(
        0.05, 'Highest speed of the shift', unit='m/s', minimum=1e-3, maximum=1.0)
    longest_age: float = parameter(
        0.3, 'Age from which a measurement is not used; the shift is held', unit='s',
        minimum=0.01, maximum=5.0)


class LateralRegulator:
    """
    PI on the measured lateral offset, without wind-up.

    Parameters
    ----------
    settings : LateralSettings

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

    def take(self, stamp: float, offset: float) -> None:
        """Take where the head should be, seen from it along the wall, at a stamp [m, s]."""
        self._measured_at, self._measured = stamp, offset

    def step(self, now: float, interval: float, excess: float) -> None:
        """
        Move the shift on.

        Parameters
        ----------
        now, interval : float
            Present time and the time since the last step [s].
        excess : float
            By how much x is held back at the border: the shift goes no further there.

        """
        settings = self.settings
        fresh = settings.enabled and now - self._measured_at <= settings.longest_age
        measured = self._measured if fresh else 0.0
        share = 1.0 - math.exp(-interval / settings.filter_time)
        self._filtered += share * (measured - self._filtered)
        integral = self._integral + settings.integral * interval * measured
        wanted = integral + settings.proportional * self._filtered
        step = settings.speed * interval
        shift = min(max(wanted, self.shift - step), self.shift + step)
        shift = min(max(shift, -settings.range), settings.range)
        blocked = excess * (shift - self.shift) > 0.0
        self.shift = self.shift if blocked else shift
        if not blocked and abs(wanted - shift) < step:
            self._integral = integral
