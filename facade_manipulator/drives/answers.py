"""TPDOs that a drive has sent, and the number of SYNCs that it has not answered."""

from __future__ import annotations

import math

from facade_manipulator.canopen.pdo import Pdo

SYNC_TOLERANCE = 0.001  # s, maximum error between the stamps of a SYNC and its answers


class Answers:
    """
    Answers of one drive, complete when all TPDOs of each SYNC have arrived.

    Following errors of different cycles must not be compared. The rate is in cycles per second.
    """

    def __init__(self, tpdos: tuple[Pdo, ...], rate: int) -> None:
        self._names = frozenset(one.name for one in tpdos)
        self._needed = frozenset(
            one.name for one in tpdos if one.transmission(rate) == 1)  # with every SYNC
        self._received: set[str] = set()  # since the newest SYNC
        #: `newest`: time of the last SYNC that the drive has answered completely [s]
        self._sync_time = self.newest = self._before = -math.inf
        #: names of the TPDOs not received since the begin of supervision
        self.silent: set[str] = set()
        #: number of SYNCs not answered in time, total and in a row
        self.missed = self.missed_in_a_row = 0
        #: age of the newest answer [cycles]
        self.cycles_old = 0

    def begin_supervision(self) -> None:
        """Count missing answers from now on."""
        self.missed_in_a_row = 0
        self._before = self.newest
        self.silent = set(self._names)

    def receive(self, name: str, time: float, sync_time: float) -> None:
        """Record a TPDO with its time [s] and the time of the last SYNC [s]."""
        self.silent.discard(name)
        if time < sync_time - SYNC_TOLERANCE:
            return
        if sync_time != self._sync_time:
            self._sync_time = sync_time
            self._received.clear()
        self._received.add(name)
        if self._received >= self._needed:
            self.newest = sync_time

    def end_cycle(self, sync_time: float) -> None:
        """
        Count an answer that is missing at the end of the cycle of a SYNC.

        An answer after the end of the previous cycle is late, not missing.
        """
        if self.newest != self._before:
            self._before, self.missed_in_a_row = self.newest, 0
        else:
            self.missed += 1
            self.missed_in_a_row += 1
        self.cycles_old = max(self.missed_in_a_row, int(self.newest != sync_time))
