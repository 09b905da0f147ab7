"""
A file of the black box: messages by topic, parameters, why it was written.

It is an MCAP file as `ros2 bag`, Foxglove and PlotJuggler read it.

References
----------
MCAP format specification, https://mcap.dev/spec, and its registry: profile `ros2`, message
encoding `cdr`, schema encoding `ros2msg`.

"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import chain
import json
from operator import itemgetter
from pathlib import Path
import time
from typing import Any, BinaryIO, NamedTuple

from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory

from facade_manipulator.blackbox.can_frames import CAN_TOPIC, messages_of
from facade_manipulator.blackbox.ring import Kept, RecordedTopic
from facade_manipulator.errors import RecordError

OF_THE_GRAPH = ('/diagnostics', '/parameter_events')  # topics of no namespace
SUMMARY, PARAMETERS = 'black box', 'parameters of '
_NANOSECONDS = 1e9
CHUNK = 1 << 20  # byte: what a writer holds in memory before it is compressed


def write_recording(
    path: Path, topics: Iterable[RecordedTopic], kept: tuple[list[Kept], list[Kept]],
    about: Mapping[str, str], parameters: Mapping[str, Mapping[str, Any]],
) -> None:
    """
    Write a file; raises an OSError if that fails.

    Kept are the last messages of topics and all since, as `MessageRing.copy` returns them. `about`
    has ``reasons``, line by line, and ``namespace``; parameters are by node and name.
    """
    before, newest = kept
    present = time.monotonic()
    epoch = time.time() - present
    begin = newest[0].time if newest else present
    messages = chain.from_iterable(
        messages_of(one) if one.topic == CAN_TOPIC.topic else (one,) for one in before + newest)
    write_mcap(path, topics, sorted(messages, key=itemgetter(0)), epoch, {
        SUMMARY: {**about, 'begin': f'{epoch + begin:.6f}'},
        **{PARAMETERS + node: {name: json.dumps(value) for name, value in values.items()}
           for node, values in parameters.items()}})


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
        writer = Writer(file, CHUNK, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start('ros2', 'facade_manipulator')
        for name, values in metadata.items():
            writer.add_metadata(name, dict(values))
        numbers = {topic.topic: _register(writer, topic) for topic in topics}
        for sequence, message in enumerate(messages):
            stamp = max(0, round((epoch + message.time) * _NANOSECONDS))
            writer.add_message(numbers[message.topic], stamp, message.data, stamp, sequence)
        writer.finish()


def _register(writer: Writer, topic: RecordedTopic) -> int:
    schema = writer.register_schema(topic.type, 'ros2msg', topic.definition.encode())
    return writer.register_channel(
        topic.topic, 'cdr', schema, {'offered_qos_profiles': ''})


class Received(NamedTuple):
    """A message and the time at which the black box received it [s, system clock]."""

    time: float
    message: Any


@dataclass
class RecordedRun:
    """
    The content of a file.

    From `begin` to `end` [s, system clock] everything was kept; the last messages of topics that
    had been silent for longer came before.
    """

    reasons: list[str] = field(default_factory=list)  #: why it was written
    begin: float = 0.0
    end: float = 0.0
    #: of each node its parameters by name, as they were when it was written
    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)
    #: of each topic, without its namespace, the messages in the order of time
    topics: dict[str, list[Received]] = field(default_factory=lambda: defaultdict(list))
    about: dict[str, str] = field(default_factory=dict)  #: such as the ``version`` that wrote it
    files: dict[str, bytes] = field(default_factory=dict)  #: that came with it, by name
    damage: str = ''  #: why the file could not be read to its end; empty if it could


def read_recording(path: Path) -> RecordedRun:
    """
    Read a file; of one that was cut off what there is.

    Raises a RecordError if it cannot be opened, or is no file of the black box.
    """
    try:
        with path.open('rb') as file:
            run = _read(file)
    except (OSError, McapError) as error:
        raise RecordError(f'{path} cannot be read: {error}') from error
    if not run.topics or not run.begin:
        raise RecordError(f'{path} is no file of the black box'
                          + (f': {run.damage}' if run.damage else ''))
    return run


def _read(file: BinaryIO) -> RecordedRun:
    """Turn the records of an MCAP file into a `RecordedRun`, as far as they go."""
    run, factory = RecordedRun(), DecoderFactory()
    schemas, topics = {}, {}
    try:
        for record in StreamReader(file, validate_crcs=True).records:
            match record:
                case Metadata(name=name, metadata=values):
                    _note(run, name, values)
                case Attachment(name=name, data=data):
                    run.files[name] = data
                case Schema():
                    schemas[record.id] = record
                case Channel(topic=topic):
                    topics[record.id] = (
                        topic if topic in OF_THE_GRAPH else topic.removeprefix(
                            run.about['namespace'].rstrip('/') + '/'),
                        factory.decoder_for(record.message_encoding, schemas[record.schema_id]))
                case Message():
                    topic, decode = topics[record.channel_id]
                    stamp = record.log_time / _NANOSECONDS
                    run.topics[topic].append(Received(stamp, decode(record.data)))
                    run.end = max(run.end, stamp)
    except Exception as error:  # damaged bytes raise whatever their decoder does
        run.damage = str(error) or type(error).__name__
    return run


def _note(run: RecordedRun, name: str, values: dict[str, str]) -> None:
    """Note a record of metadata."""
    if name == SUMMARY:
        run.about, run.reasons = values, values['reasons'].splitlines()
        run.begin = float(values['begin'])
    elif name.startswith(PARAMETERS):
        run.parameters[name.removeprefix(PARAMETERS)] = {
            parameter: json.loads(value) for parameter, value in values.items()}
