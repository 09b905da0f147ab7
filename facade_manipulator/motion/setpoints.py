"""
The driver's view of the setpoint stream: checked on arrival, interpolated and limited each cycle.

Setpoints carry the instant they are meant for. Between two of them the carriages follow a cubic
curve, shortly beyond the newest one its velocity, and after that they brake and hold: a stream
that falls silent never moves anything. The velocity at a setpoint is its sender's until later ones
are known: then it becomes the one that leaves no jump in the acceleration.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Callable
import enum
import math
from threading import Lock
from typing import NamedTuple

from facade_manipulator.errors import (
    InputError,
    ManipulatorError,
    ParameterError,
    SetpointLimitError,
)
from facade_manipulator.kinematics import Carriages
from facade_manipulator.motion.limits import Motion, MotionLimits, PathLimiter, Triple
from facade_manipulator.motion.spline import inner_slopes
from facade_manipulator.parameters import parameter, settings

CARRIAGES = Carriages._fields
KEPT_MARGINS = 1000
MOST_SMOOTHED = 5  # setpoints at once: each further one has a quarter of the effect


class Setpoint(NamedTuple):
    """Where the carriages should be at a time [s], in m, and how fast, in m/s."""

    time: float
    position: Triple
    velocity: Triple


class Knot(NamedTuple):
    """A setpoint on the course: the velocity with which it is passed, and the sender's own."""

    time: float
    position: Triple
    velocity: Triple
    told: Triple


@settings
class StreamSettings:
    """How old, how early and how far a setpoint may be."""

    stale_after: float = parameter(
        0.1, 'Silence after which the carriages brake and hold', unit='s',
        minimum=0.01, maximum=1.0)
    oldest: float = parameter(
        0.2, 'Age beyond which a setpoint is rejected', unit='s', minimum=0.01, maximum=2.0)
    earliest: float = parameter(
        1.0, 'How far in the future a setpoint may be meant', unit='s', minimum=0.01, maximum=10.0)
    first_step: float = parameter(
        0.05, 'How far from the carriages a stream may begin or jump', unit='m',
        minimum=0.001, maximum=0.5)

    def __post_init__(self) -> None:
        if self.stale_after > self.oldest:
            raise ParameterError(
                f'stale_after = {self.stale_after:g} s is above oldest = {self.oldest:g} s: '
                'a stream would be rejected before it counts as silent')


class Activity(enum.Enum):
    """What the carriages are doing."""

    HOLDING = 'holding'
    FOLLOWING = 'following'
    LIMITED = 'limited'
    BRAKING = 'braking'


class SetpointFollower:
    """
    Turn a stream of setpoints into one commanded position per cycle.

    `add` runs in the thread that receives the stream, everything else in the control thread;
    what they share, the stream and the commanded motion, is immutable and replaced whole.

    Parameters
    ----------
    settings : StreamSettings
    limits : MotionLimits
    period : float
        Time between two cycles [s].
    check : callable
        Takes carriage positions, shape (3,) [m], and raises a ManipulatorError where the
        mechanism cannot or must not be.

    Attributes
    ----------
    limited_cycles, brakes : int
        Cycles in which the limits held the carriages back; how often they had to brake.
    last_refusal : str
        Why they last braked although the stream went on.
    margins : deque of float
        How early the last setpoints were when first used: their time less the commanded one [s].

    """

    def __init__(
        self, settings: StreamSettings, limits: MotionLimits, period: float,
        check: Callable[[Triple], None],
    ) -> None:
        self.settings = settings
        self.limited_cycles = 0
        self.brakes = 0
        self.last_refusal = ''
        self.margins: deque[float] = deque(maxlen=KEPT_MARGINS)
        self._period = period
        self.change_limits(limits)
        self._check = check
        self._motion: Motion | None = None
        self._stream: tuple[Knot, ...] = ()
        self._writing = Lock()
        self._sampled = self._newest = -math.inf
        self._activity = Activity.HOLDING

    @property
    def activity(self) -> Activity:
        """What the carriages are doing."""
        return self._activity

    @property
    def motion(self) -> Motion | None:
        """The commanded motion; None before the first `reset`."""
        return self._motion

    @property
    def at_rest(self) -> bool:
        """Tell whether the commanded motion is at rest."""
        return self._motion is None or self._motion.at_rest

    def change_limits(self, limits: MotionLimits) -> None:
        """Keep other limits from the next cycle on; beyond new ones the carriages slow down."""
        self._limiter = PathLimiter(limits, self._period)

    def reset(self, positions: Triple) -> None:
        """Hold at measured positions [m] and forget the stream."""
        self.hold()
        self._motion = Motion(tuple(positions))
        self._activity = Activity.HOLDING

    def hold(self) -> None:
        """Brake to rest and forget the stream."""
        with self._writing:
            self._stream = ()

    def add(self, setpoint: Setpoint, now: float) -> None:
        """
        Take a setpoint into the stream.

        Parameters
        ----------
        setpoint : Setpoint
        now : float
            Present time on the setpoint's clock [s].

        Raises
        ------
        InputError
            Not finite, stale, in the future, out of order, or nothing is held yet.
        ManipulatorError
            What `check` raises, or SetpointLimitError for a jump.

        """
        self._require_finite(setpoint)
        self._check(setpoint.position)
        with self._writing:
            stream = self._current_stream(now)
            self._require_timely(setpoint, now, stream)
            self._require_near(setpoint, stream)
            self._stream = self._smoothed((*stream, Knot(*setpoint, setpoint.velocity)))

    def sample(self, latch_time: float) -> Triple:
        """
        Return the positions to command so that the carriages are there at `latch_time`.

        Parameters
        ----------
        latch_time : float
            When the drives will have reached the command, on the setpoints' clock [s].

        Returns
        -------
        tuple of float, shape (3,)
            Positions [m] inside the motion limits.

        Raises
        ------
        ManipulatorError
            Even braking leaves what the mechanism can do; or `reset` was never called.

        """
        if self._motion is None:
            raise InputError('no_position', 'no carriage position is known yet: reset first')
        self._note_margin(latch_time)
        self._sampled = latch_time
        target = self._target(latch_time)
        motion = self._brake() if target is None else self._follow(*target)
        self._motion = motion
        return motion.position

    def _note_margin(self, latch_time: float) -> None:
        newest = self._stream[-1].time if self._stream else self._newest
        if newest != self._newest:
            self._newest = newest
            self.margins.append(newest - latch_time)

    def _current_stream(self, now: float) -> tuple[Knot, ...]:
        """Return what is still of use: nothing of a silent stream, one point before now."""
        stream = self._stream
        if not stream or now - stream[-1].time > self.settings.stale_after:
            return ()
        passed = bisect_right(stream, min(self._sampled, now), key=lambda item: item.time)
        return stream[max(0, passed - 1):]

    def _smoothed(self, stream: tuple[Knot, ...]) -> tuple[Knot, ...]:
        """Choose velocities without a jump of acceleration, beyond what is being followed."""
        if len(stream) < 3 or stream[-1].time - stream[-2].time < 1.5 * self._period:
            return stream  # hardly a cycle falls between setpoints
        passed = bisect_right(stream, self._sampled, key=lambda item: item.time)
        begin = max(passed, len(stream) - MOST_SMOOTHED)
        ahead = stream[begin:]
        if len(ahead) < 3:
            return stream
        times, positions, velocities, _ = zip(*ahead, strict=True)
        slopes = inner_slopes(times, positions, velocities[0], velocities[-1])
        inner = [
            Knot(knot.time, knot.position,
                 self._near(knot.told, slope, knot.time - before.time), knot.told)
            for before, knot, slope in zip(ahead, ahead[1:-1], slopes, strict=False)]
        return (*stream[:begin + 1], *inner, stream[-1])

    def _near(self, told: Triple, wanted: Triple, interval: float) -> Triple:
        """
        Return a wanted velocity as far from the one told as the acceleration may have led.

        Senders tell the mean velocity since the setpoint before.
        """
        most = 0.5 * self._limiter.limits.acceleration * interval
        return tuple([
            min(max(v, t - most), t + most) for v, t in zip(wanted, told, strict=True)])

    def _target(self, time: float) -> tuple[Triple, Triple] | None:
        stream = self._stream
        if not stream or time - stream[-1].time > self.settings.stale_after:
            return None
        index = bisect_right(stream, time, key=lambda item: item.time)
        if index == 0:
            return None
        if index == len(stream):
            return _extrapolate(stream[-1], time)
        return _interpolate(stream[index - 1], stream[index], time)

    def _follow(self, position: Triple, velocity: Triple) -> Motion:
        direct = self._limiter.reach(self._motion, position, velocity)
        motion = direct or self._limiter.chase(self._motion, position, velocity)
        try:
            self._check(self._limiter.rest_position(motion))
            self._check(motion.position)  # last: whoever sends it has it checked once more
        except ManipulatorError as error:
            self.last_refusal = str(error)
            return self._brake()
        self._activity = Activity.FOLLOWING if direct else Activity.LIMITED
        self.limited_cycles += direct is None
        return motion

    def _brake(self) -> Motion:
        if self._motion.at_rest:
            self._activity = Activity.HOLDING
            return Motion(self._motion.position)
        self.brakes += self._activity is not Activity.BRAKING
        self._activity = Activity.BRAKING
        motion = self._limiter.brake(self._motion)
        self._check(motion.position)
        return motion

    def _require_finite(self, setpoint: Setpoint) -> None:
        if all(map(math.isfinite, setpoint.position + setpoint.velocity)):
            return
        for name, values, unit in (
            ('position', setpoint.position, 'm'), ('velocity', setpoint.velocity, 'm/s'),
        ):
            for carriage, value in zip(CARRIAGES, values, strict=True):
                if not math.isfinite(value):
                    raise InputError.not_finite(f'setpoint {name} of {carriage}', value, unit)

    def _require_timely(
        self, setpoint: Setpoint, now: float, stream: tuple[Knot, ...]
    ) -> None:
        age = now - setpoint.time
        if not age <= self.settings.oldest:
            raise InputError(
                'stale', f'setpoint is {age:.3g} s old, bound {self.settings.oldest:g} s')
        if -age > self.settings.earliest:
            raise InputError(
                'future', f'setpoint is meant for {-age:.3g} s from now, '
                f'bound {self.settings.earliest:g} s')
        newest = stream[-1].time if stream else -math.inf
        if setpoint.time <= newest:
            raise InputError(
                'out_of_order', f'setpoint is {newest - setpoint.time:.3g} s earlier than '
                'the one before it, or of the same time')

    def _require_near(self, setpoint: Setpoint, stream: tuple[Knot, ...]) -> None:
        if self._motion is None:
            raise InputError('inactive', 'setpoint rejected: the driver holds no position')
        start = stream[-1].position if stream else self._motion.position
        for carriage, value, near in zip(CARRIAGES, setpoint.position, start, strict=True):
            if abs(value - near) > self.settings.first_step:
                raise SetpointLimitError(
                    f'the step of {carriage} to the setpoint', abs(value - near),
                    self.settings.first_step, 'm', 'above')


def _extrapolate(last: Knot, time: float) -> tuple[Triple, Triple]:
    ahead = time - last.time
    position = tuple(
        p + ahead * v for p, v in zip(last.position, last.velocity, strict=True))
    return position, last.velocity


def _interpolate(a: Knot, b: Knot, time: float) -> tuple[Triple, Triple]:
    """Evaluate the cubic Hermite curve from a to b and its derivative."""
    h = b.time - a.time
    u = (time - a.time) / h
    w = 1.0 - u
    h00, h01 = w * w * (1.0 + 2.0 * u), u * u * (1.0 + 2.0 * w)
    h10, h11 = u * w * w * h, -u * u * w * h
    slope, g10, g11 = 6.0 * u * w / h, w * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)
    axes = list(zip(a.position, b.position, a.velocity, b.velocity, strict=True))
    position = tuple(h00 * p + h01 * q + h10 * v + h11 * w_ for p, q, v, w_ in axes)
    velocity = tuple(slope * (q - p) + g10 * v + g11 * w_ for p, q, v, w_ in axes)
    return position, velocity
