"""
Position that a drive sends: its speed, and the detection of encoder faults.

A carriage cannot change its speed faster than its drive allows. A faster change shows that the
encoder has slipped.
"""

from __future__ import annotations

from facade_manipulator.drives.axis_settings import AxisSettings

JUMP_NOISE = 0.001  # m
JUMP_MARGIN = 2.0  # of the acceleration that a carriage is allowed
JUMP_JITTER = 0.5  # of the way since the last answer, for an early or late SYNC
TOO_SOON = 0.5  # of the period: closer positions show no speed
DOUBTFUL = 0.5  # of the bound: noise, jitter and acceleration cause smaller jumps
MOST_SLIPPED = (
    0.01  # m, sum of doubtful jumps since homing: half the distance that carriages keep
)


class Encoder:
    """Position of one axis; the period is the time between two SYNCs [s]."""

    def __init__(self, axis: AxisSettings, period: float) -> None:
        #: the newest position, None before the first
        self.counts: int | None = None
        #: mean speed between the last two positions [m/s]
        self.speed = 0.0
        #: whether the position is that of the carriage
        self.homed = False
        self._metres = axis.to_metres(1.0)
        self._compared: int | None = (
            None  # the position that the next one is compared with
        )
        self._acceleration = max(axis.max_acceleration, axis.stop_deceleration)
        self._period = self._elapsed = period
        self._time = self._slipped = 0.0
        self._is_trusted = True
        self._has_found_home = False
        self._is_speed_valid = True  # not if a drive has changed its coordinates

    def begin_homing(self) -> None:
        """Forget the home position and the errors of earlier positions."""
        self.homed = self._has_found_home = False
        self._is_trusted = True
        self._slipped = 0.0

    def find_home(self) -> None:
        """Record that the drive has found home, after which its positions are judged."""
        if not self._has_found_home:
            self._has_found_home = True
            self._is_speed_valid = False
            self._slipped = 0.0

    def end_homing(self, homed: bool) -> None:
        """Record whether the axis is homed, unless its position was lost during homing."""
        self.homed = homed and self._is_trusted
        self._has_found_home = False

    def distrust(self) -> None:
        """Record that the position is lost until the axis is homed again."""
        self.homed = self._is_trusted = self._has_found_home = False

    def receive(self, counts: int, time: float) -> str:
        """Receive a position [counts] at a time [s]; return why it is distrusted, or ``''``."""
        self.counts = counts
        if (
            self._compared is not None
            and 0.0 <= time - self._time < TOO_SOON * self._period
        ):
            return ''  # the answer to a second SYNC: the next position is compared with the first
        before, self._compared = self._compared, counts
        elapsed, self._time = max(time - self._time, self._period), time
        if before is None:
            self.speed, self._elapsed = 0.0, self._period
            return ''
        earlier, self._elapsed = self._elapsed, elapsed
        moved, expected = self._metres * (counts - before), self.speed * elapsed
        self.speed = moved / elapsed
        jump = abs(moved - expected)
        if not self._is_speed_valid:
            self._is_speed_valid = True
            return ''
        bound = (  # of mean speeds
            JUMP_NOISE
            + JUMP_MARGIN * self._acceleration * 0.5 * (earlier + elapsed) * elapsed
            + JUMP_JITTER * abs(expected)
        )
        self._slipped += jump if jump > DOUBTFUL * bound else 0.0
        is_judged = self.homed or self._has_found_home
        if not is_judged or (jump <= bound and self._slipped <= MOST_SLIPPED):
            return ''
        self.distrust()
        distrust = (
            f'has jumped by {jump:.4g} m, above the limit {bound:.4g} m'
            if jump > bound
            else f'has slipped by {self._slipped:.4g} m in all since homing, '
            f'above the limit {MOST_SLIPPED:g} m'
        )
        return f'{distrust}: it can no longer be trusted'
