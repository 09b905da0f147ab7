"""
The cycle's clock: when SYNC is due, when the answers are complete, when it is too late to command.

Pure: times on the monotonic clock [s] come in as arguments. SYNC is sent by the kernel, and then
only heard here, or by the control loop. A cycle is one SYNC, the answers to it, and one step.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import NamedTuple

ANSWERS_DUE = 0.7  # of the period after SYNC: do not wait longer for the drives' answers
COMMANDS_DUE = 0.8  # later commands might meet the next SYNC on the wire
SYNC_OVERDUE = 1.5
SYNC_TOO_EARLY = 0.5
PATIENCE = 1.0  # of the period: how much longer when frames are still waiting to be read
LATENESS_BOUNDS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)


class CycleStatistics(NamedTuple):
    """
    Counters of the cycle.

    Attributes
    ----------
    cycles : int
        SYNCs answered by a step of the control loop.
    incomplete : int
        Cycles in which a drive's answer was missing.
    late : int
        Cycles whose commands came too late and were not sent: the drives held one point.
    skipped : int
        Periods that passed without a SYNC.
    stray : int
        SYNCs that came too early to be the kernel's: somebody else sends them.
    lateness : tuple of int
        Histogram of the time from SYNC to the step: one bin below each of LATENESS_BOUNDS [s],
        one beyond the last.
    worst : float
        Longest time from SYNC to the step [s].

    """

    cycles: int = 0
    incomplete: int = 0
    late: int = 0
    skipped: int = 0
    stray: int = 0
    lateness: tuple[int, ...] = (0,) * (len(LATENESS_BOUNDS) + 1)
    worst: float = 0.0


class CycleClock:
    """
    Timing of the cycle.

    Parameters
    ----------
    period : float
        Time between two SYNCs [s].
    hears_sync : bool
        Whether the kernel sends SYNC; then the loop sends one only when the kernel's is overdue.

    """

    def __init__(self, period: float, hears_sync: bool) -> None:
        self.period = period
        self.hears_sync = hears_sync
        self.sync_time = 0.0
        self.sync_stamp = 0.0
        self.late_in_a_row = 0
        self.overdue_in_a_row = 0
        self._open = False
        self._next_sync = 0.0
        self._cycles = self._incomplete = self._late = self._skipped = self._stray = 0
        self._bins = [0] * (len(LATENESS_BOUNDS) + 1)
        self._worst = 0.0

    @property
    def statistics(self) -> CycleStatistics:
        """Counters since the start."""
        return CycleStatistics(
            self._cycles, self._incomplete, self._late, self._skipped, self._stray,
            tuple(self._bins), self._worst)

    @property
    def is_open(self) -> bool:
        """Tell whether the step of the newest SYNC is still to come."""
        return self._open

    def start(self, now: float) -> None:
        """Expect the first SYNC from now on."""
        self.sync_time = now
        self._next_sync = now + (SYNC_OVERDUE * self.period if self.hears_sync else 0.0)
        self._open = False

    def next_event(self) -> float:
        """Return when something is due by itself at the latest."""
        answers = self.sync_time + ANSWERS_DUE * self.period
        return min(self._next_sync, answers) if self._open else self._next_sync

    def sync_due(self, now: float, all_read: bool) -> bool:
        """
        Tell whether the loop must send SYNC.

        While received frames wait to be read (`all_read` false), the kernel's SYNC may be among
        them.

        """
        patience = PATIENCE * self.period if self.hears_sync and not all_read else 0.0
        return now >= self._next_sync + patience

    def is_stray(self, time: float) -> bool:
        """Tell whether a SYNC of a time is too early; the pace of the targets hangs on it."""
        stray = time < self.sync_time + SYNC_TOO_EARLY * self.period
        self._stray += stray
        return stray

    def begin(self, time: float, stamp: float, heard: bool) -> None:
        """Begin a cycle with the SYNC of a time, on the system clock `stamp`."""
        if self.hears_sync:
            self.overdue_in_a_row = 0 if heard else self.overdue_in_a_row + 1
            self._skipped += not heard
            self._next_sync = time + SYNC_OVERDUE * self.period
        else:
            self._skipped += max(0, int((time - self._next_sync) / self.period))
            self._next_sync = max(  # keep the phase, but never squeeze a cycle to catch up
                self._next_sync + self.period, time + COMMANDS_DUE * self.period)
        self.sync_time, self.sync_stamp = time, stamp
        self._open = True

    def step_due(self, now: float, all_fresh: bool, all_read: bool) -> bool:
        """Tell whether to step: every drive has answered, or there is no more time to wait."""
        if not self._open:
            return False
        patience = 0.0 if all_read else (COMMANDS_DUE - ANSWERS_DUE) * self.period
        return all_fresh or now >= self.sync_time + ANSWERS_DUE * self.period + patience

    def finish(self, now: float, all_fresh: bool) -> bool:
        """Close the cycle at its step; return whether commands still come in time."""
        age = now - self.sync_time
        in_time = age <= COMMANDS_DUE * self.period
        self._open = False
        self._cycles += 1
        self._incomplete += not all_fresh
        self._late += not in_time
        self.late_in_a_row = 0 if in_time else self.late_in_a_row + 1
        self._bins[bisect_right(LATENESS_BOUNDS, age)] += 1
        self._worst = max(self._worst, age)
        return in_time
