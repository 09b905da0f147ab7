"""
Whether the position that a drive sends is that of its carriage: homed, and steady since.

Positions are counts of the drive, times are on the monotonic clock [s].
"""

from __future__ import annotations

from typing import NamedTuple

from facade_manipulator.drives.cia402 import AxisSettings, METHODS_AT_PRESENT_POSITION

HOME_TOLERANCE = 2  # counts, where the drive takes the present position as home
HOME_NOISE = 0.001  # m, where it looks for a switch or a stop
JUMP_NOISE = 0.001  # m
JUMP_MARGIN = 2.0  # of the acceleration that a carriage is allowed
JUMP_JITTER = 0.5  # of the way since the last answer, for a SYNC that came early or late


class LostPosition(NamedTuple):
    """Why a position can no longer be trusted, to be read after the drive's name; what to do."""

    message: str
    remedy: str


class Encoder:
    """
    The encoder of one axis, as far as it can be trusted.

    Parameters
    ----------
    axis : AxisSettings
    period : float
        Of the cycle [s].

    Attributes
    ----------
    counts : int or None
        The newest position, None before the first.
    homed : bool
    speed : float
        Mean of the time between the last two positions [counts/s].

    """

    def __init__(self, axis: AxisSettings, period: float) -> None:
        self.counts: int | None = None
        self.homed = False
        self.speed = 0.0
        self._axis = axis
        self._period = period
        self._is_trusted = True
        self._time = 0.0
        self._elapsed = period  # between the last two positions [s]
        self._least_jump = abs(axis.counts_per_metre) * _jump_bound(
            axis, period, period)
        self._home = axis.to_counts(axis.home_position)
        self._home_tolerance = _home_tolerance(axis, period)
        self._last_counts = 0  # when the bus was lost
        self._farthest: float | None = None  # m, from there

    def begin_homing(self) -> None:
        """From now on the position is unknown, and what is said of it counts again."""
        self.homed, self._is_trusted = False, True

    def end_homing(self, homed: bool) -> None:
        """Note whether the axis is homed; it is not if its position has been lost meanwhile."""
        self.homed = homed and self._is_trusted
        self.speed = 0.0  # the step to the home position was none of the carriage

    def distrust(self) -> None:
        """Note that the position is lost, until the axis is homed again."""
        self.homed = self._is_trusted = False

    def lose(self, silence: float, velocity: float) -> None:
        """
        Note where the carriage is: the drive goes on for a silence [s], then brakes.

        Positions that came close together show no speed; the drive's own velocity [m/s] does.
        """
        if self.counts is not None and self._farthest is None:
            speed = max(abs(velocity), abs(self._axis.to_metres(self.speed)))
            braking = speed ** 2 / (2.0 * self._axis.stop_deceleration)
            self._farthest = speed * (silence + self._period) + braking + JUMP_NOISE
            self._last_counts = self.counts

    def forget(self) -> None:
        """Let the next position be compared with where the bus was lost, not with the last."""
        self.counts = None

    def receive(self, counts: int, time: float) -> LostPosition | None:
        """
        Receive a position; return what is wrong with it, None if nothing is.

        The speed of a homed carriage must not seem to have changed faster than it can, and after
        a silence it must be where it could have come to rest. Else it is no longer trusted.

        """
        before, self.counts = self.counts, counts
        elapsed, self._time = max(time - self._time, self._period), time
        if before is None:
            self.speed, self._elapsed = 0.0, self._period
            return self._compare_with_last()
        earlier, self._elapsed = self._elapsed, elapsed
        expected, self.speed = self.speed * elapsed, (counts - before) / elapsed
        difference = counts - before - expected
        if not self.homed or abs(difference) <= self._least_jump:
            return None
        jump = abs(self._axis.to_metres(difference))
        bound = (_jump_bound(self._axis, elapsed, earlier)
                 + JUMP_JITTER * abs(self._axis.to_metres(expected)))
        if jump <= bound:
            return None
        self.distrust()
        return LostPosition(
            f': the position has jumped by {jump:.4g} m, bound {bound:.4g} m: it can no longer be '
            'trusted', 'check the encoder and its cable')

    def _compare_with_last(self) -> LostPosition | None:
        farthest, self._farthest = self._farthest, None
        if farthest is None or not self.homed:
            return None
        moved = abs(self._axis.to_metres(self.counts - self._last_counts))
        if moved <= farthest:
            return None
        self.distrust()
        return LostPosition(
            f' is {moved:.4g} m from where it was when the bus was lost, bound {farthest:.4g} m: '
            'its position can no longer be trusted', 'look whether it was pushed')

    def home_error(self) -> float:
        """Return how far the carriage is from its home position [m], 0 if it is there."""
        counts = (self.counts or 0) - self._home
        return self._axis.to_metres(counts) if abs(counts) > self._home_tolerance else 0.0


def _jump_bound(axis: AxisSettings, elapsed: float, earlier: float) -> float:
    """
    Return how far from where its speed leads a carriage may be after a time [m].

    The speed is the mean of an `earlier` time [s].
    """
    acceleration = max(axis.max_acceleration, axis.stop_deceleration)
    return JUMP_NOISE + JUMP_MARGIN * acceleration * 0.5 * (earlier + elapsed) * elapsed


def _home_tolerance(axis: AxisSettings, period: float) -> float:
    """Return how exactly a carriage that is homed stands at its home position [counts]."""
    if axis.homing_method in METHODS_AT_PRESENT_POSITION:
        return HOME_TOLERANCE
    speed = axis.homing_zero_speed
    braking = speed * period + speed ** 2 / (2.0 * axis.homing_acceleration)
    return abs(axis.to_counts(HOME_NOISE + braking))
