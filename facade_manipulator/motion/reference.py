"""The reference: goals on the wall become one jerk-limited, synchronised path in (x, y, θ)."""

from __future__ import annotations

import math
from typing import NamedTuple

from ruckig import Trajectory

from facade_manipulator.kinematics import Pose, subtract, Twist, wrap_angle, ZERO_POSE, ZERO_TWIST
from facade_manipulator.motion.trajectory import AXES, plan_trajectory
from facade_manipulator.parameters import parameter, settings

SHORTEST = 1e-9  # m or rad: an axis with a shorter distance is at rest
LAST = 1e-6  # s: 1e-18 m before the end, and 10 times what a clock since 1970 resolves


@settings
class ReferenceSettings:
    """Limits on the motion of the head on the wall: x, y and θ."""

    speed: tuple[float, ...] = parameter(
        'Highest speed: x, y, theta', default=(0.2, 0.1, 0.4), unit='m/s, rad/s', minimum=1e-3,
        maximum=5.0, elements=Pose._fields)
    acceleration: tuple[float, ...] = parameter(
        'Highest acceleration: x, y, theta', default=(0.6, 0.4, 1.5), unit='m/s^2, rad/s^2',
        minimum=1e-2, maximum=50.0, elements=Pose._fields)
    jerk: tuple[float, ...] = parameter(
        'Highest jerk: x, y, theta', default=(6.0, 4.0, 15.0), unit='m/s^3, rad/s^3', minimum=0.1,
        maximum=1e4, elements=Pose._fields)


class HeadMotion(NamedTuple):
    """Position, velocity and acceleration of the head on the wall [m, m, rad; per s; per s²]."""

    position: Pose
    velocity: Twist = ZERO_TWIST
    acceleration: tuple[float, float, float] = (0.0, 0.0, 0.0)


class ReferencePath:
    """
    The head's path on the wall towards the present goal.

    A new goal is planned for from the present motion; from rest the path is straight.
    """

    def __init__(self, settings: ReferenceSettings) -> None:
        self.settings = settings
        self._trajectory = Trajectory(AXES)
        self._start = -math.inf  # before the first path

    def initialise(self, time: float, motion: HeadMotion, goal: Pose) -> None:
        """
        Begin the path again at a motion and plan it to a goal.

        At the time [s] of the motion; it ends at rest, and θ turns by at most half a turn.

        Raises a ManipulatorError if there is no such path.
        """
        turn = wrap_angle(goal.theta - motion.position.theta)
        goal = goal._replace(theta=motion.position.theta + turn)
        self._plan(time, motion, goal)

    def retarget(self, time: float, goal: Pose) -> None:
        """Plan to another goal from the motion at a time [s]; it must have been initialised."""
        self.initialise(time, self.at(time), goal)

    def stop(self, time: float) -> Pose:
        """Come to rest as soon as the limits allow, from a time [s]; return the final pose."""
        self._plan(time, self.at(time), None)
        return self.at(math.inf).position

    def at(self, time: float) -> HeadMotion:
        """Return the motion at a time [s]; before the path begins its start, later its end."""
        elapsed, duration = max(time - self._start, 0.0), self._trajectory.duration
        if elapsed >= duration - LAST:
            # at rest: ruckig's rounding there, 1e-17 m/s, may leave no path to continue with
            position, _, _ = self._trajectory.at_time(duration)
            return HeadMotion(Pose(*position))
        position, velocity, acceleration = self._trajectory.at_time(elapsed)
        return HeadMotion(Pose(*position), Twist(*velocity), tuple(acceleration))

    def arrival(self) -> float:
        """Return the end time of the path [s], −inf before the first."""
        return self._start + self._trajectory.duration

    def _plan(self, time: float, motion: HeadMotion, goal: Pose | None) -> None:
        """Plan to a goal, or to rest."""
        # from rest with limits in proportion to the displacement: the path is straight
        is_moving = any(motion.velocity) or any(motion.acceleration)
        displacement = ZERO_POSE if is_moving or not goal else subtract(goal, motion.position)
        self._trajectory = plan_trajectory(motion, goal, *(
            _proportional(limits, displacement) for limits in (
                self.settings.speed, self.settings.acceleration, self.settings.jerk)))
        self._start = time


def _proportional(limits: tuple[float, ...], displacement: Pose) -> list[float]:
    """Return the largest limits in proportion to the displacement; an axis at rest keeps its."""
    pace = min(
        (limit / abs(step) for limit, step in zip(limits, displacement, strict=True)
         if abs(step) > SHORTEST), default=0.0)
    return [
        pace * abs(step) if abs(step) > SHORTEST else limit
        for limit, step in zip(limits, displacement, strict=True)]
