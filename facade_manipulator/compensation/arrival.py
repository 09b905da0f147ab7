"""When a goal is reached: the head as measured, on the wall, near it for a while."""

from __future__ import annotations

from enum import Enum
import math
from typing import NamedTuple

from facade_manipulator.kinematics import Pose
from facade_manipulator.parameters import parameter, settings

LEAVING = 2.0  # times the tolerance: a goal once reached is left beyond it


@settings
class ArrivalSettings:
    """How near the head must be to its goal, and for how long."""

    distance: float = parameter(
        0.005, 'Distance on the wall within which a goal is reached', unit='m', minimum=1e-4,
        maximum=0.1)
    angle: float = parameter(
        0.01, 'Angle within which a goal is reached', unit='rad', minimum=1e-4, maximum=0.5)
    dwell: float = parameter(
        0.2, 'How long the head must be so near', unit='s', minimum=0.0, maximum=10.0)


class GoalState(Enum):
    """How far a goal has got."""

    ACCEPTED = 'accepted'
    MOVING = 'moving'
    HELD_BACK = 'held back'
    REACHED = 'reached'
    REJECTED = 'rejected'


class GoalProgress(NamedTuple):
    """
    Where the head is on the way to its goal.

    Attributes
    ----------
    state : GoalState
    distance, angle : float
        Of the head as measured from the goal [m, rad]; NaN where the head is not known.
    time_to_go : float
        Until the path ends and the dwell is over [s].

    """

    state: GoalState
    distance: float = math.nan
    angle: float = math.nan
    time_to_go: float = math.nan


class ArrivalWatch:
    """Decides whether a goal is reached."""

    def __init__(self, settings: ArrivalSettings) -> None:
        self.settings = settings
        self._near_since: float | None = None
        self._is_reached = False

    def begin(self) -> None:
        """Watch another goal from now on."""
        self._near_since, self._is_reached = None, False

    def update(
        self, now: float, error: Pose | None, path_time: float, is_held_back: bool
    ) -> GoalProgress:
        """
        Return the progress at a time [s].

        Parameters
        ----------
        now : float
        error : Pose or None
            Goal less the head on the wall, both measured; None where that is not known.
        path_time : float
            How long the path to the goal still takes [s].
        is_held_back : bool
            Whether a limit keeps the head from its path.

        """
        distance = angle = math.nan
        if error is not None:
            distance, angle = math.hypot(error.x, error.y), abs(error.theta)
        near = path_time <= 0.0 and self._is_near(distance, angle)
        if not near:
            self._near_since = None
        elif self._near_since is None:
            self._near_since = now
        self._is_reached = near and (
            self._is_reached or now - self._near_since >= self.settings.dwell)
        if self._is_reached:
            return GoalProgress(GoalState.REACHED, distance, angle, 0.0)
        state = GoalState.HELD_BACK if is_held_back else GoalState.MOVING
        dwelt = now - self._near_since if near else 0.0
        return GoalProgress(
            state, distance, angle, max(path_time, 0.0) + self.settings.dwell - dwelt)

    def _is_near(self, distance: float, angle: float) -> bool:
        factor = LEAVING if self._is_reached else 1.0
        settings = self.settings
        return distance <= factor * settings.distance and angle <= factor * settings.angle
