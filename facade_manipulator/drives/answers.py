"""Which of a drive's TPDOs have come, and how many SYNCs it has not answered."""

from __future__ import annotations

import math

from facade_manipulator.canopen.pdo import Pdo
from facade_manipulator.drives.bus_load import transmission_type

SYNC_TOLERANCE = 0.001  # s, by which stamps of a SYNC and its answers may be out
EVERY_SYNC = 1


class Answers:
    """
    The answers of one drive, complete with all TPDOs that come with each SYNC.

    Following errors of different cycles would compare badly. The rate is in cycles per second.
    """

    def __init__(self, tpdos: tuple[Pdo, ...], rate: int) -> None:
        self._names = frozenset(one.name for one in tpdos)
        self._needed = frozenset(
            one.name for one in tpdos if transmission_type(one, rate) == EVERY_SYNC)
        self._unanswered: set[str] = set()  # of these, to the newest SYNC
        #: `newest`: when the last SYNC was sent that the drive has answered in full [s]
        self._sync_time = self.newest = self._before = -math.inf
        #: which TPDOs have not come yet since supervision has begun
        self.silent: set[str] = set()
        self._is_late = False
        #: SYNCs that were not answered in time, in all and up to now
        self.missed = self.missed_in_a_row = 0

    @property
    def cycles_old(self) -> int:
        """How many cycles before the last one the newest answer belongs to."""
        return max(self.missed_in_a_row, int(self._is_late))

    def begin_supervision(self) -> None:
        """From now on what is missing counts."""
        self.missed_in_a_row = 0
        self._before = self.newest
        self.silent = set(self._names)

    def receive(self, name: str, time: float, sync_time: float) -> None:
        """Note a TPDO that came at a time [s], and when the last SYNC before it was sent."""
        self.silent.discard(name)
        if time < sync_time - SYNC_TOLERANCE:
            return
        if sync_time != self._sync_time:
            self._sync_time, self._unanswered = sync_time, set(self._needed)
        self._unanswered.discard(name)
        if not self._unanswered:
            self.newest = sync_time

    def end_cycle(self, sync_time: float) -> None:
        """
        Count an answer that is missing at the end of the cycle of a SYNC.

        One that came after the end of the cycle before is late, not missing.
        """
        self._is_late = self.newest != sync_time
        if self.newest != self._before:
            self._before, self.missed_in_a_row = self.newest, 0
        else:
            self.missed += 1
            self.missed_in_a_row += 1
