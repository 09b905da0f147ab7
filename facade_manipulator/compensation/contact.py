"""What is measured at the wall: forces to give way to, and slip to bring back."""

from __future__ import annotations

import math

from facade_manipulator.compensation.force_watch import OLDEST_WRENCH
from facade_manipulator.compensation.impedance import ImpedanceSettings, YawImpedanceSettings
from facade_manipulator.compensation.pressing import Pressing, Surroundings
from facade_manipulator.errors import InputError, require_recent
from facade_manipulator.kinematics import add, Pose, Wrench
from facade_manipulator.motion.timed_buffer import KEPT_TIME
from facade_manipulator.parameters import parameter, settings

FUTURE_TOLERANCE = 0.02  # s
PROPORTIONAL = 0.3  # gain: low, because the measurement is late
FILTER_TIME = 0.1  # s, time constant of the filter on the measurement, for the proportional part
SHIFT_SPEED = 0.05  # m/s, highest of the shift
OLDEST_OFFSET = 0.3  # s, from which a measurement is not used; the shift is held


@settings
class LateralSettings:
    """Gains and limits of the lateral regulator."""

    enabled: bool = parameter('Whether lateral_offset is regulated', default=False, live=True)
    integral: float = parameter(
        'Integral gain', default=1.5, unit='1/s', minimum=0.0, maximum=20.0)
    range: float = parameter(
        'Furthest shift along the wall', default=0.1, unit='m', minimum=1e-3, maximum=1.0)


class LateralRegulator:
    """
    PI on the measured lateral offset, without wind-up: it brings back what the head slips.

    It works on top of the prediction and corrects what that cannot know: an estimator's drift, a
    wrong nominal position. The measurement is late, so the regulator is mostly integral.

    References
    ----------
    Park et al., conclusion: the lateral disturbance compensated by a conventional regulator.

    """

    def __init__(self, settings: LateralSettings) -> None:
        self.settings = settings
        self.shift = 0.0  #: present shift of the goal along the wall [m]
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

        By the present time and that since the last step [s], and by how much x is held back at the
        workspace limit: the shift goes no further there.
        """
        settings = self.settings
        fresh = settings.enabled and now - self._measured_at <= OLDEST_OFFSET
        measured = self._measured if fresh else 0.0
        share = 1.0 - math.exp(-interval / FILTER_TIME)
        self._filtered += share * (measured - self._filtered)
        integral = self._integral + settings.integral * interval * measured
        wanted = integral + PROPORTIONAL * self._filtered
        step = SHIFT_SPEED * interval
        shift = min(max(wanted, self.shift - step), self.shift + step)
        shift = min(max(shift, -settings.range), settings.range)
        blocked = saturation_error * (shift - self.shift) > 0.0
        self.shift = self.shift if blocked else shift
        if not blocked and abs(wanted - shift) < step:
            self._integral = integral


class Contact:
    """Shift the goal on the wall by what is measured there."""

    def __init__(
        self, lateral: LateralSettings, impedance: ImpedanceSettings,
        yaw_impedance: YawImpedanceSettings,
    ) -> None:
        self.lateral = LateralRegulator(lateral)
        self.pressing = Pressing(impedance, yaw_impedance)
        self.yaw = 0.0  #: of the head on the wall [rad], by which forces are turned
        self._stamps: dict[str, float] = {}
        self._wrench: Wrench | None = None
        self.look_whether_idle()

    def look_whether_idle(self) -> None:
        """Find `is_idle` again: settings have been changed."""
        #: whether `shift` would change nothing: switched off, and nothing is left of before
        self.is_idle = self.lateral.idle and self.pressing.idle

    def add_wrench(self, now: float, stamp: float, wrench: Wrench) -> None:
        """
        Learn from a wrench of the wall on the head, in its frame, measured at a stamp [s].

        Raises an InputError if it is not finite, stale, from the future or out of order.
        """
        self._check('contact_wrench', now, stamp, OLDEST_WRENCH, wrench._asdict())
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        force = -(sine * wrench.fx + cosine * wrench.fy)
        self.pressing.add_measurement(stamp, force, -wrench.mz, self._wrench in (None, wrench))
        self._wrench = wrench

    def add_lateral_offset(self, now: float, stamp: float, offset: float) -> None:
        """
        Note where the head should be, from it along the wall [m], at a stamp [s].

        Raises an InputError if it is not finite, stale, from the future or out of order.
        """
        self._check('lateral_offset', now, stamp, OLDEST_OFFSET, {'x': offset})
        self.lateral.add_measurement(stamp, offset)

    @property
    def present(self) -> Pose:
        """Shift of the goal at present [m, m, rad]."""
        return Pose(self.lateral.shift, self.pressing.y.offset, self.pressing.theta.offset)

    def shift(
        self, now: float, time: float, interval: float, reference: Pose, around: Surroundings
    ) -> Pose:
        """
        Return the reference with what the contact adds.

        At present, for the time the reference is for, an interval after the last one [s].
        """
        self.lateral.step(now, interval, around.saturation_error.x)
        self.pressing.step(now, time, interval, around)
        self.look_whether_idle()
        shifted = add(reference, self.present)
        self.yaw = shifted.theta
        return shifted

    def _check(
        self, what: str, now: float, stamp: float, longest_age: float,
        values: dict[str, float],
    ) -> None:
        for name, value in values.items():
            if not math.isfinite(value):
                raise InputError.not_finite(f'{what} {name}', value)
        require_recent(what, now - stamp, longest_age, FUTURE_TOLERANCE)
        lateness = self._stamps.get(what, -math.inf) - stamp
        if 0.0 <= lateness <= KEPT_TIME:
            raise InputError.out_of_order(what, lateness)
        self._stamps[what] = stamp
