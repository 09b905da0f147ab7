"""
Speed, acceleration and jerk limits of the three carriages, kept by all three axes together.

A target inside the limits passes unchanged. Beyond them the carriages chase the moving target on
the time-optimal jerk-limited path, planned in the frame that moves with it (ruckig), with one
duration for all three axes, so that the path of the head has the corners of the stream only.

The limits apply to the first, second and third differences of the positions, because a drive
receives only positions, one each period. Near each other carriages are slower, so that none runs
into a neighbour that stands dead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import math
from typing import NamedTuple

import ruckig

from facade_manipulator.errors import ManipulatorError, ParameterError
from facade_manipulator.kinematics import Geometry, Mechanism
from facade_manipulator.parameters import parameter, settings

Triple = tuple[float, float, float]
STANDSTILL_SPEED = 1e-5  # m/s
STANDSTILL_ACCELERATION = 1e-3  # m/s²
ZERO = (0.0, 0.0, 0.0)  # of any unit
FEED_FORWARD_SHARE = 0.8  # of the speed limit; the rest is for catching up
PLAN_TOLERANCE = 1e-9  # m, and per s and s²: such a motion is the one that was planned
ROUNDING = 1e-9  # relative
TOLERANCE = 1e-6  # relative: rounding of a path adds up over its periods
MARGIN = 0.001  # m, for the speed that a carriage still gains until it brakes


@settings
class MotionLimits:
    """Bounds on the motion of each carriage."""

    speed: float = parameter(
        'Highest speed of a carriage', default=0.5, unit='m/s', minimum=0.001, maximum=5.0,
        live=True)
    acceleration: float = parameter(
        'Highest acceleration of a carriage', default=3.0, unit='m/s^2', minimum=0.01,
        maximum=50.0, live=True)
    jerk: float = parameter(
        'Highest jerk of a carriage', default=150.0, unit='m/s^3', minimum=0.1, maximum=10000.0,
        live=True)

    def __post_init__(self) -> None:
        if self.jerk < self.acceleration:
            raise ParameterError(
                f'jerk = {self.jerk:g} m/s^3 is below acceleration = {self.acceleration:g} m/s^2: '
                'a ramp would take more than 1 s')


def triple(values: Iterable[float]) -> Triple:
    """Return one value of each carriage."""
    a, b, c = values
    return a, b, c


class CarriageMotion(NamedTuple):
    """How the three carriages move at one instant; each shape (3,)."""

    position: Triple  #: [m]
    velocity: Triple = ZERO  #: [m/s]
    acceleration: Triple = ZERO  #: [m/s²]
    mean_velocity: Triple = ZERO  #: first difference of the positions, a period apart [m/s]
    mean_acceleration: Triple = ZERO  #: their second difference [m/s²]

    @property
    def at_rest(self) -> bool:
        """Whether no carriage moves, or begins to."""
        return (_greatest(self.velocity) < STANDSTILL_SPEED
                and _greatest(self.acceleration) < STANDSTILL_ACCELERATION)


# position, velocity and acceleration of the carriages on a path, as ruckig returns them
PlannedState = tuple[Sequence[float], Sequence[float], Sequence[float]]


class PathLimiter:
    """
    Step a commanded motion towards a target without leaving the limits.

    There is a period [s] between two steps.
    """

    def __init__(self, limits: MotionLimits, period: float) -> None:
        self.limits = limits
        #: what is kept at present of the limit of speed [m/s]; beyond it the carriages slow down
        self.speed = limits.speed
        self.period = period
        self._planner = ruckig.Ruckig(3, period)
        self._chase = _plan(limits, ruckig.ControlInterface.Position)
        self._brake = _plan(limits, ruckig.ControlInterface.Velocity)
        self._path, self._stop = ruckig.Trajectory(3), ruckig.Trajectory(3)
        self._relative: PlannedState = ZERO, ZERO, ZERO
        self._frame: Triple | None = None  # of the path that is planned
        self._planned_speed = self._elapsed = 0.0
        self._reached: CarriageMotion | None = None

    def reach(
        self, motion: CarriageMotion, target: Triple, target_velocity: Triple
    ) -> CarriageMotion | None:
        """
        Return the motion that is at the target one period later, None if limits forbid it.

        Carriages that catch up must arrive with the target's velocity: otherwise they would
        oscillate about it.
        """
        direct = self._direct(motion, target)
        if not self._allowed(motion, direct):
            return None
        if motion is not self._reached and not self._meets(motion, direct, target_velocity):
            return None
        self._reached = direct
        return direct

    def chase(
        self, motion: CarriageMotion, target: Triple, target_velocity: Triple
    ) -> CarriageMotion:
        """
        Return the motion one period later on the fastest allowed path to a moving target.

        That says where the carriages should be then [m]; where its own velocity [m/s] is faster
        than the limits, it is taken as slower.

        Raises a ManipulatorError if no path was found, which ruckig says of some motions inside
        all limits.
        """
        speed, fastest = self.speed, _greatest(target_velocity)
        share = min(1.0, FEED_FORWARD_SHARE * speed / fastest) if fastest else 1.0
        frame = triple(share * v for v in target_velocity)
        relative = (
            triple(p - t + w * self.period
                  for p, t, w in zip(motion.position, target, frame, strict=True)),
            triple(v - w for v, w in zip(motion.velocity, frame, strict=True)),
            motion.acceleration)
        if speed != self._planned_speed or not self._continues(relative, frame):
            self._chase.max_velocity = [speed - w for w in frame]
            self._chase.min_velocity = [-speed - w for w in frame]
            self._calculate(self._chase, relative, self._path)
            self._elapsed, self._frame, self._planned_speed = 0.0, frame, speed
        self._elapsed += self.period
        self._relative = error, rate, acceleration = self._path.at_time(
            min(self._elapsed, self._path.duration))
        return self.advance(motion, (
            triple(e + t for e, t in zip(error, target, strict=True)),
            triple(e + w for e, w in zip(rate, frame, strict=True)), acceleration))

    def keeps(self, motion: CarriageMotion) -> bool:
        """
        Return whether a motion is inside the limits, and can go on to be.

        One that is not, because they were lowered, must brake by the limits that it was planned
        with: a lower jerk could not end its acceleration before it is too fast.
        """
        limits = self.limits
        most = limits.speed * (1.0 + TOLERANCE)
        return (_greatest(motion.acceleration) <= limits.acceleration * (1.0 + TOLERANCE)
                and _greatest(motion.velocity) <= most
                and _greatest(self._extreme_velocity(motion)) <= most)

    def slow(self, motion: CarriageMotion, seconds: float) -> CarriageMotion:
        """Return a motion at its position after all axes have braked for a while [s]."""
        fastest = _greatest(motion.velocity)
        lost = self.limits.acceleration * seconds
        share = 1.0 - lost / fastest if fastest > lost else 0.0
        velocity = triple([share * v for v in motion.velocity])
        return CarriageMotion(motion.position, velocity, mean_velocity=velocity)

    def stop(self, motion: CarriageMotion) -> list[PlannedState]:
        """
        Return the states on the path to rest, a period apart; the last one is at rest.

        All axes brake together. `advance` makes motions of them, which most callers do not need.

        Raises a ManipulatorError if no path was found.
        """
        if motion.at_rest:
            return []
        self._calculate(self._brake, motion[:3], self._stop)
        duration, at_time = self._stop.duration, self._stop.at_time
        count = math.ceil(duration / self.period - ROUNDING)
        return [at_time(min(number * self.period, duration)) for number in range(1, count + 1)]

    def _calculate(
        self, plan: ruckig.InputParameter, start: PlannedState, trajectory: ruckig.Trajectory
    ) -> None:
        """
        Calculate the trajectory of a plan from a position, velocity and acceleration.

        Of an acceleration that rounding has put beyond the limit ruckig makes no plan at all; of
        one that is far beyond it, because the limit has been lowered, it does.
        """
        position, velocity, acceleration = start
        most = self.limits.acceleration
        plan.current_position, plan.current_velocity = list(position), list(velocity)
        plan.current_acceleration = [
            math.copysign(most, a) if most < abs(a) < most * (1.0 + ROUNDING) else a
            for a in acceleration]
        calculate(self._planner, plan, trajectory)

    def _continues(self, relative: PlannedState, frame: Triple) -> bool:
        """Return whether the present motion is the planned one: a new plan would bend the path."""
        return frame == self._frame and all(
            abs(a - b) <= PLAN_TOLERANCE
            for part, plan in zip(relative, self._relative, strict=True)
            for a, b in zip(part, plan, strict=True))

    def _direct(self, motion: CarriageMotion, target: Triple) -> CarriageMotion:
        """
        Return the motion at the target, as its position and those before show it.

        The second difference is the acceleration of a period ago, and half a period later it has
        changed the mean velocity into the present one.
        """
        mean = self._rates(motion.position, target)
        acceleration = self._rates(motion.mean_velocity, mean)
        half = 0.5 * self.period
        velocity = triple([v + half * a for v, a in zip(mean, acceleration, strict=True)])
        return CarriageMotion(target, velocity, acceleration, mean, acceleration)

    def advance(self, before: CarriageMotion, state: PlannedState) -> CarriageMotion:
        """Return the motion in a state one period after another motion."""
        position, velocity, acceleration = map(triple, state)
        mean = self._rates(before.position, position)
        return CarriageMotion(
            position, velocity, acceleration, mean, self._rates(before.mean_velocity, mean))

    def _rates(self, before: Triple, after: Triple) -> Triple:
        """Return how fast values change within a period; spelt out, it runs thrice a cycle."""
        rate, (a1, a2, a3), (b1, b2, b3) = 1.0 / self.period, before, after
        return (b1 - a1) * rate, (b2 - a2) * rate, (b3 - a3) * rate

    def _allowed(self, before: CarriageMotion, after: CarriageMotion) -> bool:
        """Return whether differences keep the limits, and can go on to do so."""
        limits = self.limits
        return (_greatest(after.mean_velocity) <= self.speed
                and _greatest(after.mean_acceleration) <= limits.acceleration
                and _greatest(self._rates(before.mean_acceleration, after.mean_acceleration))
                <= limits.jerk
                and _greatest(self._extreme_velocity(after)) <= self.speed)

    def _extreme_velocity(self, motion: CarriageMotion) -> Triple:
        """Return the velocities when the jerk has ended the accelerations."""
        share = 0.5 / self.limits.jerk
        return triple([
            v + share * a * abs(a)
            for v, a in zip(motion.velocity, motion.acceleration, strict=True)])

    def _meets(self, before: CarriageMotion, after: CarriageMotion, velocity: Triple) -> bool:
        """Return whether a motion with a mean velocity arrives with a velocity, about."""
        tolerance = 0.5 * self.limits.jerk * self.period ** 2
        return all(
            abs(2.0 * mean - start - wanted) <= tolerance
            for mean, start, wanted in zip(
                after.mean_velocity, before.velocity, velocity, strict=True))


class Separation(NamedTuple):
    """
    Speed and distance: how fast carriages may be where a neighbour may stand dead at once.

    A dead drive that is silent is missed after `silence`. One that still answers is found by its
    following error, or where the measured distance is below the tolerated minimum.
    """

    touching: float  #: distance at which neighbours touch [m]
    deceleration: float  #: of the weakest brake [m/s²]
    silence: float  #: time until the others brake after a drive falls silent [s]
    window: float  #: following error that is tolerated [m]
    tracking: float  #: how long it may be beyond it [s]
    tolerated: float  #: minimum measured distance that is tolerated [m]
    report: float  #: how long it may be below it until they brake [s]

    def speed(self, distance: float) -> float:
        """Return how fast neighbours may be at a distance [m], in m/s."""
        seen = max(self._stopping_from(self.tolerated, self.report),
                   self._stopping_from(distance - self.window, self.tracking))
        return min(seen, self._stopping_from(distance, self.silence))

    def distance(self, speed: float) -> float:
        """Return the minimum distance [m] at which neighbours may have a speed [m/s]."""
        def needed(delay: float) -> float:
            return self.touching + MARGIN + speed * delay + 0.5 * speed ** 2 / self.deceleration

        is_seen = needed(self.report) <= self.tolerated
        return max(needed(self.silence), 0.0 if is_seen else self.window + needed(self.tracking))

    def _stopping_from(self, distance: float, delay: float) -> float:
        """Return the speed from which a carriage just stops within a distance, after a delay."""
        room = max(0.0, distance - self.touching - MARGIN)
        late = self.deceleration * delay
        return math.sqrt(late * late + 2.0 * self.deceleration * room) - late


def fastest_near(geometry: Geometry, separation: Separation) -> Callable[..., float]:
    """Return the function from a path of positions (q1, q2, q3) [m] to its allowed speed [m/s]."""
    first, second, third = Mechanism(geometry).on_rail(ZERO)
    left, right = third - first, second - third

    def fastest(*path: Triple) -> float:
        return separation.speed(min([
            min(q3 - q1 + left, q2 - q3 + right) for q1, q2, q3 in path]))

    return fastest


def calculate(
    planner: ruckig.Ruckig, plan: ruckig.InputParameter, trajectory: ruckig.Trajectory
) -> None:
    """
    Calculate the trajectory of a plan, or raise a ManipulatorError: there is none.

    On the border of two kinds of path, as of 12 mm from rest with 0.6 m/s² and 6 m/s³, ruckig may
    find neither ("error in step 1"). With a millionth less of jerk it finds one.
    """
    jerk, failure = plan.max_jerk, ''
    for share in (1.0, 1.0 - TOLERANCE):
        plan.max_jerk = [share * most for most in jerk]
        try:
            result = planner.calculate(plan, trajectory)
        except ruckig.RuckigError as error:
            failure = str(error)
        else:
            is_found = result in (ruckig.Result.Working, ruckig.Result.Finished)
            failure = '' if is_found else str(result)
        plan.max_jerk = jerk
        if not failure:
            return
    raise ManipulatorError(f'no path inside the motion limits: {failure}')


def _plan(limits: MotionLimits, interface: ruckig.ControlInterface) -> ruckig.InputParameter:
    """Return a plan to come to rest at zero, or just to rest."""
    plan = ruckig.InputParameter(3)
    plan.control_interface = interface
    plan.synchronization = ruckig.Synchronization.Phase
    plan.target_position = plan.target_velocity = [0.0] * 3
    plan.max_velocity = [limits.speed] * 3
    plan.max_acceleration = [limits.acceleration] * 3
    plan.max_jerk = [limits.jerk] * 3
    return plan


def _greatest(values: Triple) -> float:
    return max(map(abs, values))
