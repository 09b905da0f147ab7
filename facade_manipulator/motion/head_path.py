"""Reference of the head: a jerk-limited, synchronised path in (x, y, θ) to each goal."""

from __future__ import annotations

import math
from typing import NamedTuple

from ruckig import Trajectory

from facade_manipulator.kinematics import (
    MIN_CONDITIONING,
    Pose,
    subtract,
    Twist,
    wrap_angle,
    ZERO_POSE,
    ZERO_TWIST,
)
from facade_manipulator.motion.trajectory import AXIS_COUNT, plan_trajectory
from facade_manipulator.parameters import parameter, settings


@settings
class ReferenceSettings:
    """
    Limits of the head's path, on the wall and on the rail, for x, y and θ.

    Compensator and ik_service have the same group ``reference``, because a pose that only one of
    the nodes accepts would stop the head on its path.
    """

    speed: tuple[float, ...] = parameter(
        'Highest speed: x, y, theta',
        default=(0.2, 0.1, 0.4),
        unit='m/s, rad/s',
        minimum=1e-3,
        maximum=5.0,
        elements=Pose._fields,
    )
    acceleration: tuple[float, ...] = parameter(
        'Highest acceleration: x, y, theta',
        default=(0.6, 0.4, 1.5),
        unit='m/s^2, rad/s^2',
        minimum=1e-2,
        maximum=50.0,
        elements=Pose._fields,
    )
    jerk: tuple[float, ...] = parameter(
        'Highest jerk: x, y, theta',
        default=(6.0, 4.0, 15.0),
        unit='m/s^3, rad/s^3',
        minimum=0.1,
        maximum=1e4,
        elements=Pose._fields,
    )
    min_conditioning: float = parameter(
        'Minimum local conditioning index of a pose (unit of length b/0.348)',
        default=MIN_CONDITIONING,
        minimum=0.0,
        maximum=1.0,
    )


class HeadMotion(NamedTuple):
    """Position, velocity and acceleration of the head on the wall [m, m, rad; per s; per s²]."""

    position: Pose
    velocity: Twist = ZERO_TWIST
    acceleration: tuple[float, float, float] = (0.0, 0.0, 0.0)


class ReferencePath:
    """
    Path of the head on the wall to the current goal.

    The path to a new goal begins with the present motion. From rest it is straight.
    """

    # s; the path is then within 1e-18 m of its end, and a clock since 1970 resolves a quarter of
    # this time
    LAST_INSTANT = 1e-6

    def __init__(self, settings: ReferenceSettings) -> None:
        self.settings = settings
        self.goal: Pose | None = None  #: end of the path, None before the first path
        self._trajectory = Trajectory(AXIS_COUNT)
        self._start = -math.inf  # before the first path

    def initialise(self, time: float, motion: HeadMotion, goal: Pose) -> None:
        """
        Restart the path from a motion, and plan it to a goal.

        `time` is the time of the motion [s]. The path ends at rest, and θ turns by at most half a
        turn.

        Raises a ManipulatorError if there is no such path.
        """
        turn = wrap_angle(goal.theta - motion.position.theta)
        end = goal._replace(theta=motion.position.theta + turn)
        self._plan(time, motion, end)
        self.goal = goal

    def retarget(self, time: float, goal: Pose) -> None:
        """Plan a path to another goal from the motion at a time [s]; requires `initialise`."""
        self.initialise(time, self.at(time), goal)

    def stop(self, time: float) -> Pose:
        """Plan a stop that begins at a time [s]; return the final pose [m, m, rad]."""
        self._plan(time, self.at(time), None)
        self.goal = self.at(math.inf).position
        return self.goal

    def at(self, time: float) -> HeadMotion:
        """Return the motion at a time [s], which is clamped to the duration of the path."""
        elapsed = max(time - self._start, 0.0)
        duration = self._trajectory.duration
        if elapsed >= duration - self.LAST_INSTANT:
            # At rest, ruckig rounds to 1e-17 m/s and may then find no path that continues.
            position, _, _ = self._trajectory.at_time(duration)
            return HeadMotion(Pose(*position))

        position, velocity, acceleration = self._trajectory.at_time(elapsed)
        return HeadMotion(Pose(*position), Twist(*velocity), tuple(acceleration))

    def arrival(self) -> float:
        """Return the end time of the path [s]; −inf before the first path."""
        return self._start + self._trajectory.duration

    def _plan(self, time: float, motion: HeadMotion, goal: Pose | None) -> None:
        """Plan a path from a motion to a goal, or to rest."""
        # From rest, limits in proportion to the displacement make the path straight.
        is_moving = any(motion.velocity) or any(motion.acceleration)
        displacement = ZERO_POSE
        if goal is not None and not is_moving:
            displacement = subtract(goal, motion.position)

        speed = _proportional(self.settings.speed, displacement)
        acceleration = _proportional(self.settings.acceleration, displacement)
        jerk = _proportional(self.settings.jerk, displacement)
        self._trajectory = plan_trajectory(motion, goal, speed, acceleration, jerk)
        self._start = time


SHORTEST_MOVE = 1e-9  # m or rad, minimum distance of an axis that moves


def _proportional(limits: tuple[float, ...], displacement: Pose) -> list[float]:
    """Return the largest limits proportional to a displacement; axes at rest keep theirs."""
    distances = [abs(step) for step in displacement]
    pace = math.inf
    for limit, distance in zip(limits, distances, strict=True):
        if distance > SHORTEST_MOVE:
            pace = min(pace, limit / distance)

    proportional = []
    for limit, distance in zip(limits, distances, strict=True):
        proportional.append(pace * distance if distance > SHORTEST_MOVE else limit)
    return proportional
