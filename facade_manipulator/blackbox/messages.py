"""Messages as they are recorded: bytes with a time and a topic."""

from __future__ import annotations

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
    qos: str = ''  #: for playback, as `ros2 bag` writes it
