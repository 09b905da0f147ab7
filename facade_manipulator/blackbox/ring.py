"""The newest messages, bounded in time and memory, and the last one of every topic before them."""

from __future__ import annotations

from collections import deque
import sys
import threading
from typing import NamedTuple


class Kept(NamedTuple):
    """A message with the monotonic time at which it came [s] and its topic."""

    time: float
    topic: str
    data: bytes


class RecordedTopic(NamedTuple):
    """A topic with its type."""

    topic: str
    type: str  #: as ``geometry_msgs/msg/PoseStamped``
    definition: str  #: of the type and of all that it contains, as the schema encoding wants it


OVERHEAD = sys.getsizeof(Kept(0.0, '', b'')) + sys.getsizeof(0.0) + sys.getsizeof(b'') + 8


class MessageRing:
    """
    Keep messages for a time; any thread may add them.

    What is older than that, or finds no room, goes; of every topic the last one stays, so that a
    goal or a parameter of an hour ago is still known. A message is kept for the duration [s]; the
    capacity is memory for messages, their objects included [byte].
    """

    def __init__(self, duration: float, capacity: int) -> None:
        self._duration, self._capacity = duration, capacity
        self._messages: deque[Kept] = deque()
        self._last: dict[str, Kept] = {}
        self._size = 0
        self._lock = threading.Lock()

    @property
    def size(self) -> int:
        """Memory that the messages take [byte]."""
        return self._size

    @property
    def span(self) -> float:
        """Time from the oldest message to the newest [s]."""
        with self._lock:
            messages = self._messages
            return messages[-1].time - messages[0].time if messages else 0.0

    def add(self, time: float, topic: str, data: bytes) -> None:
        """Add a message that came at a monotonic time [s]."""
        message = Kept(time, topic, data)
        with self._lock:
            messages = self._messages
            messages.append(message)
            self._size += len(data) + OVERHEAD
            oldest = time - self._duration
            while messages[0].time < oldest or self._size > self._capacity:
                gone = messages.popleft()
                self._size -= len(gone.data) + OVERHEAD
                self._last[gone.topic] = gone
                if not messages:
                    break

    def copy(self) -> tuple[list[Kept], list[Kept]]:
        """Return the last message of every topic among those that went, and what is kept."""
        with self._lock:
            return sorted(self._last.values()), list(self._messages)
