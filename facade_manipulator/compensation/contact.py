"""
Contact with the wall: shifts the goal according to measured wrench and lateral slip.

`contact_phases.py` presses on the wall. This module regulates the lateral slip.
"""

from __future__ import annotations

from collections.abc import Iterable
import math

from facade_manipulator.compensation.contact_force import OLDEST_WRENCH, towards
from facade_manipulator.compensation.contact_phases import (
    CONTACT_CLOCK_TOLERANCE,
    ContactSettings,
    Pressing,
    Surroundings,
)
from facade_manipulator.errors import compared_magnitudes, InputError, require_recent
from facade_manipulator.kinematics import add, Pose, Wrench
from facade_manipulator.motion.timed_buffer import KEPT_TIME
from facade_manipulator.parameters import parameter, settings

OLDEST_OFFSET = 0.3  # s; an older lateral offset is not used

# Name, unit and largest value of each measured quantity. The limit of the force is five times the
# largest force on the wall, which is twice the maximum of contact.force (1000 N).
WRENCH_LIMITS = (('fx', 'N', 1e4), ('fy', 'N', 1e4), ('mz', 'N m', 1e4))
# m; the shift is at most 0.1 m, and a larger offset is probably in millimetres
OFFSET_LIMITS = (('x', 'm', 2.0),)


@settings
class LateralSettings:
    """Settings of the lateral regulator."""

    enabled: bool = parameter(
        'Whether lateral_offset is regulated to 0', default=False, live=True
    )


class LateralRegulator:
    """
    Integral controller of the lateral offset, without wind-up.

    The controller corrects errors that the prediction cannot contain: slip of the head, drift of
    the estimator.

    References
    ----------
    Park et al., conclusion: the lateral disturbance compensated by a conventional regulator.

    """

    LATERAL_GAIN = 1.5  # 1/s, integral gain: the measurement is late
    LATERAL_SPEED = 0.05  # m/s, maximum speed of the shift
    LATERAL_RANGE = 0.1  # m, maximum of the shift

    def __init__(self) -> None:
        self.shift = 0.0  #: of the goal along the wall [m]
        self._stamp = -math.inf  # of the last measurement [s]
        self._measured = 0.0  # missing motion of the head along the wall [m]

    def add_measurement(self, stamp: float, offset: float) -> None:
        """Record how far the head lags behind its goal along the wall [m] at a stamp [s]."""
        self._stamp = stamp
        self._measured = offset

    def step(self, now: float, interval: float, saturation_error: float) -> None:
        """Move the shift over an interval [s]; beyond the workspace limit [m] only back inside."""
        if not -CONTACT_CLOCK_TOLERANCE <= now - self._stamp <= OLDEST_OFFSET:
            return
        limit = self.LATERAL_SPEED * interval
        step = min(max(self.LATERAL_GAIN * interval * self._measured, -limit), limit)
        if saturation_error * step <= 0.0:
            self.shift = min(
                max(self.shift + step, -self.LATERAL_RANGE), self.LATERAL_RANGE
            )

    def release(self, interval: float) -> None:
        """Return the shift to 0 over an interval [s], while the regulator is disabled."""
        self.shift = towards(self.shift, 0.0, self.LATERAL_SPEED * interval)


class Contact:
    """Contact with the wall: checks its measurements and shifts the goal in each cycle."""

    def __init__(self, press: ContactSettings, lateral: LateralSettings) -> None:
        self.pressing = Pressing(press)
        self.lateral = lateral
        self.regulator = LateralRegulator()
        #: yaw of the head on the wall [rad], which turns measured forces
        self.yaw = 0.0
        self._stamps: dict[str, float] = {}
        self._wrench: Wrench | None = None

    @property
    def present(self) -> Pose:
        """Return the current shift of the goal [m, m, rad]."""
        pressing = self.pressing
        return Pose(self.regulator.shift, pressing.normal.shift, pressing.theta.offset)

    @property
    def lasting_shift(self) -> Pose:
        """Return the shift of the goal, without a lateral shift that returns to 0 [m, m, rad]."""
        return self.present if self.lateral.enabled else self.present._replace(x=0.0)

    @property
    def release_time(self) -> float:
        """Return the time until a disabled lateral shift has returned to 0 [s]."""
        if self.lateral.enabled:
            return 0.0
        return abs(self.regulator.shift) / self.regulator.LATERAL_SPEED

    def add_wrench(self, now: float, stamp: float, wrench: Wrench) -> None:
        """
        Record the wrench of the wall on the head, in the head's frame, measured at a stamp [s].

        Raises an InputError if the wrench is not finite, beyond `WRENCH_LIMITS`, stale, from the
        future or out of order.
        """
        _require_possible('contact_wrench', wrench, WRENCH_LIMITS)
        self._require_in_time('contact_wrench', now, stamp, OLDEST_WRENCH)
        force = -(math.sin(self.yaw) * wrench.fx + math.cos(self.yaw) * wrench.fy)
        self.pressing.add_measurement(stamp, force, -wrench.mz, wrench == self._wrench)
        self._wrench = wrench

    def add_lateral_offset(self, now: float, stamp: float, offset: float) -> None:
        """
        Record the measured lateral offset: missing motion of the head along the wall [m].

        Raises an InputError if the offset is not finite, beyond `OFFSET_LIMITS`, stale, from the
        future or out of order.
        """
        _require_possible('lateral_offset', (offset,), OFFSET_LIMITS)
        self._require_in_time('lateral_offset', now, stamp, OLDEST_OFFSET)
        self.regulator.add_measurement(stamp, offset)

    def shift(
        self,
        now: float,
        time: float,
        interval: float,
        reference: Pose,
        around: Surroundings,
    ) -> Pose:
        """
        Return the reference pose shifted by the contact [m, m, rad].

        `time` is when the head reaches the reference [s], and `interval` the time since the
        previous call [s].
        """
        if self.lateral.enabled:
            self.regulator.step(now, interval, around.saturation_error.x)
        else:
            self.regulator.release(interval)
        self.pressing.step(now, time, interval, around)
        shifted = add(reference, self.present)
        self.yaw = shifted.theta
        return shifted

    def _require_in_time(
        self, quantity: str, now: float, stamp: float, oldest: float
    ) -> None:
        """
        Require increasing stamps that are at most `oldest` old [s].

        A stamp that is earlier by more than `KEPT_TIME` means that the clock was set back.
        """
        require_recent(quantity, now - stamp, oldest, CONTACT_CLOCK_TOLERANCE)
        lateness = self._stamps.get(quantity, -math.inf) - stamp
        if 0.0 <= lateness <= KEPT_TIME:
            raise InputError.out_of_order(quantity, lateness)
        self._stamps[quantity] = stamp


def _require_possible(
    quantity: str,
    values: Iterable[float],
    limits: Iterable[tuple[str, str, float]],
) -> None:
    """Require finite values within their limits, each with name, unit and largest value."""
    for value, (name, unit, largest) in zip(values, limits, strict=True):
        if not math.isfinite(value):
            raise InputError.not_finite(f'{quantity} {name}', value)
        if abs(value) > largest:
            value_text, limit = compared_magnitudes(value, largest, '.4g')
            raise InputError(
                'range',
                f'{quantity} {name} = {value_text} {unit} is beyond the limit '
                f'±{limit} {unit}',
            )
