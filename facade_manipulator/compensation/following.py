"""How the head follows the published course: whether at all, and with which lag."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
import math
from operator import itemgetter

from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import difference, Pose
from facade_manipulator.parameters import parameter, settings

KEPT_TIME = 2.0
ARM = 0.35  # m, weighs yaw against displacement
LEAST_SPEED = 0.02


@settings
class FollowingSettings:
    """When the head counts as not following, and how its lag is measured."""

    distance: float = parameter(
        0.02, 'Distance of the head from the course from which it is not following', unit='m',
        minimum=1e-3, maximum=1.0)
    yaw: float = parameter(
        0.035, 'Yaw of the head from the course from which it is not following', unit='rad',
        minimum=1e-3, maximum=1.0)
    patience: float = parameter(
        0.5, 'Time of not following after which the course begins again at the head', unit='s',
        minimum=0.05, maximum=10.0)
    lag_memory: float = parameter(
        10.0, "Time constant with which the head's lag is measured", unit='s', minimum=0.5,
        maximum=600.0)
    greatest_lag: float = parameter(
        0.05, 'Greatest lag of the head that is made up for; 0 for none', unit='s', minimum=0.0,
        maximum=0.2)


class Following:
    """
    Compare where the head is with what was published for that instant.

    Parameters
    ----------
    settings : FollowingSettings

    """

    def __init__(self, settings: FollowingSettings) -> None:
        self.settings = settings
        self._course: deque[tuple[float, Pose]] = deque()
        self._head: tuple[float, Pose] | None = None
        self._followed_at = -math.inf
        self._delay = self._power = 0.0

    def begin(self, now: float) -> None:
        """Forget the course; a new one begins."""
        self._course.clear()
        self._followed_at = now

    def publish(self, time: float, pose: Pose) -> None:
        """Note what is published for a time [s], in place of what was for it and later."""
        while self._course and self._course[-1][0] >= time:
            self._course.pop()
        self._course.append((time, pose))
        while self._course[0][0] < time - KEPT_TIME:
            self._course.popleft()

    def take(self, stamp: float, head: Pose) -> None:
        """
        Take where the head is at a stamp [s].

        Raises
        ------
        InputError
            If it is older than the one before; much older, the clock was set back.

        """
        if self._head is not None and 0.0 <= self._head[0] - stamp <= KEPT_TIME:
            raise InputError.out_of_order('end_effector_pose', self._head[0] - stamp)
        interval = 0.0 if self._head is None else max(stamp - self._head[0], 0.0)
        self._head = stamp, head
        planned = self._planned(stamp)
        if planned is None:
            self._followed_at = stamp
            return
        error = difference(planned[0], head)
        if math.hypot(error.x, error.y) < self.settings.distance and (
                abs(error.theta) < self.settings.yaw):
            self._followed_at = stamp
            self._measure_lag(interval, error, planned[1])

    def head(self, now: float) -> Pose | None:
        """Return where the head is, None if that is not known any more."""
        if self._head is None or now - self._head[0] >= self.settings.patience:
            return None
        return self._head[1]

    def lost(self, now: float) -> bool:
        """Tell whether the head is seen but does not follow."""
        return self.head(now) is not None and (
            self._head[0] - self._followed_at > self.settings.patience)

    @property
    def lag(self) -> float:
        """Lag of the head behind the course [s], 0 while it is not known."""
        if self._power < LEAST_SPEED ** 2 * min(self.settings.lag_memory, 1.0):
            return 0.0
        limit = self.settings.greatest_lag
        return min(max(self._delay / self._power, -limit), limit)

    def _planned(self, stamp: float) -> tuple[Pose, Pose] | None:
        """Return place and velocity of the course at a stamp, None where there was none."""
        course = self._course
        index = bisect_right(course, stamp, key=itemgetter(0))
        if not 0 < index < len(course):
            return None
        return _between(*course[index - 1], *course[index], stamp)

    def _measure_lag(self, interval: float, error: Pose, velocity: Pose) -> None:
        """Regress the error on the velocity, the older the less."""
        interval = min(interval, 1.0)
        fade = math.exp(-interval / self.settings.lag_memory)
        turn = ARM * ARM * velocity.theta
        self._delay = fade * self._delay + interval * (
            error.x * velocity.x + error.y * velocity.y + error.theta * turn)
        self._power = fade * self._power + interval * (
            velocity.x ** 2 + velocity.y ** 2 + velocity.theta * turn)


def _between(
    begin: float, first: Pose, end: float, second: Pose, stamp: float
) -> tuple[Pose, Pose]:
    share, change = (stamp - begin) / (end - begin), difference(second, first)
    place = Pose(*(a + share * d for a, d in zip(first, change, strict=True)))
    return place, Pose(*(d / (end - begin) for d in change))
