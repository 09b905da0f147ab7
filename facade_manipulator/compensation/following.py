"""Monitor of the head: whether the head follows its path, and with what lag."""

from __future__ import annotations

import math

from facade_manipulator.errors import InputError, require_recent
from facade_manipulator.kinematics import difference, MotionState, Pose, Twist
from facade_manipulator.motion.timed_buffer import KEPT_TIME, TimedBuffer
from facade_manipulator.rejections import Rejections

OFF_PATH_TIME = 0.5  # s of not following, after which the path begins again at the head


class Following:
    """Monitor that compares the measured head pose with the pose published for the same time."""

    LARGEST_ERROR = 0.02  # m, of a head that follows
    LARGEST_YAW_ERROR = 0.035  # rad, of a head that follows
    ARM = 0.35  # m, weight of yaw against displacement
    # m/s for one second; with less motion, noise hides part of the lag
    LEAST_SPEED = 0.02
    # s, time constant with which the lag is measured: drives change it slowly
    LAG_MEMORY = 10.0
    # s, maximum lead of a stamp, so that a pose stamped before the clock was set back does not
    # exclude later poses
    LARGEST_LEAD = 0.1
    GREATEST_LAG = 0.05  # s, maximum compensated lag; a larger lag is a fault

    def __init__(self) -> None:
        self._path: TimedBuffer[Pose, MotionState] = TimedBuffer(_motion)
        self.rejections = Rejections()  #: of the measured poses
        # newest stamp [s] and measured pose
        self._head: tuple[float, Pose] | None = None
        # stamp at which the head last followed the path [s]
        self._followed_at = -math.inf
        #: of the head behind its path [s], 0 while it is unknown, negative for a head that leads
        self.lag = 0.0
        # sums of the regression of the error on the velocity, over time [m², m²/s]
        self._error_by_velocity = 0.0
        self._velocity_square = 0.0

    def begin(self, now: float) -> None:
        """Discard the old path before a new path begins."""
        self._path.clear()
        self._followed_at = now

    def publish(self, time: float, pose: Pose) -> None:
        """Store the pose published for a time [s]; discard poses for this time or later."""
        self._path.append(time, pose)

    def add_head(self, now: float, stamp: float, head: Pose) -> None:
        """
        Compare the head pose measured at a stamp with the published path.

        Present time and stamp are in seconds on the monotonic clock. Without a path, the head
        counts as following its path. Raises an InputError if the pose is stale, from the future
        or not newer than the previous pose. A pose that is more than `KEPT_TIME` older than the
        previous pose is accepted, because the clock was set back.
        """
        require_recent(
            'end_effector_pose', now - stamp, OFF_PATH_TIME, self.LARGEST_LEAD
        )
        if self._head is not None and 0.0 <= self._head[0] - stamp <= KEPT_TIME:
            raise InputError.out_of_order('end_effector_pose', self._head[0] - stamp)
        interval = 0.0 if self._head is None else max(stamp - self._head[0], 0.0)
        self._head = stamp, head
        self.rejections.clear()
        planned = self._path.interpolated(stamp)
        if planned is None:
            self._followed_at = stamp
            return
        error = difference(planned.position, head)
        if math.hypot(error.x, error.y) < self.LARGEST_ERROR and (
            abs(error.theta) < self.LARGEST_YAW_ERROR
        ):
            self._followed_at = stamp
            self._measure_lag(interval, error, planned.velocity)

    def newest(self, now: float) -> tuple[float, Pose] | None:
        """Return stamp [s] and pose of the last measured head pose; None if the pose is stale."""
        if self._head is None or now - self._head[0] >= OFF_PATH_TIME:
            return None
        return self._head

    def is_off_path(self, now: float) -> bool:
        """Return whether the head pose is known, but has been off the path for 0.5 s."""
        newest = self.newest(now)
        return newest is not None and newest[0] - self._followed_at > OFF_PATH_TIME

    def _measure_lag(self, interval: float, error: Pose, velocity: Twist) -> None:
        """
        Update the lag [s] by recursive regression of the error on the velocity.

        The lag is ∫ e·v dt / ∫ v·v dt, where older parts of both integrals decay with `LAG_MEMORY`
        and yaw is weighted by `ARM`². The sums continue over a new path.

        Parameters
        ----------
        interval : float
            Time since the previous pose of the head [s].
        error : Pose
            Pose on the path minus pose of the head [m, m, rad].
        velocity : Twist
            Velocity on the path [m/s, m/s, rad/s].

        """
        interval = min(interval, 1.0)
        kept = math.exp(-interval / self.LAG_MEMORY)
        yaw_weight = self.ARM * self.ARM * velocity.theta
        product = error.x * velocity.x + error.y * velocity.y + error.theta * yaw_weight
        square = velocity.x**2 + velocity.y**2 + velocity.theta * yaw_weight
        self._error_by_velocity = kept * self._error_by_velocity + interval * product
        self._velocity_square = kept * self._velocity_square + interval * square

        # with little motion the lag shrinks, so that it begins without a jump
        lag = self._error_by_velocity / max(self._velocity_square, self.LEAST_SPEED**2)
        self.lag = min(max(lag, -self.GREATEST_LAG), self.GREATEST_LAG)


def _motion(
    before: tuple[float, Pose], after: tuple[float, Pose], stamp: float
) -> MotionState:
    """Return the motion at a stamp [s], linearly interpolated between two items (time, pose)."""
    begin, first = before
    end, second = after
    duration = end - begin
    share = (stamp - begin) / duration
    change = difference(second, first)
    position = Pose(
        first.x + share * change.x,
        first.y + share * change.y,
        first.theta + share * change.theta,
    )
    velocity = Twist(change.x / duration, change.y / duration, change.theta / duration)
    return MotionState(position, velocity)
