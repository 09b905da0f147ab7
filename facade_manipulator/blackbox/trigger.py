"""When a file of the black box is due: some seconds after something stopped the machine."""

from __future__ import annotations

import math
from typing import NamedTuple

from facade_manipulator.errors import without_numbers

RETRY_AFTER = 5.0  # s, until a disk that took nothing is tried again
REST = 20.0  # times what a file took to write, before it is written again: 5 % of a processor


class DueFile(NamedTuple):
    """A file to be written."""

    reasons: tuple[str, ...]
    first: float  #: when the first of them came [s]


class RecordTrigger:
    """
    Collect the reasons for a file until it is due.

    A file begins `duration` [s] before its first reason and goes on for `aftermath` [s] after its
    last. Reasons whose times overlap share one: what comes within `duration` of the first makes
    it due again, with all of them, so that a fault that comes and goes pushes no older files off
    the disk. A reason that differs in numbers alone is named once.
    """

    def __init__(self, duration: float, aftermath: float) -> None:
        self._duration, self._aftermath = duration, aftermath
        self._present: dict[str, str] = {}
        self._reasons: dict[str, str] = {}
        self._first = -math.inf
        self._due, self._rest = math.inf, -math.inf

    @property
    def reasons(self) -> tuple[str, ...]:
        """The reasons for a file that is due, or will be."""
        return tuple(self._reasons.values()) if self._due < math.inf else ()

    def watch(self, now: float, source: str, reason: str) -> bool:
        """
        Note what a source says at a time [s]: why the machine stops, or '' while nothing does.

        Return whether that is a new reason; what it goes on saying, with other numbers, is not.
        """
        kind = without_numbers(reason)
        is_new = bool(kind) and kind != self._present.get(source)
        self._present[source] = kind
        if is_new:
            if self._due == math.inf and now > self._first + self._duration:
                self._first, self._reasons = now, {}
            self._reasons.setdefault(f'{source}: {kind}', f'{source}: {reason}')
            self._due = min(self._due, max(now + self._aftermath, self._rest))
        return is_new

    def due(self, now: float) -> DueFile | None:
        """Return the file that is due at this time [s], if one is."""
        if not self.reasons or now < self._due:
            return None
        due = DueFile(self.reasons, self._first)
        self._due = math.inf
        return due

    def again(self, now: float, due: DueFile) -> None:
        """Note that a file could not be written: it is tried again."""
        if due.first == self._first:
            self._due = min(self._due, now + self._aftermath + RETRY_AFTER)

    def rest(self, now: float, took: float) -> None:
        """Note that a file was written and how long that took [s]."""
        self._rest = now + REST * took
