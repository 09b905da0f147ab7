"""The reference: goals on the wall become one jerk-limited, synchronised path in (x, y, θ)."""

from __future__ import annotations

from contextlib import suppress
import math
from typing import NamedTuple

from ruckig import ControlInterface, InputParameter, Ruckig, Synchronization, Trajectory

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Pose, subtract, Twist, wrap_angle, ZERO_POSE, ZERO_TWIST
from facade_manipulator.motion.limits import calculate
from facade_manipulator.parameters import parameter, settings

UNITS = 'm, rad'
SHORTEST = 1e-9  # m or rad: an axis with less to go stands
LAST = 1e-6  # s: 1e-18 m before the end, and 10 times what a clock since 1970 resolves


@settings
class ReferenceSettings:
    """How fast the head moves on the wall: x, y and θ."""

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
    The head's path on the wall towards the goal of the moment.

    A new goal is planned for from the motion of the moment; from rest the path is straight.
    """

    def __init__(self, settings: ReferenceSettings) -> None:
        self._planner = Ruckig(len(Pose._fields))
        self._plan = InputParameter(len(Pose._fields))
        self.settings = settings
        self._trajectory = Trajectory(len(Pose._fields))
        self._end = HeadMotion(ZERO_POSE)
        self._start = -math.inf  # before the first path

    def initialise(self, time: float, motion: HeadMotion, goal: Pose) -> None:
        """
        Begin the path again at a motion and plan it to a goal.

        At the time [s] of the motion; it ends at rest, and θ turns by at most half a turn.

        Raises a ManipulatorError if there is no such path.
        """
        turn = wrap_angle(goal.theta - motion.position.theta)
        goal = goal._replace(theta=motion.position.theta + turn)
        self._plan.target_position = list(goal)
        straight = not any(motion.velocity) and not any(motion.acceleration)
        self._begin(
            time, motion, subtract(goal, motion.position) if straight else ZERO_POSE,
            f'from {tuple(motion.position)} to {tuple(goal)} {UNITS}')

    def stop(self, time: float) -> Pose:
        """Come to rest as soon as the limits allow, from a time on [s]; return where."""
        self._plan.control_interface = ControlInterface.Velocity
        try:
            self._begin(time, self.at(time), ZERO_POSE, 'to rest')
        finally:
            self._plan.control_interface = ControlInterface.Position
        return self._end.position

    def _begin(self, time: float, motion: HeadMotion, displacement: Pose, where: str) -> None:
        """Plan from a motion; straight, unless rounding leaves ruckig no such path."""
        plan, trajectory = self._plan, Trajectory(len(Pose._fields))
        plan.current_position, plan.current_velocity, plan.current_acceleration = (
            map(list, motion))
        self._limit(displacement)
        for synchronization in (Synchronization.Phase, Synchronization.TimeIfNecessary):
            plan.synchronization = synchronization
            with suppress(ManipulatorError):  # met where the remainder of a path is 1e-14
                calculate(self._planner, plan, trajectory)
                self._trajectory, self._start = trajectory, time
                # at rest: ruckig's rounding there, 1e-17 m/s, may leave no path to continue with
                self._end = HeadMotion(_motion(trajectory, trajectory.duration).position)
                return
        raise ManipulatorError(f'no jerk-limited path {where}')

    def retarget(self, time: float, goal: Pose) -> None:
        """Plan to another goal from the motion at a time [s]; it must have been initialised."""
        self.initialise(time, self.at(time), goal)

    def at(self, time: float) -> HeadMotion:
        """Return the motion at a time [s]; before the path begins its start, later its end."""
        elapsed = max(time - self._start, 0.0)
        if elapsed >= self._trajectory.duration - LAST:
            return self._end
        return _motion(self._trajectory, elapsed)

    def _limit(self, displacement: Pose) -> None:
        """Limit all axes that move in proportion to their displacement: the path is straight."""
        plan, settings = self._plan, self.settings
        plan.max_velocity, plan.max_acceleration, plan.max_jerk = (
            _proportional(limits, displacement)
            for limits in (settings.speed, settings.acceleration, settings.jerk))

    def arrival(self) -> float:
        """Return when the path ends [s], −inf before the first."""
        return self._start + self._trajectory.duration


class Approach:
    """Lead the head to a goal that comes alone, as a supervisor without a compensator sends it."""

    def __init__(self, settings: ReferenceSettings) -> None:
        self._reference = ReferencePath(settings)
        self.is_under_way = False  #: whether the head is being led; false leads it no longer

    def begin(self, time: float, head: Pose, goal: Pose) -> None:
        """Lead from where the head rests, or from where it is being led, to the goal."""
        if self.is_under_way:
            self._reference.retarget(time, goal)
        else:
            self._reference.initialise(time, HeadMotion(head), goal)
        self.is_under_way = True

    def pose(self, time: float) -> Pose | None:
        """Return the pose of the head at a time [s]; None when it is not being led."""
        if not self.is_under_way:
            return None
        self.is_under_way = time < self._reference.arrival()
        return self._reference.at(time).position


def _motion(trajectory: Trajectory, elapsed: float) -> HeadMotion:
    position, velocity, acceleration = trajectory.at_time(elapsed)
    return HeadMotion(Pose(*position), Twist(*velocity), tuple(acceleration))


def _proportional(limits: tuple[float, ...], displacement: Pose) -> list[float]:
    """Return the largest limits in proportion to the displacement; an axis at rest keeps its."""
    pace = min(
        (limit / abs(step) for limit, step in zip(limits, displacement, strict=True)
         if abs(step) > SHORTEST), default=0.0)
    return [
        pace * abs(step) if abs(step) > SHORTEST else limit
        for limit, step in zip(limits, displacement, strict=True)]
