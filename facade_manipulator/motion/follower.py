"""
Follower of the setpoint stream in the driver: checks, interpolation and motion limits.

Each setpoint states the instant at which the carriages should reach it. Between two setpoints the
carriages follow a cubic curve. Shortly beyond the newest setpoint they keep its velocity, unless
the stream has only one setpoint. Afterwards they brake and hold, so that a silent stream moves no
carriage. Senders give the mean velocity since the previous setpoint. When the next setpoint
arrives, the velocity becomes the velocity of the parabola through all three setpoints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import enum
import math
from typing import NamedTuple

from facade_manipulator.errors import (
    InputError,
    ManipulatorError,
    ParameterError,
    require_recent,
)
from facade_manipulator.kinematics.geometry import PerCarriage
from facade_manipulator.motion.limits import (
    CarriageMotion,
    greatest,
    MotionLimits,
    PathLimiter,
)
from facade_manipulator.motion.setpoints import (
    extrapolate,
    interpolate,
    require_possible,
    require_within,
    Setpoint,
)
from facade_manipulator.motion.timed_buffer import TimedBuffer
from facade_manipulator.parameters import number_text, parameter, settings

OLDEST_SETPOINT = 0.2  # s, maximum age of a setpoint; an older setpoint is useless


@settings
class StreamSettings:
    """Limits for the age and the distance of setpoints."""

    stale_after: float = parameter(
        'Silence after which the carriages brake and hold, at least two periods of both rates',
        default=0.1,
        unit='s',
        minimum=0.01,
        maximum=OLDEST_SETPOINT,
    )
    first_step: float = parameter(
        'Maximum step from the carriages or the last setpoint to the next setpoint',
        default=0.05,
        unit='m',
        minimum=0.001,
        maximum=0.5,
    )

    def require_rate(self, name: str, rate: float) -> None:
        """
        Raise a ParameterError if a rate [Hz] has a period of more than half of `stale_after`.

        If the lead time is short, one lost setpoint of such a stream brakes the carriages. A cycle
        with such a period asks for positions too far ahead of the newest setpoint.
        """
        lowest = 2.0 / self.stale_after
        if rate >= lowest:
            return
        stale_after = math.ceil(2000.0 / rate) / 1000.0
        raise ParameterError(
            f'{name} = {number_text(rate)} Hz is below 2 / stream.stale_after = '
            f'{number_text(lowest)} Hz; next: set at least {math.ceil(lowest)} Hz, or '
            f'stream.stale_after to at least {number_text(stale_after)} s'
        )


class Activity(enum.Enum):
    """Activity of the carriages, for the operator."""

    HOLDING = 'holding'
    FOLLOWING = 'following'
    LIMITED = 'limited'
    BRAKING = 'braking'


class StreamStatus(NamedTuple):
    """Status of the setpoint stream, for the operator."""

    activity: str = 'holding'
    limited_cycles: int = 0  #: cycles in which the limits slowed the carriages
    brakes: int = 0  #: number of forced brakes
    last_brake: str = ''  #: cause of the last forced brake


class SetpointFollower:
    """
    Follower that computes one commanded position per cycle [m] from a stream of setpoints.

    Parameters
    ----------
    settings : StreamSettings
    limits : MotionLimits
    period : float
        Time between two cycles [s].
    check : callable
        Takes carriage positions, each of shape (3,) [m], and raises a ManipulatorError for the
        first impossible or forbidden one.
    allowed_speed : callable
        Takes carriage positions, each of shape (3,) [m], and returns the speed that is allowed
        at all of them [m/s].

    """

    # factor on the limits; carriages lag up to this factor, and a setpoint beyond it is wrong
    TOLERATED = 2.0
    # s, longest horizon of a compensator; a stamp farther ahead means that a clock is wrong
    EARLIEST = 0.5

    # causes of a brake
    STREAM_SILENT = 'no valid setpoint was received for longer than stream.stale_after'
    STREAM_ENDED = 'the driver ended the stream of setpoints'
    LIMITS_LOWERED = 'the carriages were faster than the lowered limits'

    def __init__(
        self,
        settings: StreamSettings,
        limits: MotionLimits,
        period: float,
        check: Callable[..., None],
        allowed_speed: Callable[..., float] = lambda *_: math.inf,
    ) -> None:
        self.settings = settings
        #: number of cycles in which the limits slowed the carriages
        self.limited_cycles = 0
        self.brakes = 0  #: number of forced brakes
        self.last_brake = ''  #: cause of the last forced brake
        self._period = period
        # above them a setpoint is wrong [m/s, m/s²]; they grow with the limits
        self._tolerated_speed = 0.0
        self._tolerated_acceleration = 0.0
        self.change_limits(limits)
        self._check = check
        self._allowed_speed = allowed_speed
        #: the commanded motion; None before the first `reset`
        self.motion: CarriageMotion | None = None
        # the commanded motion before the last `sample`, or after the last `reset`
        self._motion_before: CarriageMotion | None = None
        # the motions to rest from the commanded motion
        self._stop: Iterator[CarriageMotion] = iter(())
        self._stream: TimedBuffer[Setpoint, tuple[PerCarriage, PerCarriage]] = (
            TimedBuffer(interpolate)
        )
        self._sampled = -math.inf  # the time for which `sample` was called last [s]
        self.activity = Activity.HOLDING

    @property
    def at_rest(self) -> bool:
        """Return whether the commanded motion has come to rest."""
        return self.motion is None or self.motion.at_rest

    @property
    def status(self) -> StreamStatus:
        """Return the present activity and the counters."""
        return StreamStatus(
            self.activity.value, self.limited_cycles, self.brakes, self.last_brake
        )

    def change_limits(self, limits: MotionLimits) -> None:
        """
        Apply new limits from the next cycle; a faster motion brakes within the old limits.

        Lower limits reject no setpoint: the carriages arrive later.
        """
        self._limiter = PathLimiter(limits, self._period)
        self._tolerated_speed = max(
            self._tolerated_speed, self.TOLERATED * limits.speed
        )
        self._tolerated_acceleration = max(
            self._tolerated_acceleration, self.TOLERATED * limits.acceleration
        )

    def reset(self, positions: PerCarriage) -> None:
        """Hold at measured positions [m], and discard the stream."""
        self.hold()
        self.motion = CarriageMotion(positions)
        self._motion_before = self.motion
        self._stop = iter(())
        self.activity = Activity.HOLDING

    def hold(self) -> None:
        """Discard the stream; each later `sample` brakes until the carriages rest."""
        self._stream.clear()

    def wait(self, seconds: float) -> None:
        """
        Continue from the last command after the drives have held it for more than a period.

        All axes are assumed to have braked for this time. A command at full speed would otherwise
        exceed the drives' following error window.
        """
        if self.motion is None:
            return
        self.motion = self._limiter.slow(self.motion, seconds)
        try:
            self._stop = self._checked_stop(self.motion)
        except ManipulatorError:
            self.motion = CarriageMotion(self.motion.position)
            self._stop = iter(())

    def withdraw(self) -> None:
        """
        Undo the last `sample`, because its positions were not sent.

        A call of `wait` must follow before the next `sample`.
        """
        self.motion = self._motion_before

    def add(self, setpoint: Setpoint, now: float) -> None:
        """
        Check a setpoint at the present time [s, monotonic], and add it to the stream.

        Raises
        ------
        InputError
            The setpoint is stale, in the future, out of order or inconsistent, or the follower
            holds no position yet.
        ManipulatorError
            `check` rejects the positions, or a jump or velocity is far beyond limits
            (SetpointLimitError).

        """
        if self.motion is None:
            raise InputError(
                'inactive', 'setpoint rejected: no position is held; next: activate'
            )

        self._check(setpoint.position)
        require_recent('setpoint', now - setpoint.time, OLDEST_SETPOINT, self.EARLIEST)
        last = self._predecessor(setpoint.time, now)
        is_first = last is None
        if last is None:
            # only the step and the speed of a first setpoint are checked
            last = Setpoint(-math.inf, self.motion.position, setpoint.velocity)
        first_step = self.settings.first_step
        require_possible(
            setpoint,
            last,
            first_step,
            self._tolerated_speed,
            self._tolerated_acceleration,
        )

        if is_first:
            self._stream.clear()
        self._smooth(setpoint)
        self._stream.append(setpoint.time, setpoint)

    def sample(self, reach_time: float) -> tuple[float, float, float]:
        """
        Return the positions [m] to command for `reach_time`, within the motion limits.

        `reach_time` is the time on the monotonic clock at which the carriages reach the command
        [s].

        Raises an InputError if `reset` was never called.
        """
        if self.motion is None:
            raise InputError(
                'inactive', 'no carriage position is known; next: call reset'
            )

        self._sampled = reach_time
        self._motion_before = self.motion
        target = self._target(reach_time)
        if target is None:
            self.motion = self._brake(self.motion, self._silence())
        else:
            self.motion = self._follow(self.motion, *target)
        q1, q2, q3 = self.motion.position
        return q1, q2, q3

    def _predecessor(self, time: float, now: float) -> Setpoint | None:
        """
        Return the setpoint before a time [s]; None for the first setpoint of a stream.

        The new setpoint replaces all setpoints for later times, so that one wrong stamp does not
        block the stream.
        """
        newest = self._stream.newest()
        if newest and time <= min(newest[0][0], self._sampled):
            raise InputError(
                'out_of_order',
                f'setpoint is {self._sampled - time:.3g} s older than the '
                'present command, and newer setpoints exist',
            )

        before, _ = self._stream.around(math.nextafter(time, -math.inf))
        if before is None or now - before[0] > self.settings.stale_after:
            return None
        return before[1]

    def _smooth(self, following: Setpoint) -> None:
        """
        Set the velocity of the newest setpoint from a parabola through its neighbours.

        This requires that the carriages do not follow the path to the setpoint yet, and that
        setpoints are more than a cycle apart. Mean velocities make a jump of acceleration at each
        setpoint: at 500 Hz the jerk limit would delay the carriages in every third cycle.
        """
        known = self._stream.newest(2)
        if len(known) < 2:
            return
        (first_time, first), (time, newest) = known
        h = time - first_time
        k = following.time - time
        if first_time <= self._sampled or k < 1.5 * self._period:
            return

        # The parabola through a, b and c, at distances h and k, has this velocity at b:
        # (k/h (b − a) + h/k (c − b)) / (h + k)
        most = 0.5 * self._limiter.limits.acceleration * h  # change within h/2
        velocity = []
        for a, b, mean, c in zip(
            first.position,
            newest.position,
            newest.velocity,
            following.position,
            strict=True,
        ):
            slope = (k / h * (b - a) + h / k * (c - b)) / (h + k)
            velocity.append(min(max(slope, mean - most), mean + most))
        self._stream.append(time, newest._replace(velocity=velocity))

    def _target(self, time: float) -> tuple[PerCarriage, PerCarriage] | None:
        """Return position [m] and velocity [m/s] of the stream at a time; None in silence."""
        target = self._stream.interpolated(time)
        if target is not None:
            return target
        before, _ = self._stream.around(time)
        if before is None or time - before[0] > self.settings.stale_after:
            return None
        return extrapolate([setpoint for _, setpoint in self._stream.newest(2)], time)

    def _follow(
        self, before: CarriageMotion, position: PerCarriage, velocity: PerCarriage
    ) -> CarriageMotion:
        """Return the motion towards the target; brake unless a path from there to rest exists."""
        limiter = self._limiter
        if not limiter.allows(before, limiter.limits.speed):
            return self._brake(before, self.LIMITS_LOWERED)

        limiter.speed = min(limiter.limits.speed, self._allowed_speed(before.position))
        motion = limiter.reach(before, position, velocity)
        activity = Activity.FOLLOWING
        try:
            if motion is None:
                motion = limiter.chase(before, position, velocity)
                activity = Activity.LIMITED
            self._stop = self._checked_stop(motion)
        except ManipulatorError as error:
            return self._brake(before, error.problem)

        self.activity = activity
        if activity is Activity.LIMITED:
            self.limited_cycles += 1
        return motion

    def _checked_stop(self, motion: CarriageMotion) -> Iterator[CarriageMotion]:
        """
        Return the path from a motion to rest; raise a ManipulatorError if it is not allowed.

        On the path, a carriage must also be able to stop before a neighbour that stops at once.
        """
        path = self._limiter.stop(motion)
        positions = [position for position, _, _ in reversed(path)]
        # The end of the path is checked first, because it fails most often. Each position is a
        # target if the carriages brake, and is then checked once more before it is sent.
        self._check(*positions)

        speeds: list[float] = []
        for _, velocity, _ in path:
            speeds += velocity
        # This is rare: two carriages are near each other.
        if greatest(speeds) > self._allowed_speed(*positions):
            for position, velocity, _ in path:
                require_within(
                    'speed of {} at this distance from its neighbour',
                    velocity,
                    self._allowed_speed(position),
                    'm/s',
                )
        return _motions(self._limiter, motion, path[1:])  # of the present limits

    def _silence(self) -> str:
        """Return the reason why the stream has no target."""
        return self.STREAM_SILENT if self._stream.newest() else self.STREAM_ENDED

    def _brake(self, before: CarriageMotion, cause: str) -> CarriageMotion:
        """Return the next motion on the path to rest, which was checked one cycle earlier."""
        motion = next(self._stop, None)
        if motion is None:
            self.activity = Activity.HOLDING
            return CarriageMotion(before.position)
        if self.activity is not Activity.BRAKING:
            self.brakes += 1
            self.last_brake = cause
        self.activity = Activity.BRAKING
        return motion


def _motions(
    limiter: PathLimiter,
    motion: CarriageMotion,
    states: Sequence[Sequence[PerCarriage]],
) -> Iterator[CarriageMotion]:
    """Yield the motions that follow a motion through the given states, one per period."""
    for state in states:
        motion = limiter.advance(motion, state)
        yield motion
