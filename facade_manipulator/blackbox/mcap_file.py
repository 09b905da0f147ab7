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
    """
    A topic with its type.

    Attributes
    ----------
    topic : str
    type : str
        As ``geometry_msgs/msg/PoseStamped``.
    definition : str
        Definition of the type and of all that it contains, as the schema encoding wants it.

    """

    topic: str
    type: str
    definition: str


def write_mcap(
    path: Path, topics: Iterable[RecordedTopic], messages: Iterable[Kept], epoch: float,
    metadata: Mapping[str, Mapping[str, str]],
) -> None:
    """
    Write messages to a file.

    Parameters
    ----------
    path : Path
    topics : iterable of RecordedTopic
        All of them: a message of another one is an error.
    messages : iterable of Kept
    epoch : float
        The system's time when the monotonic clock was zero [s]: a step of the system's clock
        within a file would put its messages out of order.
    metadata : mapping
        Records of names and values, by their name.

    Raises
    ------
    OSError
        If it cannot be written.

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
