"""
Messages to an MCAP file as `ros2 bag`, Foxglove and PlotJuggler read it.

References
----------
MCAP format specification, https://mcap.dev/spec, and its registry: profile `ros2`, message
encoding `cdr`, schema encoding `ros2msg`.

"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from mcap.writer import CompressionType, Writer

from facade_manipulator.blackbox.ring import Kept

CHUNK = 1 << 20  # byte: what a writer holds in memory before it is compressed
_NANOSECONDS = 1e9


class RecordedTopic(NamedTuple):
    """A topic with its type."""

    topic: str
    type: str  #: as ``geometry_msgs/msg/PoseStamped``
    definition: str  #: of the type and of all that it contains, as the schema encoding wants it


def write_mcap(
    path: Path, topics: Iterable[RecordedTopic], messages: Iterable[Kept], epoch: float,
    metadata: Mapping[str, Mapping[str, str]],
) -> None:
    """
    Write messages, all of them of these topics, to a file; raises an OSError if that fails.

    The epoch is the system's time when the monotonic clock was zero [s]: a step of the system's
    clock within a file would put its messages out of order. Metadata are records by their name.
    """
    with path.open('wb') as file:
        writer = Writer(file, CHUNK, compression=CompressionType.ZSTD)
        writer.start('ros2', 'facade_manipulator')
        for name, values in metadata.items():
            writer.add_metadata(name, dict(values))
        numbers = {topic.topic: _register(writer, topic) for topic in topics}
        for sequence, message in enumerate(messages):
            time = max(0, round((epoch + message.time) * _NANOSECONDS))
            writer.add_message(
                numbers[message.topic], time, message.data, time, sequence)
        writer.finish()


def _register(writer: Writer, topic: RecordedTopic) -> int:
    schema = writer.register_schema(topic.type, 'ros2msg', topic.definition.encode())
    return writer.register_channel(
        topic.topic, 'cdr', schema, {'offered_qos_profiles': ''})
