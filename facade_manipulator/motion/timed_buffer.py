"""Buffer of the newest values of a signal, searched by time."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from operator import itemgetter
from typing import Generic, TypeVar

Value = TypeVar('Value')
KEPT_TIME = 2.0  # s, longer than any message is late or early
_time = itemgetter(0)


class TimedBuffer(Generic[Value]):
    """Values at ascending times, each kept for `KEPT_TIME`."""

    def __init__(self) -> None:
        self._items: tuple[tuple[float, Value], ...] = ()

    def clear(self) -> None:
        """Forget all values."""
        self._items = ()

    def append(self, time: float, value: Value) -> None:
        """Add the value at a time [s] and delete the values at and after that time."""
        items = self._items
        end = bisect_left(items, time, key=_time)
        begin = bisect_left(items, time - KEPT_TIME, key=_time)
        self._items = (*items[begin:end], (time, value))

    def newest(self, count: int = 1) -> tuple[tuple[float, Value], ...]:
        """Return the newest items (time, value), at most as many as exist."""
        return self._items[-count:]

    def around(
        self, time: float
    ) -> tuple[tuple[float, Value] | None, tuple[float, Value] | None]:
        """Return the items (time, value) at or before a time [s] and after it, None if missing."""
        items = self._items
        index = bisect_right(items, time, key=_time)
        return (
            items[index - 1] if index else None,
            items[index] if index < len(items) else None,
        )
