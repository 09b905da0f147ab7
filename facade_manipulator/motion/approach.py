"""The path to a single goal: poses on a jerk-limited straight path until the head is there."""

from __future__ import annotations

from facade_manipulator.kinematics import Pose
from facade_manipulator.motion.reference import HeadMotion, ReferencePath, ReferenceSettings


class Approach:
    """
    Lead the head to a goal that comes alone, as a supervisor without a compensator sends it.

    Parameters
    ----------
    settings : ReferenceSettings

    """

    def __init__(self, settings: ReferenceSettings) -> None:
        self._reference = ReferencePath(settings)
        self._is_under_way = False

    def change_settings(self, settings: ReferenceSettings) -> None:
        """Lead within other limits from the next goal on."""
        self._reference.settings = settings

    def begin(self, time: float, head: Pose, goal: Pose) -> None:
        """Lead from where the head rests, or from where it is being led, to the goal."""
        if self._is_under_way:
            self._reference.retarget(time, goal)
        else:
            self._reference.initialise(time, HeadMotion(head), goal)
        self._is_under_way = True

    def end(self) -> None:
        """Lead no longer."""
        self._is_under_way = False

    def pose(self, time: float) -> Pose | None:
        """Return where the head should be at a time [s]; None when it is not being led."""
        if not self._is_under_way:
            return None
        self._is_under_way = time < self._reference.arrival()
        return self._reference.at(time).position
