"""Clocks and sleep for the drive controller; tests pass a simulated clock instead."""

from __future__ import annotations

import time


class Clock:
    """
    Clocks and sleep of this computer.

    The controller reads clocks and sleeps only here, except that the bus waits for frames.
    """

    sleep = staticmethod(time.sleep)
    monotonic = staticmethod(time.monotonic)  #: time on the monotonic clock [s]
    time = staticmethod(time.time)  #: time on the system clock [s]


class SteadyTime:
    """
    Conversion between stamps on the system clock and times on the monotonic clock.

    The system clock may be set at any time. Ages and intervals are therefore computed from times
    on the monotonic clock, to which each stamp is converted when its message arrives. Equal stamps
    have equal times unless the clock was set between them.
    """

    # s, minimum change of the offset that counts; a smaller change is the time between two
    # readings
    OFFSET_TOLERANCE = 2e-4
    # the reading of shortest duration is used, because the thread may be preempted during a
    # reading
    OFFSET_READINGS = 5

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._offset = self._read_offset()

    def from_stamp(self, stamp: float) -> float:
        """Convert a stamp on the system clock [s] to a time on the monotonic clock [s]."""
        return stamp - self._present_offset()

    def to_stamp(self, time: float) -> float:
        """Convert a time on the monotonic clock [s] to a stamp on the system clock [s]."""
        return time + self._present_offset()

    def _present_offset(self) -> float:
        """Return the system clock minus the monotonic clock [s]."""
        offset = self._clock.time() - self._clock.monotonic()
        if abs(offset - self._offset) > self.OFFSET_TOLERANCE:
            self._offset = self._read_offset()
        return self._offset

    def _read_offset(self) -> float:
        """Return the offset between both clocks [s] from the reading of shortest duration."""
        readings = []
        for _ in range(self.OFFSET_READINGS):
            before = self._clock.monotonic()
            stamp = self._clock.time()
            after = self._clock.monotonic()
            readings.append((after - before, stamp - 0.5 * (before + after)))

        return min(readings)[1]
