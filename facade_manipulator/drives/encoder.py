"""
Encoder position of one drive, its speed, and the detection of encoder faults.

A carriage cannot change its speed faster than its drive allows. Each position is compared with the
position that the last speed predicts. The difference is a *jump*:

- A jump above its bound shows at once that the encoder has slipped.
- Smaller jumps above half of the bound are added up. The sum since the drive has found home also
  has a limit.

Jump and sum are checked only while the axis is homed, or while its drive has found home and other
axes are still homing.
"""

from __future__ import annotations

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.errors import compared


class Encoder:
    """Encoder position of one axis; the period is the time between two SYNC messages [s]."""

    JUMP_NOISE = 0.001  # m
    JUMP_MARGIN = 2.0  # times the permitted acceleration of a carriage
    JUMP_JITTER = 0.5  # of the way since the last answer, for an early or late SYNC
    TOO_SOON = 0.5  # of the period: closer positions show no speed
    DOUBTFUL = 0.5  # of the bound: noise, jitter and acceleration cause smaller jumps
    # m, sum of doubtful jumps: half of the default geometry.carriage_gap
    MOST_SLIPPED = 0.01

    def __init__(self, axis: AxisSettings, period: float) -> None:
        #: the newest position, None before the first
        self.counts: int | None = None
        #: mean speed between the last two positions [m/s]
        self.speed = 0.0
        #: whether the position is that of the carriage
        self.homed = False
        self._metres = axis.to_metres(1.0)  # per count
        self._acceleration = max(axis.max_acceleration, axis.stop_deceleration)
        self._period = period
        self._compared: int | None = None  # counts with which the next are compared
        self._time = 0.0  # of these counts [s]
        self._elapsed = period  # from their predecessor to them [s]
        self._slipped = 0.0  # sum of doubtful jumps since home was found [m]
        self._is_trusted = True
        self._has_found_home = False
        self._is_speed_valid = True  # not if a drive has changed its coordinates

    def begin_homing(self) -> None:
        """Clear the home position and earlier encoder errors, and trust the encoder again."""
        self.homed = False
        self._has_found_home = False
        self._is_trusted = True
        self._slipped = 0.0

    def find_home(self) -> None:
        """Record that the drive has found home; positions are checked from now on."""
        if not self._has_found_home:
            self._has_found_home = True
            self._is_speed_valid = False
            self._slipped = 0.0

    def end_homing(self, homed: bool) -> None:
        """Record whether the axis is homed, unless its position was lost during homing."""
        self.homed = homed and self._is_trusted
        self._has_found_home = False

    def distrust(self) -> None:
        """
        Mark the position as lost until the axis is homed again.

        The reason is a jump, a restart, an error of the drive, silence, a lost bus, or a drive
        whose objects differ from the configuration.
        """
        self.homed = False
        self._is_trusted = False
        self._has_found_home = False

    def receive(self, counts: int, time: float) -> str:
        """
        Receive a position [counts] at a time [s].

        Return why the position is lost from now on, ``''`` if its validity has not changed.
        """
        self.counts = counts
        before = self._compared
        if (
            before is not None
            and 0.0 <= time - self._time < self.TOO_SOON * self._period
        ):
            return ''  # the answer to a second SYNC: the next position is compared with the first
        elapsed = max(time - self._time, self._period)
        self._compared = counts
        self._time = time
        if before is None:
            self._elapsed = self._period
            self.speed = 0.0
            return ''

        expected = self.speed * elapsed
        moved = self._metres * (counts - before)
        bound = self._jump_bound(expected, elapsed)
        self._elapsed = elapsed
        self.speed = moved / elapsed
        if not self._is_speed_valid:
            self._is_speed_valid = True
            return ''
        return self._judge(abs(moved - expected), bound)

    def _jump_bound(self, expected: float, elapsed: float) -> float:
        """
        Return the largest position jump that a working encoder can show [m].

        Both speeds are means over their intervals, so that they may differ by the acceleration
        during the mean of both intervals.
        """
        interval = 0.5 * (self._elapsed + elapsed)
        accelerated = self._acceleration * interval * elapsed
        return (
            self.JUMP_NOISE
            + self.JUMP_MARGIN * accelerated
            + self.JUMP_JITTER * abs(expected)
        )

    def _judge(self, jump: float, bound: float) -> str:
        """Return the reason why a jump [m] makes the position invalid, or ``''``."""
        if jump > self.DOUBTFUL * bound:
            self._slipped += jump
        if not self.homed and not self._has_found_home:
            return ''
        if jump > bound:
            jump_text, limit = compared(jump, bound, '.4g', 4)
            failure = f'has jumped by {jump_text} m, above the limit {limit} m'
        elif self._slipped > self.MOST_SLIPPED:
            slip, limit = compared(self._slipped, self.MOST_SLIPPED, '.4g')
            failure = f'has slipped by {slip} m in total since homing, above the limit {limit} m'
        else:
            return ''
        self.distrust()
        return f'{failure}: its position is no longer valid'
