"""Following of the head: whether it follows its path, is held back, and has reached its goal."""

from __future__ import annotations

from enum import Enum
import math
from typing import NamedTuple

from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import difference, MotionState, Pose, Twist
from facade_manipulator.motion.timed_buffer import KEPT_TIME, TimedBuffer
from facade_manipulator.parameters import parameter, settings

LARGEST_ERROR, LARGEST_YAW_ERROR = (
    0.02,
    0.035,
)  # m, rad: maximum error of a following head
PATIENCE = 0.5  # s of not following, after which the path begins again at the head
ARM = 0.35  # m, weight of yaw against displacement
LEAST_SPEED = 0.02  # m/s for one second; with less motion, noise hides part of the lag
LAG_MEMORY = (
    10.0  # s, time constant with which the lag is measured: drives change it slowly
)
GREATEST_LAG = 0.05  # s, maximum that is compensated: a larger one is a fault
HOLDS = ('at the workspace limit', 'by an uncertain estimate')
LEAST_ERROR = 1e-4  # m or rad, minimum error of an axis that counts as held back
SHOWN_FOR = 1.0  # s, so that an operator can read the message
LEAVING = 2.0  # times the tolerance: a larger error leaves a reached goal


class Following:
    """Comparison of the measured pose of the head with the pose published for that instant."""

    def __init__(self) -> None:
        self._path: TimedBuffer[Pose] = TimedBuffer()
        self._head: tuple[float, Pose] | None = None
        self._followed_at = -math.inf
        #: lag of the head on its path [s], 0 while it is unknown
        self.lag = self._delay = self._power = 0.0

    def begin(self, now: float) -> None:
        """Forget the path before a new path begins."""
        self._path.clear()
        self._followed_at = now

    def publish(self, time: float, pose: Pose) -> None:
        """Store the pose published for a time [s]; it replaces poses for that time and later."""
        self._path.append(time, pose)

    def add_head(self, stamp: float, head: Pose) -> None:
        """
        Compare the measured pose of the head at a stamp [s] with the published path.

        Raises an InputError if the pose is not newer than the previous pose, unless the clock was
        set back.
        """
        if self._head is not None and 0.0 <= self._head[0] - stamp <= KEPT_TIME:
            raise InputError.out_of_order('end_effector_pose', self._head[0] - stamp)
        interval = 0.0 if self._head is None else max(stamp - self._head[0], 0.0)
        self._head = stamp, head
        planned = _motion(self._path, stamp)
        if planned is None:
            self._followed_at = stamp
            return
        error = difference(planned.position, head)
        if math.hypot(error.x, error.y) < LARGEST_ERROR and (
            abs(error.theta) < LARGEST_YAW_ERROR
        ):
            self._followed_at = stamp
            self._measure_lag(interval, error, planned.velocity)

    def newest(self, now: float) -> tuple[float, Pose] | None:
        """Return the last stamp [s] and pose of the head, None if the pose is stale."""
        if self._head is None or now - self._head[0] >= PATIENCE:
            return None
        return self._head

    def is_off_path(self, now: float) -> bool:
        """Return whether the head's pose is known, but has not followed the path for 0.5 s."""
        newest = self.newest(now)
        return newest is not None and newest[0] - self._followed_at > PATIENCE

    def _measure_lag(self, interval: float, error: Pose, velocity: Twist) -> None:
        """Update the lag [s] by regression of the error on the velocity, with forgetting."""
        interval = min(interval, 1.0)
        fade = math.exp(-interval / LAG_MEMORY)
        turn = ARM * ARM * velocity.theta
        self._delay = fade * self._delay + interval * (
            error.x * velocity.x + error.y * velocity.y + error.theta * turn
        )
        self._power = fade * self._power + interval * (
            velocity.x**2 + velocity.y**2 + velocity.theta * turn
        )
        # with little motion the lag shrinks, so that it begins without a jump
        lag = self._delay / max(self._power, LEAST_SPEED**2)
        self.lag = min(max(lag, -GREATEST_LAG), GREATEST_LAG)


def _motion(poses: TimedBuffer[Pose], stamp: float) -> MotionState | None:
    """Return the motion through poses at a stamp [s], None without poses around the stamp."""
    before, after = poses.around(stamp)
    if before is None or after is None:
        return None
    (begin, first), (end, second) = before, after
    share, change = (stamp - begin) / (end - begin), difference(second, first)
    return MotionState(
        Pose(*(a + share * d for a, d in zip(first, change, strict=True))),
        Twist(*(d / (end - begin) for d in change)),
    )


class HeldBack:
    """Limits that hold axes of the head back, or held them back within the last second."""

    def __init__(self) -> None:
        self._noted: dict[tuple[str, str], float] = {}

    def note(self, now: float, *errors: Pose) -> None:
        """Record the axes that are held back, by their errors for each of `HOLDS`."""
        for limit, error in zip(HOLDS, errors, strict=True):
            for axis, amount in zip(Pose._fields, error, strict=True):
                if abs(amount) > LEAST_ERROR:
                    self._noted[limit, axis] = now

    def message(self, now: float) -> str:
        """Return the held axes and their limits as a message, empty if no axis is held."""
        self._noted = {
            held: then
            for held, then in self._noted.items()
            if 0.0 <= now - then < SHOWN_FOR
        }  # a future stamp: the clock was set back
        axes = {
            limit: [axis for axis in Pose._fields if (limit, axis) in self._noted]
            for limit in HOLDS
        }
        return '; '.join(
            f'held back in {", ".join(held)} {limit}'
            for limit, held in axes.items()
            if held
        )


@settings
class ArrivalSettings:
    """Settings of arrival: required distance of the head from its goal, and required duration."""

    distance: float = parameter(
        'Distance on the wall within which a goal is reached',
        default=0.005,
        unit='m',
        minimum=1e-4,
        maximum=0.1,
        live=True,
    )
    angle: float = parameter(
        'Angle within which a goal is reached',
        default=0.01,
        unit='rad',
        minimum=1e-4,
        maximum=0.5,
        live=True,
    )
    dwell: float = parameter(
        'Dwell time within both tolerances',
        default=0.2,
        unit='s',
        minimum=0.0,
        maximum=10.0,
        live=True,
    )


class GoalState(Enum):
    """State of a goal."""

    NONE = 'none'  #: no goal was received
    ACCEPTED = 'accepted'
    MOVING = 'moving'
    HELD_BACK = 'held back'
    REACHED = 'reached'
    REJECTED = 'rejected'  #: never followed; the previous goal stays in force
    ENDED = 'ended'  #: no longer followed
    SUPERSEDED = 'superseded'  #: by a newer goal


class GoalProgress(NamedTuple):
    """Progress of the measured head towards its goal; NaN where it is unknown."""

    state: GoalState
    distance: float = math.nan  #: from the goal [m]
    angle: float = math.nan  #: from the goal [rad]
    time_to_go: float = math.nan  #: until the path ends and the dwell is over [s]


class ArrivalWatch:
    """Watch that determines whether a goal is reached."""

    def __init__(self, settings: ArrivalSettings) -> None:
        self.settings = settings
        self.begin()

    def begin(self) -> None:
        """Forget the previous goal and watch another."""
        self._near_since, self._is_reached = math.inf, False

    def update(
        self,
        now: float,
        error: Pose | None,
        path_time: float,
        is_held_back: bool,
        is_pressed: bool = True,
    ) -> GoalProgress:
        """
        Return the progress at a time [s].

        The error is the goal minus the measured head on the wall, None if it is unknown. The
        path time is the remaining time of the path [s]. The head is held back if a limit keeps
        it from its path, or the contact keeps it from the wall. It is pressed if a requested
        force is held, or no force is requested.
        """
        distance = angle = math.nan
        if error is not None:
            distance, angle = math.hypot(error.x, error.y), abs(error.theta)
        near = is_pressed and path_time <= 0.0 and self._is_near(distance, angle)
        self._near_since = min(self._near_since, now) if near else math.inf
        dwelt = max(now - self._near_since, 0.0)
        self._is_reached = near and (self._is_reached or dwelt >= self.settings.dwell)
        if self._is_reached:
            return GoalProgress(GoalState.REACHED, distance, angle, 0.0)
        state = GoalState.HELD_BACK if is_held_back else GoalState.MOVING
        return GoalProgress(
            state, distance, angle, max(path_time, 0.0) + self.settings.dwell - dwelt
        )

    def _is_near(self, distance: float, angle: float) -> bool:
        factor = LEAVING if self._is_reached else 1.0
        settings = self.settings
        return (
            distance <= factor * settings.distance and angle <= factor * settings.angle
        )
