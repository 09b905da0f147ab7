"""Record of the TPDOs with which one drive answers SYNC, and of missing answers."""

from __future__ import annotations

from math import inf

from facade_manipulator.canopen.pdo import Pdo


class Answers:
    """
    Record of the TPDOs with which one drive answers SYNC.

    An answer is complete when all TPDOs of a SYNC have arrived: following errors of different
    cycles must not be compared. The rate is in cycles per second.
    """

    # s, maximum error between the stamps of a SYNC and its answers
    SYNC_TOLERANCE = 0.001

    def __init__(self, tpdos: tuple[Pdo, ...], rate: int) -> None:
        self._names = [one.name for one in tpdos]
        self._of_every_sync = [one.name for one in tpdos if one.transmission(rate) == 1]
        self.restart()

    def restart(self) -> None:
        """Forget all answers."""
        #: the last SYNC that each TPDO of every SYNC has answered [s]
        self._answered = dict.fromkeys(self._of_every_sync, -inf)
        #: time of the last SYNC that the drive has answered completely [s]
        self.newest = -inf
        self._newest_before = -inf  # at the end of the previous cycle
        #: names of the TPDOs that were never received
        self.silent = set(self._names)
        #: number of SYNCs not answered in time, in total
        self.missed = 0
        #: the same in a row
        self.missed_in_a_row = 0
        #: age of the newest answer [cycles]
        self.cycles_old = 0

    def excuse(self) -> None:
        """Reset the number of consecutive missing answers."""
        self.missed_in_a_row = 0

    def receive(self, name: str, time: float, sync_time: float) -> None:
        """Record a TPDO, its time of reception [s] and the time of the last SYNC [s]."""
        self.silent.discard(name)
        if name in self._answered and time >= sync_time - self.SYNC_TOLERANCE:
            self._answered[name] = sync_time
            if min(self._answered.values()) == sync_time:
                self.newest = sync_time

    def end_cycle(self, sync_time: float) -> None:
        """
        Count a missing answer at the end of the cycle that began with a SYNC.

        An answer after the end of the previous cycle is late, not missing.
        """
        if self.newest == self._newest_before:
            self.missed += 1
            self.missed_in_a_row += 1
        else:
            self.missed_in_a_row = 0
        self._newest_before = self.newest
        is_late = self.newest != sync_time
        self.cycles_old = max(self.missed_in_a_row, int(is_late))
