"""
Speed, acceleration and jerk limits of the three carriages, kept by all three axes together.

A target inside the limits passes unchanged. Beyond them the carriages chase the moving target on
the time-optimal jerk-limited path, planned in the frame that moves with it (ruckig), with one
duration for all three axes, so that the head turns no corner that the stream does not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ruckig import (
    ControlInterface,
    InputParameter,
    OutputParameter,
    Result,
    Ruckig,
    Synchronization,
    Trajectory,
)

from facade_manipulator.errors import ManipulatorError, ParameterError
from facade_manipulator.parameters import parameter, settings

Triple = tuple[float, float, float]
STANDSTILL_SPEED = 1e-5  # m/s
FEED_FORWARD_SHARE = 0.8  # of the speed limit: what remains is for catching up
PLAN_TOLERANCE = 1e-9  # m, and per s and s²: such a motion is the one that was planned
ROUNDING = 1e-9  # relative


@settings
class MotionLimits:
    """Bounds on the motion of each carriage."""

    speed: float = parameter(
        0.5, 'Highest speed of a carriage', unit='m/s', minimum=0.001, maximum=5.0)
    acceleration: float = parameter(
        3.0, 'Highest acceleration of a carriage', unit='m/s^2', minimum=0.01, maximum=50.0)
    jerk: float = parameter(
        150.0, 'Highest jerk of a carriage', unit='m/s^3', minimum=0.1, maximum=10000.0)

    def __post_init__(self) -> None:
        if self.jerk < self.acceleration:
            raise ParameterError(
                f'jerk = {self.jerk:g} m/s^3 is below acceleration = {self.acceleration:g} m/s^2: '
                'a ramp would take more than 1 s')


class CarriageMotion(NamedTuple):
    """Positions [m], velocities [m/s] and accelerations [m/s²] of the three carriages."""

    position: Triple
    velocity: Triple = (0.0, 0.0, 0.0)
    acceleration: Triple = (0.0, 0.0, 0.0)

    @property
    def at_rest(self) -> bool:
        """Whether no carriage moves."""
        return _greatest(self.velocity) < STANDSTILL_SPEED


class PathLimiter:
    """
    Step a commanded motion towards a target without leaving the limits.

    Parameters
    ----------
    limits : MotionLimits
    period : float
        Time between two steps [s].

    """

    def __init__(self, limits: MotionLimits, period: float) -> None:
        self.limits = limits
        self.period = period
        self._planner = Ruckig(3, period)
        self._chase = _plan(limits, ControlInterface.Position)
        self._brake = _plan(limits, ControlInterface.Velocity)
        self._output = OutputParameter(3)
        self._trajectory = Trajectory(3)
        self._relative: CarriageMotion | None = None
        self._is_catching_up = False

    def reach(
        self, motion: CarriageMotion, target: Triple, target_velocity: Triple
    ) -> CarriageMotion | None:
        """
        Return the motion that is at the target one period later, None if limits forbid it.

        Carriages that catch up must arrive with the target's velocity: who only crosses it would
        swing about it for ever.
        """
        direct = self._direct(motion, target)
        if not self._allowed(motion, direct):
            return None
        if self._is_catching_up and not self._meets(motion, direct, target_velocity):
            return None
        self._is_catching_up = False
        return direct

    def chase(
        self, motion: CarriageMotion, target: Triple, target_velocity: Triple
    ) -> CarriageMotion:
        """
        Return the motion one period later on the fastest allowed path to a moving target.

        Parameters
        ----------
        motion : CarriageMotion
            Present commanded motion.
        target : tuple of float, shape (3,)
            Where the carriages should be one period later [m].
        target_velocity : tuple of float, shape (3,)
            The target's own velocity [m/s]; faster than the limits, it is taken as slower.

        """
        self._is_catching_up = True
        frame = self._feed_forward(target_velocity)
        relative = self._continued(CarriageMotion(
            tuple(p - t + w * self.period
                  for p, t, w in zip(motion.position, target, frame, strict=True)),
            tuple(v - w for v, w in zip(motion.velocity, frame, strict=True)),
            motion.acceleration))
        self._chase.max_velocity = [self.limits.speed - w for w in frame]
        self._chase.min_velocity = [-self.limits.speed - w for w in frame]
        self._relative = step = self._step(_begin(self._chase, relative, self.limits.acceleration))
        return CarriageMotion(
            tuple(e + t for e, t in zip(step.position, target, strict=True)),
            tuple(e + w for e, w in zip(step.velocity, frame, strict=True)),
            step.acceleration)

    def brake(self, motion: CarriageMotion) -> CarriageMotion:
        """Return the motion one period later on the path to rest, all axes braking together."""
        self._is_catching_up = True
        return self._step(_begin(self._brake, motion, self.limits.acceleration))

    def rest_position(self, motion: CarriageMotion) -> Triple:
        """Return where the carriages come to rest when they brake now [m]."""
        plan = _begin(self._brake, motion, self.limits.acceleration)
        _require(self._planner.calculate(plan, self._trajectory))
        return tuple(self._trajectory.at_time(self._trajectory.duration)[0])

    def _continued(self, relative: CarriageMotion) -> CarriageMotion:
        """Return the planned motion if it is the present one: a new plan would bend the path."""
        planned = self._relative
        if planned is None or any(
            abs(a - b) > PLAN_TOLERANCE
            for part, plan in zip(relative, planned, strict=True)
            for a, b in zip(part, plan, strict=True)
        ):
            return relative
        return planned

    def _direct(self, motion: CarriageMotion, target: Triple) -> CarriageMotion:
        return CarriageMotion(
            target,
            velocity := self._rates(motion.position, target),
            self._rates(motion.velocity, velocity))

    def _rates(self, before: Triple, after: Triple) -> Triple:
        """Return how fast values change within a period; spelt out, it runs thrice a cycle."""
        rate, (a1, a2, a3), (b1, b2, b3) = 1.0 / self.period, before, after
        return (b1 - a1) * rate, (b2 - a2) * rate, (b3 - a3) * rate

    def _allowed(self, before: CarriageMotion, after: CarriageMotion) -> bool:
        limits = self.limits
        jerk = self._rates(before.acceleration, after.acceleration)
        return (_greatest(after.velocity) <= limits.speed
                and _greatest(after.acceleration) <= limits.acceleration
                and _greatest(jerk) <= limits.jerk)

    def _meets(self, before: CarriageMotion, after: CarriageMotion, velocity: Triple) -> bool:
        """Return whether a motion with a mean velocity arrives with a velocity, about."""
        tolerance = 0.5 * self.limits.jerk * self.period ** 2
        return all(
            abs(2.0 * mean - start - wanted) <= tolerance
            for mean, start, wanted in zip(
                after.velocity, before.velocity, velocity, strict=True))

    def _feed_forward(self, velocity: Triple) -> Triple:
        fastest = _greatest(velocity)
        share = min(1.0, FEED_FORWARD_SHARE * self.limits.speed / fastest) if fastest else 1.0
        return tuple(share * v for v in velocity)

    def _step(self, plan: InputParameter) -> CarriageMotion:
        _require(self._planner.update(plan, self._output))
        output = self._output
        return CarriageMotion(
            tuple(output.new_position), tuple(output.new_velocity), tuple(output.new_acceleration))


def _plan(limits: MotionLimits, interface: ControlInterface) -> InputParameter:
    """Return a plan to come to rest at zero, or just to rest."""
    plan = InputParameter(3)
    plan.control_interface = interface
    plan.synchronization = Synchronization.Phase
    plan.target_position = plan.target_velocity = [0.0] * 3
    plan.max_velocity = [limits.speed] * 3
    plan.max_acceleration = [limits.acceleration] * 3
    plan.max_jerk = [limits.jerk] * 3
    return plan


def _begin(plan: InputParameter, motion: CarriageMotion, most: float) -> InputParameter:
    """
    Let a plan begin at a motion.

    Of an acceleration that rounding has put beyond the limit ruckig makes no plan at all; of one
    that is far beyond it, because the limit has been lowered, it does.
    """
    plan.current_position, plan.current_velocity = map(list, motion[:2])
    plan.current_acceleration = [
        math.copysign(most, a) if most < abs(a) < most * (1.0 + ROUNDING) else a
        for a in motion.acceleration]
    return plan


def _greatest(values: Triple) -> float:
    return max(map(abs, values))


def _require(result: Result) -> None:
    if result not in (Result.Working, Result.Finished):
        raise ManipulatorError(f'no path inside the motion limits: {result}')
