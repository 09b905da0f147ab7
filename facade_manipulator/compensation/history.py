"""The last values of a course, to be looked up by their time."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque

KEPT_TIME = 2.0


class History:
    """
    Values at ascending times, interpolated linearly.

    Parameters
    ----------
    kept_time : float
        For how long values are kept [s].

    """

    def __init__(self, kept_time: float = KEPT_TIME) -> None:
        self._kept_time = kept_time
        self._items: deque[tuple[float, float]] = deque()

    def add(self, time: float, value: float) -> None:
        """Add the value at a time [s] later than all before; an earlier one begins again."""
        if self._items and time <= self._items[-1][0]:
            self._items.clear()
        self._items.append((time, value))
        while self._items[0][0] < time - self._kept_time:
            self._items.popleft()

    def at(self, time: float, unknown: float) -> float:
        """Return the value at a time [s], the last one later, `unknown` before the first."""
        index = bisect_right(self._items, time, key=lambda item: item[0])
        if index == 0:
            return unknown
        if index == len(self._items):
            return self._items[-1][1]
        (begin, a), (end, b) = self._items[index - 1], self._items[index]
        return a + (b - a) * (time - begin) / (end - begin)
