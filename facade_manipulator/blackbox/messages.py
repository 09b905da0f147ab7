"""Messages as they are recorded: bytes with a time and a topic."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import struct
from typing import NamedTuple

_HEADER = struct.Struct('<dHI')  # time, lengths of topic and data


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
    qos: str = ''  #: for playback, as `ros2 bag` writes it


def packed(topic: str, messages: Iterable[tuple[float, bytes]]) -> list[bytes]:
    """Return each message of a topic, a time and data, as bytes that `unpacked` reads."""
    name = topic.encode()
    return [_HEADER.pack(time, len(name), len(data)) + name + data for time, data in messages]


def time_of(record: bytes) -> float:
    """Return the time of a packed message."""
    return _HEADER.unpack_from(record)[0]


def unpacked(records: bytes) -> Iterator[Kept]:
    """Yield the messages of packed ones that were put together."""
    end = 0
    while end < len(records):
        time, name, size = _HEADER.unpack_from(records, end)
        begin = end + _HEADER.size + name
        end = begin + size
        yield Kept(time, records[begin - name:begin].decode(), records[begin:end])
