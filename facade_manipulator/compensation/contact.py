"""What is measured at the wall: forces to give way to, slip to bring back."""

from __future__ import annotations

import math

from facade_manipulator.compensation.force_watch import OLDEST_WRENCH
from facade_manipulator.compensation.impedance import ImpedanceSettings, YawImpedanceSettings
from facade_manipulator.compensation.lateral import (
    LateralRegulator,
    LateralSettings,
    OLDEST_OFFSET,
)
from facade_manipulator.compensation.pressing import Pressing
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import add, MotionState, Pose, Wrench

FUTURE_TOLERANCE = 0.02  # s
CLOCK_STEP = 2.0  # s, a measurement older than that means that the clock was set back


class Contact:
    """
    Shift the goal on the wall by what is measured there.

    Parameters
    ----------
    lateral : LateralSettings
        Of x.
    impedance : ImpedanceSettings
        Of y.
    yaw_impedance : YawImpedanceSettings
        Of θ.

    """

    def __init__(
        self, lateral: LateralSettings, impedance: ImpedanceSettings,
        yaw_impedance: YawImpedanceSettings,
    ) -> None:
        self.lateral = LateralRegulator(lateral)
        self.pressing = Pressing(impedance, yaw_impedance)
        self._yaw = 0.0
        self._stamps: dict[str, float] = {}
        self._wrench: Wrench | None = None

    def add_wrench(self, now: float, stamp: float, wrench: Wrench) -> None:
        """
        Learn from a wrench of the wall on the head, in its frame, measured at a stamp [s].

        Raises
        ------
        InputError
            If it is not finite, stale, from the future or out of order.

        """
        self._check('contact_wrench', now, stamp, OLDEST_WRENCH, wrench._asdict())
        cosine, sine = math.cos(self._yaw), math.sin(self._yaw)
        force = -(sine * wrench.fx + cosine * wrench.fy)
        self.pressing.add_measurement(stamp, force, -wrench.mz, wrench == self._wrench)
        self._wrench = wrench

    def add_lateral_offset(self, now: float, stamp: float, offset: float) -> None:
        """
        Note where the head should be, from it along the wall [m], at a stamp [s].

        Raises
        ------
        InputError
            If it is not finite, stale, from the future or out of order.

        """
        self._check('lateral_offset', now, stamp, OLDEST_OFFSET, {'x': offset})
        self.lateral.add_measurement(stamp, offset)

    @property
    def present(self) -> Pose:
        """Shift of the goal at present [m, m, rad]."""
        return Pose(self.lateral.shift, self.pressing.y.offset, self.pressing.theta.offset)

    def shift(
        self, now: float, time: float, interval: float, reference: Pose, saturation_error: Pose,
        rail: MotionState,
    ) -> Pose:
        """
        Return the reference with what the contact adds.

        Parameters
        ----------
        now, time, interval : float
            Present time, the time the reference is for, the time since the last one [s].
        reference : Pose
            Where the head should be on the wall.
        saturation_error : Pose
            By how much each axis was held back at the workspace limit.
        rail : MotionState
            Disturbance of the gondola.

        """
        if not (self.lateral.idle and self.pressing.idle):
            self.lateral.step(now, interval, saturation_error.x)
            self.pressing.step(now, time, interval, saturation_error, rail)
        shifted = add(reference, self.present)
        self._yaw = shifted.theta
        return shifted

    def _check(
        self, what: str, now: float, stamp: float, longest_age: float,
        values: dict[str, float],
    ) -> None:
        for name, value in values.items():
            if not math.isfinite(value):
                raise InputError.not_finite(f'{what} {name}', value)
        if now - stamp > longest_age:
            raise InputError.stale(what, now - stamp, longest_age)
        if stamp - now > FUTURE_TOLERANCE:
            raise InputError.from_future(what, stamp - now, FUTURE_TOLERANCE)
        lateness = self._stamps.get(what, -math.inf) - stamp
        if 0.0 <= lateness <= CLOCK_STEP:
            raise InputError.out_of_order(what, lateness)
        self._stamps[what] = stamp
