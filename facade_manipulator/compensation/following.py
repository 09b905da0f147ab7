"""How the head follows the published path: whether at all, and with which lag."""

from __future__ import annotations

import math

from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import difference, MotionState, Pose, Twist
from facade_manipulator.motion import TimedBuffer

CLOCK_STEP = 2.0  # s, a pose older than that means that the clock was set back
LARGEST_ERROR, LARGEST_YAW_ERROR = 0.02, 0.035  # m, rad: beyond, the head is not following
PATIENCE = 0.5  # s of not following, after which the path begins again at the head
ARM = 0.35  # m, weighs yaw against displacement
LEAST_SPEED = 0.02  # m/s, below which the lag drowns in noise
LAG_MEMORY = 10.0  # s, time constant with which the lag is measured: drives change it slowly
GREATEST_LAG = 0.05  # s, that is compensated: a greater one is no lag but a fault


class Following:
    """Compare where the head is with what was published for that instant."""

    def __init__(self) -> None:
        self._path: TimedBuffer[Pose] = TimedBuffer()
        self._head: tuple[float, Pose] | None = None
        self._followed_at = -math.inf
        self._delay = self._power = 0.0

    def begin(self, now: float) -> None:
        """Forget the path; a new one begins."""
        self._path.clear()
        self._followed_at = now

    def publish(self, time: float, pose: Pose) -> None:
        """Note what is published for a time [s], in place of what was for it and later."""
        self._path.append(time, pose)

    def add_head(self, stamp: float, head: Pose) -> None:
        """
        Compare where the head is at a stamp [s] with where it should be.

        Raises
        ------
        InputError
            If it is older than the one before; much older, the clock was set back.

        """
        if self._head is not None and 0.0 <= self._head[0] - stamp <= CLOCK_STEP:
            raise InputError.out_of_order('end_effector_pose', self._head[0] - stamp)
        interval = 0.0 if self._head is None else max(stamp - self._head[0], 0.0)
        self._head = stamp, head
        planned = self._planned(stamp)
        if planned is None:
            self._followed_at = stamp
            return
        error = difference(planned.position, head)
        if math.hypot(error.x, error.y) < LARGEST_ERROR and (
                abs(error.theta) < LARGEST_YAW_ERROR):
            self._followed_at = stamp
            self._measure_lag(interval, error, planned.velocity)

    def newest(self, now: float) -> tuple[float, Pose] | None:
        """Return when [s] and where the head was last, None if that is not known any more."""
        if self._head is None or now - self._head[0] >= PATIENCE:
            return None
        return self._head

    def head(self, now: float) -> Pose | None:
        """Return where the head is, None if that is not known any more."""
        newest = self.newest(now)
        return newest and newest[1]

    def is_off_path(self, now: float) -> bool:
        """Return whether the head's pose is known but does not follow."""
        return self.head(now) is not None and (
            self._head[0] - self._followed_at > PATIENCE)

    @property
    def lag(self) -> float:
        """Lag of the head on its path [s], 0 while it is not known."""
        if self._power < LEAST_SPEED ** 2:
            return 0.0
        return min(max(self._delay / self._power, -GREATEST_LAG), GREATEST_LAG)

    def _planned(self, stamp: float) -> MotionState | None:
        """Return the motion on the path at a stamp, None where there was none."""
        before, after = self._path.around(stamp)
        if before is None or after is None:
            return None
        (begin, first), (end, second) = before, after
        share, change = (stamp - begin) / (end - begin), difference(second, first)
        return MotionState(
            Pose(*(a + share * d for a, d in zip(first, change, strict=True))),
            Twist(*(d / (end - begin) for d in change)))

    def _measure_lag(self, interval: float, error: Pose, velocity: Twist) -> None:
        """Regress the error on the velocity, the older the less."""
        interval = min(interval, 1.0)
        fade = math.exp(-interval / LAG_MEMORY)
        turn = ARM * ARM * velocity.theta
        self._delay = fade * self._delay + interval * (
            error.x * velocity.x + error.y * velocity.y + error.theta * turn)
        self._power = fade * self._power + interval * (
            velocity.x ** 2 + velocity.y ** 2 + velocity.theta * turn)

