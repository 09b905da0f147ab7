"""Buffer of the newest values of a signal, for search and interpolation by time."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from operator import itemgetter
from typing import Any, Generic, TypeVar

Value = TypeVar('Value')
Found = TypeVar('Found')
KEPT_TIME = 2.0  # s, longer than any message is late or early
_time = itemgetter(0)


def linear(
    before: tuple[float, float], after: tuple[float, float], time: float
) -> float:
    """Return the linear interpolation of two items (time, number) at a time [s]."""
    begin, first = before
    end, second = after
    return first + (second - first) * (time - begin) / (end - begin)


class TimedBuffer(Generic[Value, Found]):
    """
    Values at ascending times; each value is kept for `KEPT_TIME`.

    Parameters
    ----------
    between : callable, optional
        Takes the items (time, value) before and after a time [s], and this time. Returns the
        result of `interpolated`. By default the values are numbers and interpolated linearly.

    """

    def __init__(self, between: Callable[[Any, Any, float], Any] = linear) -> None:
        self._items: tuple[tuple[float, Value], ...] = ()
        self._between = between

    def clear(self) -> None:
        """Delete all values."""
        self._items = ()

    def append(self, time: float, value: Value) -> None:
        """Add a value at a time [s], and delete the values at this time and later."""
        items = self._items
        end = bisect_left(items, time, key=_time)
        begin = bisect_left(items, time - KEPT_TIME, key=_time)
        self._items = (*items[begin:end], (time, value))

    def newest(self, count: int = 1) -> tuple[tuple[float, Value], ...]:
        """Return up to `count` of the newest items (time, value)."""
        return self._items[-count:]

    def around(
        self, time: float
    ) -> tuple[tuple[float, Value] | None, tuple[float, Value] | None]:
        """Return the items (time, value) before or at a time [s] and after it; None if missing."""
        items = self._items
        index = bisect_right(items, time, key=_time)
        before = items[index - 1] if index else None
        after = items[index] if index < len(items) else None
        return before, after

    def interpolated(self, time: float) -> Found | None:
        """Return the signal at a time [s]; None unless values exist on both sides of this time."""
        before, after = self.around(time)
        if before is None or after is None:
            return None
        found: Found = self._between(before, after, time)
        return found
