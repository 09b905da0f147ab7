"""
Speed, acceleration and jerk limits of the three carriages, applied jointly.

A target inside the limits passes unchanged. Beyond the limits, the carriages follow the moving
target on a time-optimal jerk-limited path. Ruckig plans this path in the frame that moves with the
target, if possible with one duration for all three axes. The path of the head then has no corners
that the stream does not have.

The limits apply to the first, second and third differences of the positions, because a drive
receives only positions, one per period.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

from ruckig import Trajectory

from facade_manipulator.errors import compared, ParameterError
from facade_manipulator.kinematics.geometry import PerCarriage
from facade_manipulator.motion.trajectory import AXIS_COUNT, plan_trajectory
from facade_manipulator.parameters import parameter, settings

ZERO = (0.0, 0.0, 0.0)  # of any unit


@settings
class MotionLimits:
    """Motion limits that apply to each carriage."""

    speed: float = parameter(
        'Highest speed of a carriage',
        default=0.5,
        unit='m/s',
        minimum=0.001,
        maximum=5.0,
        live=True,
    )
    acceleration: float = parameter(
        'Highest acceleration of a carriage',
        default=3.0,
        unit='m/s^2',
        minimum=0.01,
        maximum=50.0,
        live=True,
    )
    jerk: float = parameter(
        'Highest jerk of a carriage; with a lower jerk it brakes later',
        default=150.0,
        unit='m/s^3',
        minimum=0.1,
        maximum=10000.0,
        live=True,
    )

    def __post_init__(self) -> None:
        if self.jerk < self.acceleration:
            jerk, acceleration = compared(self.jerk, self.acceleration)
            raise ParameterError(
                f'jerk = {jerk} m/s^3 is below acceleration = {acceleration} m/s^2, '
                'so that a ramp would take more than 1 s; next: increase jerk'
            )


STANDSTILL_SPEED = 1e-5  # m/s
STANDSTILL_ACCELERATION = 1e-3  # m/s²


class CarriageMotion(NamedTuple):
    """Motion of the three carriages at one time; each field has shape (3,)."""

    position: PerCarriage  #: [m]
    velocity: PerCarriage = ZERO  #: [m/s]
    acceleration: PerCarriage = ZERO  #: [m/s²]
    #: first difference of the positions, a period apart [m/s]
    mean_velocity: PerCarriage = ZERO
    mean_acceleration: PerCarriage = ZERO  #: their second difference [m/s²]

    @property
    def at_rest(self) -> bool:
        """Return whether every carriage has no speed and no acceleration."""
        return (
            greatest(self.velocity) < STANDSTILL_SPEED
            and greatest(self.acceleration) < STANDSTILL_ACCELERATION
        )


def greatest(values: PerCarriage) -> float:
    """Return the maximum absolute value of the three carriages."""
    return max(map(abs, values))


def plus(a: PerCarriage, b: PerCarriage, factor: float = 1.0) -> PerCarriage:
    """Return a + factor · b for three axes; numpy would take five times as long."""
    a1, a2, a3 = a
    b1, b2, b3 = b
    return a1 + factor * b1, a2 + factor * b2, a3 + factor * b3


class PathLimiter:
    """
    Limiter that moves the commanded motion towards a target within the limits.

    The period is the time between two steps [s].
    """

    FEED_FORWARD_SHARE = 0.8  # share of the speed limit; the rest is for catching up
    # m, m/s and m/s²: a motion within these tolerances is the planned motion
    PLAN_TOLERANCE = 1e-9
    PERIODS_ROUNDING = 1e-9  # of a number of periods
    PATH_TOLERANCE = 1e-6  # relative: rounding of a path adds up over its periods

    def __init__(self, limits: MotionLimits, period: float) -> None:
        self.limits = limits
        #: present limit of speed [m/s]; beyond it the carriages slow down
        self.speed = limits.speed
        self.period = period
        # limit of each axis
        self._acceleration = [limits.acceleration] * AXIS_COUNT
        self._jerk = [limits.jerk] * AXIS_COUNT
        self._reached: CarriageMotion | None = None
        self._path = Trajectory(AXIS_COUNT)  # of `chase`
        self._planned: tuple[float, ...] = ()  # the frame and speed of this path
        self._elapsed = 0.0  # time since its begin [s]
        self._relative: Sequence[PerCarriage] = (ZERO, ZERO, ZERO)

    def reach(
        self, before: CarriageMotion, target: PerCarriage, velocity: PerCarriage
    ) -> CarriageMotion | None:
        """
        Return the motion that reaches the target one period later; None if the limits forbid it.

        Carriages that catch up must arrive with the target's velocity; otherwise they would
        oscillate about the target.
        """
        mean = self._rates(before.position, target)
        acceleration = self._rates(before.mean_velocity, mean)
        jerk = self._rates(before.mean_acceleration, acceleration)
        # The second difference is the acceleration of a period ago, and half a period later it has
        # changed the mean velocity into the present one.
        end_velocity = plus(mean, acceleration, 0.5 * self.period)
        after = CarriageMotion(target, end_velocity, acceleration, mean, acceleration)

        if not (
            greatest(mean) <= self.speed
            and greatest(jerk) <= self.limits.jerk
            and self.allows(after, self.speed, tolerance=0.0)
        ):
            return None

        # At constant acceleration the velocities at both ends of the period have this mean. The
        # difference shows whether the motion would arrive with another velocity.
        miss = greatest(plus(plus(before.velocity, velocity), mean, -2.0))
        if (
            before is not self._reached
            and miss > 0.5 * self.limits.jerk * self.period**2
        ):
            return None

        self._reached = after
        return after

    def chase(
        self, before: CarriageMotion, target: PerCarriage, velocity: PerCarriage
    ) -> CarriageMotion:
        """
        Return the motion one period later on the fastest permitted path to a moving target.

        The target is the position of the carriages at that time [m]. Its velocity [m/s] is reduced
        to the limits.

        Raises a ManipulatorError if no path was found.
        """
        speed = self.speed
        fastest = greatest(velocity)
        share = min(1.0, self.FEED_FORWARD_SHARE * speed / fastest) if fastest else 1.0
        frame = plus(ZERO, velocity, share)

        # The frame reaches the target at the end of the period T, with velocity w:
        # position − target + w T, velocity − w, acceleration
        error = plus(plus(before.position, target, -1.0), frame, self.period)
        rate = plus(before.velocity, frame, -1.0)
        relative = (error, rate, before.acceleration)

        planned = (*frame, speed)
        # A new plan for the planned motion would bend the path.
        if planned != self._planned or any(
            greatest(plus(part, plan, -1.0)) > self.PLAN_TOLERANCE
            for part, plan in zip(relative, self._relative, strict=True)
        ):
            forward = [speed - w for w in frame]
            backward = [-speed - w for w in frame]
            self._path = plan_trajectory(
                relative, ZERO, forward, self._acceleration, self._jerk, backward
            )
            self._planned = planned
            self._elapsed = 0.0

        self._elapsed += self.period
        end = min(self._elapsed, self._path.duration)
        self._relative = self._path.at_time(end)
        error, rate, acceleration = self._relative
        state = (plus(error, target), plus(rate, frame), acceleration)
        return self.advance(before, state)

    def allows(
        self, motion: CarriageMotion, speed: float, tolerance: float = PATH_TOLERANCE
    ) -> bool:
        """
        Return whether a motion is within a speed [m/s] and the other limits, now and later.

        A motion beyond limits that were lowered must brake within the limits of its plan. A lower
        jerk would end its acceleration too late, at an excessive speed.
        """
        share = 1.0 + tolerance
        if not greatest(motion.acceleration) <= share * self.limits.acceleration:
            return False

        # While a jerk j ends an acceleration a, the velocity changes by a |a| / (2 j).
        change = [0.5 / self.limits.jerk * a * abs(a) for a in motion.acceleration]
        end = plus(motion.velocity, change)
        most = share * speed
        return greatest(motion.velocity) <= most and greatest(end) <= most

    def slow(self, motion: CarriageMotion, seconds: float) -> CarriageMotion:
        """Return the motion at the same position after all axes have braked for a time [s]."""
        fastest = greatest(motion.velocity)
        lost = self.limits.acceleration * seconds
        share = 1.0 - lost / fastest if fastest > lost else 0.0
        velocity = plus(ZERO, motion.velocity, share)
        return CarriageMotion(motion.position, velocity, mean_velocity=velocity)

    def stop(self, motion: CarriageMotion) -> list[Sequence[PerCarriage]]:
        """
        Return the states on the path from a motion to rest, one per period.

        All axes come to rest together if ruckig finds such a path. A state is a tuple of position,
        velocity and acceleration; `advance` converts a state to a motion, but most callers need no
        motion.

        Raises a ManipulatorError if no path was found.
        """
        start = motion[:3]
        if motion.at_rest:
            return [start]

        speed = [self.limits.speed] * AXIS_COUNT
        path = plan_trajectory(start, None, speed, self._acceleration, self._jerk)
        period = self.period
        duration = path.duration
        count = math.ceil(duration / period - self.PERIODS_ROUNDING)
        times = [min(number * period, duration) for number in range(1, count + 1)]
        return [start, *map(path.at_time, times)]

    def advance(
        self, before: CarriageMotion, state: Sequence[PerCarriage]
    ) -> CarriageMotion:
        """Return the motion that reaches a state one period after another motion."""
        position, velocity, acceleration = state
        mean = self._rates(before.position, position)
        change = self._rates(before.mean_velocity, mean)
        return CarriageMotion(position, velocity, acceleration, mean, change)

    def _rates(self, before: PerCarriage, after: PerCarriage) -> PerCarriage:
        """Return the mean rates of change during a period [1/s]."""
        rate = 1.0 / self.period
        a1, a2, a3 = before
        b1, b2, b3 = after
        return (b1 - a1) * rate, (b2 - a2) * rate, (b3 - a3) * rate
