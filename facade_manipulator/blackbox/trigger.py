"""When a file of the black box is due: some seconds after something stopped the machine."""

from __future__ import annotations

import math


class RecordTrigger:
    """
    Collect the reasons for a file until it is due.

    A reason that has just been recorded does not make another file before what the first one
    holds is past: a fault that comes and goes must not push older files off the disk. A file goes
    on for `aftermath` [s] after its first reason; a reason is recorded again after `pause` [s].
    """

    def __init__(self, aftermath: float, pause: float) -> None:
        self._aftermath, self._pause = aftermath, pause
        self._present: dict[str, str] = {}
        self._recorded: dict[str, float] = {}
        self._reasons: list[str] = []
        self._due = math.inf

    def watch(self, now: float, source: str, reason: str) -> None:
        """
        Note what a source says at a time [s]: why the machine stops, or '' while nothing does.

        A reason counts when it comes; what it says afterwards, with other numbers, does not.
        """
        was = self._present.get(source)
        self._present[source] = reason
        if reason and not was and now - self._recorded.get(source, -math.inf) >= self._pause:
            self._recorded[source] = now
            self._reasons.append(f'{source}: {reason}')
            self._due = min(self._due, now + self._aftermath)

    def due(self, now: float) -> tuple[str, ...]:
        """Return why a file is due at this time [s]; nothing if none is."""
        if now < self._due:
            return ()
        reasons, self._reasons, self._due = self._reasons, [], math.inf
        return tuple(reasons)
