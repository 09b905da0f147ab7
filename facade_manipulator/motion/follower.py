"""
The driver's view of the setpoint stream: checked on arrival, interpolated and limited each cycle.

Setpoints carry the instant they are meant for. Between two of them the carriages follow a cubic
curve, shortly beyond the newest one its velocity, unless it is the only one, and after that they
brake and hold: a stream that falls silent never moves anything. Senders give the mean velocity
since the setpoint before; as soon as the next one is known, the velocity becomes that of the
parabola through all three.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
import enum
import math
from threading import Lock

from facade_manipulator.errors import InputError, ManipulatorError, SetpointLimitError
from facade_manipulator.kinematics import Carriages
from facade_manipulator.motion.limits import (
    CarriageMotion,
    MotionLimits,
    PathLimiter,
    PlannedState,
    Triple,
    triple,
    ZERO,
)
from facade_manipulator.motion.setpoints import extrapolate, interpolate, Setpoint
from facade_manipulator.motion.timed_buffer import TimedBuffer
from facade_manipulator.parameters import parameter, settings

CARRIAGES = Carriages._fields
KEPT_MARGINS = 1000
TOLERATED = 2.0  # of the limits: carriages come later; beyond that a setpoint is wrong
SHORTEST = 0.02  # s: in less, backlash alone changes the velocity
OLDEST = 0.2  # s, age beyond which a setpoint is rejected: it is no longer of use
EARLIEST = 0.5  # s, the longest horizon of a compensator: beyond it a clock is wrong


@settings
class StreamSettings:
    """How late and how far a setpoint may be."""

    stale_after: float = parameter(
        'Silence after which the carriages brake and hold', default=0.1, unit='s',
        minimum=0.01, maximum=OLDEST)
    first_step: float = parameter(
        'How far from the carriages a stream may begin or jump', default=0.05, unit='m',
        minimum=0.001, maximum=0.5)


class Activity(enum.Enum):
    """Activity of the carriages."""

    HOLDING = 'holding'
    FOLLOWING = 'following'
    LIMITED = 'limited'
    BRAKING = 'braking'


class SetpointFollower:
    """
    Turn a stream of setpoints into one commanded position per cycle.

    `add` runs in the thread that receives the stream, everything else in the control thread;
    what they share, the stream and the commanded motion, is replaced and never changed.

    Parameters
    ----------
    settings : StreamSettings
    limits : MotionLimits
    period : float
        Time between two cycles [s].
    check : callable
        Takes carriage positions, each of shape (3,) [m], and raises a ManipulatorError for the
        first where the mechanism cannot or must not be.
    fastest : callable
        Takes carriage positions, each of shape (3,) [m], and returns the speed that is allowed
        at all of them [m/s].

    """

    def __init__(
        self, settings: StreamSettings, limits: MotionLimits, period: float,
        check: Callable[..., None],
        fastest: Callable[..., float] = lambda *_: math.inf,
    ) -> None:
        self.settings = settings
        #: cycles in which the limits held the carriages back; how often these had to brake
        self.limited_cycles = 0
        self.brakes = 0
        self.last_rejection = ''  #: why they last braked although the stream continued
        #: how early the last setpoints were when first used: their time less the commanded one [s]
        self.margins: deque[float] = deque(maxlen=KEPT_MARGINS)
        self._period = period
        self._fastest = self._hardest = 0.0
        self.change_limits(limits)
        self._check = check
        self._fastest_at = fastest
        #: the commanded motion; None before the first `reset`
        self.motion: CarriageMotion | None = None
        self._stop: Iterator[PlannedState] = iter(())
        self._stream: TimedBuffer[Setpoint] = TimedBuffer()
        self._writing = Lock()
        self._sampled = self._newest = -math.inf
        self.activity = Activity.HOLDING

    @property
    def at_rest(self) -> bool:
        """Whether the commanded motion is at rest."""
        return self.motion is None or self.motion.at_rest

    def change_limits(self, limits: MotionLimits) -> None:
        """
        Keep other limits from the next cycle on; what is beyond new ones brakes by the old ones.

        Lower ones reject no setpoint: the carriages come later.
        """
        self._limiter = PathLimiter(limits, self._period)
        self._fastest = max(self._fastest, TOLERATED * limits.speed)
        self._hardest = max(self._hardest, TOLERATED * limits.acceleration)

    def reset(self, positions: Triple) -> None:
        """Hold at measured positions [m] and forget the stream."""
        self.hold()
        self.motion = CarriageMotion(triple(positions))
        self._stop = iter(())
        self.activity = Activity.HOLDING

    def hold(self) -> None:
        """Brake to rest and forget the stream."""
        with self._writing:
            self._stream.clear()

    def wait(self, seconds: float) -> None:
        """
        Go on from the last command, which the drives have held for longer than a period.

        They braked in that time: a command that continued at full speed would leave them behind by
        more than their window.
        """
        if self.motion is None:
            return
        limiter = self._limiter
        motion = limiter.slow(self.motion, seconds)
        try:
            self._stop = self._checked_stop(limiter, motion)
        except ManipulatorError:
            motion, self._stop = CarriageMotion(motion.position), iter(())
        self.motion = motion

    def add(self, setpoint: Setpoint, now: float) -> None:
        """
        Add a setpoint to the stream.

        At the present time on its clock [s].

        Raises
        ------
        InputError
            Stale, in the future, out of order, with a velocity that the positions contradict, or
            nothing is held yet.
        ManipulatorError
            What `check` raises, or SetpointLimitError for a jump or a velocity far beyond limits.

        """
        self._check(setpoint.position)
        with self._writing:
            self._require_timely(setpoint, now)
            last = self._setpoint_before(setpoint.time, now)
            self._require_near(setpoint, last)
            self._require_feasible(setpoint, last)
            if last is None:
                self._stream.clear()
            self._smooth(setpoint)
            self._stream.append(setpoint.time, setpoint)

    def sample(self, latch_time: float) -> Triple:
        """
        Return the positions to command so that the carriages are there at `latch_time`.

        Then, on the setpoints' clock [s], the drives will have reached the command. The positions
        [m] are inside the motion limits.

        Raises an InputError if `reset` was never called.
        """
        if self.motion is None:
            raise InputError('no_position', 'no carriage position is known yet: reset first')
        self._note_margin(latch_time)
        self._sampled = latch_time
        target = self._target(latch_time)
        motion = (self._brake(self.motion) if target is None
                  else self._follow(self.motion, *target))
        self.motion = motion
        return motion.position

    def _note_margin(self, latch_time: float) -> None:
        for newest, _ in self._stream.newest():
            if newest != self._newest:
                self._newest = newest
                self.margins.append(newest - latch_time)

    def _setpoint_before(self, time: float, now: float) -> Setpoint | None:
        """
        Return the setpoint that one for a time [s] continues; None where it begins a stream.

        Those for later are replaced: one that was stamped ahead holds up none that comes after it.
        """
        newest = self._stream.newest()
        was_set_back = bool(newest) and newest[0][0] > now + EARLIEST  # the clock
        if newest and not was_set_back and time <= min(newest[0][0], self._sampled):
            raise InputError(
                'out_of_order', f'setpoint is meant for {self._sampled - time:.3g} s before '
                'what is commanded already, and later ones are known')
        before, _ = self._stream.around(math.nextafter(time, -math.inf))
        if was_set_back or before is None or now - before[0] > self.settings.stale_after:
            return None
        return before[1]

    def _smooth(self, following: Setpoint) -> None:
        """
        Give the newest setpoint the velocity that it has between its two neighbours.

        Only where the path to it is not being followed yet, and more than a cycle falls between
        setpoints. Mean velocities alone make a jump of acceleration at each setpoint: at 500 Hz
        the jerk limit would hold the carriages back in every third cycle.
        """
        before = self._stream.newest(2)
        if len(before) < 2 or before[0][0] <= self._sampled or (
                following.time - before[1][0] < 1.5 * self._period):
            return
        (_, first), (time, newest) = before
        h, k = time - first.time, following.time - time
        most = 0.5 * self._limiter.limits.acceleration * h  # change within half an interval
        velocity = triple([
            min(max((k / h * (b - a) + h / k * (c - b)) / (h + k), mean - most), mean + most)
            for a, b, c, mean in zip(
                first.position, newest.position, following.position, newest.velocity,
                strict=True)])
        self._stream.append(time, newest._replace(velocity=velocity))

    def _target(self, time: float) -> tuple[Triple, Triple] | None:
        before, after = self._stream.around(time)
        if before is None or (
                after is None and time - before[0] > self.settings.stale_after):
            return None
        if after is None:
            is_confirmed = len(self._stream.newest(2)) == 2
            return extrapolate(before[1], time) if is_confirmed else (before[1].position, ZERO)
        return interpolate(before[1], after[1], time)

    def _follow(
        self, before: CarriageMotion, position: Triple, velocity: Triple
    ) -> CarriageMotion:
        """Go where the target is, as long as there is a path to rest from there."""
        limiter = self._limiter
        if not limiter.keeps(before):
            return self._brake(before)
        limiter.speed = min(limiter.limits.speed, self._fastest_at(before.position))
        direct = limiter.reach(before, position, velocity)
        try:
            motion = direct or limiter.chase(before, position, velocity)
            self._stop = self._checked_stop(limiter, motion)
        except ManipulatorError as error:
            self.last_rejection = str(error)
            return self._brake(before)
        self.activity = Activity.FOLLOWING if direct else Activity.LIMITED
        self.limited_cycles += direct is None
        return motion

    def _checked_stop(
        self, limiter: PathLimiter, motion: CarriageMotion
    ) -> Iterator[PlannedState]:
        """Return the path to rest, or raise why it is not allowed."""
        stop = limiter.stop(motion)
        # first the end, which fails most often; targets are checked once more before the bus
        self._check(*[position for position, _, _ in reversed(stop)], motion.position)
        self._require_slow_near(motion[:3], *stop)
        return iter(stop)

    def _require_slow_near(self, *path: PlannedState) -> None:
        """Reject a path on which a carriage could not stop before a neighbour that stands dead."""
        fastest = max([abs(speed) for _, velocity, _ in path for speed in velocity])
        if fastest <= self._fastest_at(*[position for position, _, _ in path]):
            return  # mostly: no two carriages come near each other
        for position, velocity, _ in path:
            speed, bound = max(map(abs, velocity)), self._fastest_at(position)
            if speed > bound:
                raise SetpointLimitError(
                    'speed of a carriage so near its neighbour', speed, bound, 'm/s', 'above')

    def _brake(self, before: CarriageMotion) -> CarriageMotion:
        """Go on to rest on the path that was checked when the present motion was chosen."""
        state = next(self._stop, None)
        if state is None:
            self.activity = Activity.HOLDING
            return CarriageMotion(before.position)
        self.brakes += self.activity is not Activity.BRAKING
        self.activity = Activity.BRAKING
        return self._limiter.advance(before, state)

    def _require_timely(self, setpoint: Setpoint, now: float) -> None:
        age = now - setpoint.time
        if not age <= OLDEST:
            raise InputError('stale', f'setpoint is {age:.3g} s old, bound {OLDEST:g} s')
        if -age > EARLIEST:
            raise InputError(
                'future', f'setpoint is meant for {-age:.3g} s from now, bound {EARLIEST:g} s')

    def _require_near(self, setpoint: Setpoint, last: Setpoint | None) -> None:
        if self.motion is None:
            raise InputError('inactive', 'setpoint rejected: the driver holds no position')
        start = self.motion.position if last is None else last.position
        for carriage, value, near in zip(CARRIAGES, setpoint.position, start, strict=True):
            if not abs(value - near) <= self.settings.first_step:  # also of a value that is nan
                raise SetpointLimitError(
                    f'the step of {carriage} to the setpoint', abs(value - near),
                    self.settings.first_step, 'm', 'above')

    def _require_feasible(self, setpoint: Setpoint, last: Setpoint | None) -> None:
        """Reject a velocity that no carriage can have, or that the positions contradict."""
        for carriage, value in zip(CARRIAGES, setpoint.velocity, strict=True):
            if not abs(value) <= self._fastest:
                raise SetpointLimitError(
                    f'setpoint velocity of {carriage}', abs(value), self._fastest, 'm/s', 'above')
        if last is None:
            return
        # the mean velocity since the last setpoint, or one that a carriage can reach
        elapsed = setpoint.time - last.time
        backlash = 0.5 * self._hardest * SHORTEST
        bound = max(0.5 * self._hardest * elapsed, backlash)
        for carriage, start, end, before, after in zip(
                CARRIAGES, last.velocity, setpoint.velocity, last.position, setpoint.position,
                strict=True):
            mean = (after - before) / elapsed
            difference, bend = abs(end - mean), abs(0.5 * (start + end) - mean)
            if difference > bound or (difference > backlash and bend > 0.5 * bound):
                raise InputError(
                    'inconsistent', f'setpoint velocity of {carriage} = {end:.4g} m/s, but its '
                    f'positions change by {mean:.4g} m/s, after {start:.4g} m/s: at most '
                    f'{self._hardest:g} m/s^2 are possible')
