"""When messages came, on the clock that nobody sets."""

from __future__ import annotations

import time


class Arrivals:
    """
    Turn receipts by the system's clock into monotonic times, for messages that are taken in turns.

    A message came after the turn before and not later than now: a clock that is set meanwhile puts
    it into no other time.
    """

    def __init__(self) -> None:
        self._now = time.monotonic()
        self.begin()

    def begin(self) -> None:
        """Begin a turn."""
        self._before, self._now = self._now, time.monotonic()
        self._epoch = time.time() - self._now

    def time(self, received: float) -> float:
        """Return the monotonic time of a receipt [s]."""
        return min(max(received - self._epoch, self._before), self._now)
