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
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, takewhile
import json
from operator import attrgetter
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory

from facade_manipulator.blackbox.can_frames import CAN_TOPIC, messages_of
from facade_manipulator.blackbox.messages import Kept, RecordedTopic, unpacked
from facade_manipulator.errors import RecordError

OF_THE_GRAPH = ('/diagnostics', '/parameter_events', '/rosout', '/tf')  # topics of no namespace
SUMMARY, PARAMETERS = 'black box', 'parameters of '
_NANOSECONDS = 1e9  # in a second
CHUNK = 1 << 20  # byte: what a writer holds in memory before it is compressed
BATCH = 1000  # packed messages, which take about as much
_BATCHES = RecordedTopic('batches', '', '')


def write_recording(path: Path, topics: Iterable[RecordedTopic], segments: Sequence[Path],
                    attachments: Iterable[Path] = (), reason: str = '') -> None:
    """
    Make a file of segments of one stream, in their order; raises an OSError if that fails.

    Metadata are those of the newest, with a further reason. Topics that are not among these, as
    those of another version, are left out.
    """
    first, newest = metadata_of(segments[0]), metadata_of(segments[-1])
    epoch, begin = float(newest[SUMMARY]['epoch']), float(first[SUMMARY]['begin'])
    reasons = '\n'.join(filter(None, (newest[SUMMARY]['reasons'], reason)))
    summary = {**newest[SUMMARY], 'reasons': reasons, 'begin': f'{epoch + begin:.6f}'}
    topics = list(topics)
    known = {one.topic for one in topics}
    messages = chain.from_iterable(
        messages_of(one) if one.topic == CAN_TOPIC.topic else (one,)
        for segment in segments for one in segment_messages(segment, segment is segments[0])
        if one.topic in known)
    write_mcap(path, topics, messages, epoch, {**newest, SUMMARY: summary}, begin, attachments)


def write_segment(path: Path, earlier: Iterable[bytes], records: Sequence[bytes], begin: float,
                  metadata: Mapping[str, Mapping[str, str]]) -> None:
    """
    Write packed messages to a file, many as one; raises an OSError if that fails.

    Before them the newest of each topic from before the segment: a file may begin with it.
    """
    batches = [b''.join(earlier), *(b''.join(records[place:place + BATCH])
                                    for place in range(0, len(records), BATCH))]
    write_mcap(path, [_BATCHES], (Kept(begin, _BATCHES.topic, one) for one in batches), 0.0,
               metadata)


def segment_messages(segment: Path, is_first: bool) -> list[Kept]:
    """Return the messages of a segment by their time, with the earlier ones if it is the first."""
    with segment.open('rb') as file:
        batches = [record.data for record in StreamReader(file, validate_crcs=True).records
                   if isinstance(record, Message)]
    return sorted(chain.from_iterable(map(unpacked, batches[not is_first:])),
                  key=attrgetter('time'))


def run_metadata(
    about: Mapping[str, str], parameters: Mapping[str, Mapping[str, Any]],
) -> dict[str, dict[str, str]]:
    """
    Return the records of a file.

    `about` has ``reasons``, line by line, and ``namespace``; parameters are by node and name.
    """
    return {SUMMARY: dict(about), **{
        PARAMETERS + node: {name: json.dumps(value) for name, value in values.items()}
        for node, values in parameters.items()}}


def run_parameters(metadata: Mapping[str, Mapping[str, str]]) -> dict[str, dict[str, Any]]:
    """Return the parameters of a file's records, by node and name."""
    return {
        record.removeprefix(PARAMETERS): {name: json.loads(value) for name, value in one.items()}
        for record, one in metadata.items() if record.startswith(PARAMETERS)}


def metadata_of(path: Path) -> dict[str, dict[str, str]]:
    """Return the records at the begin of a file by their name; raises a McapError without one."""
    with path.open('rb') as file:
        return {record.name: record.metadata for record in takewhile(
            lambda record: isinstance(record, (Header, Metadata)), StreamReader(file).records)
            if isinstance(record, Metadata)}


def write_mcap(
    path: Path, topics: Iterable[RecordedTopic], messages: Iterable[Kept], epoch: float,
    metadata: Mapping[str, Mapping[str, str]], begin: float = 0.0,
    attachments: Iterable[Path] = (),
) -> None:
    """
    Write messages, all of them of these topics, to a file; raises an OSError if that fails.

    The epoch is the system's time when the monotonic clock was zero [s]: a step of the system's
    clock within a file would put its messages out of order. What came before the file begins [s]
    is logged at its begin and keeps its time of publication. Metadata are records by their name.
    """
    with path.open('wb') as file:
        writer = Writer(file, CHUNK, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start('ros2', 'facade_manipulator')
        for name, values in metadata.items():
            writer.add_metadata(name, dict(values))
        for attached in attachments:
            writer.add_attachment(0, 0, attached.name, 'text/plain', attached.read_bytes())
        numbers = {topic.topic: _register(writer, topic) for topic in topics}
        earliest = round((epoch + begin) * _NANOSECONDS) if begin else 0
        for sequence, message in enumerate(messages):
            published = max(0, round((epoch + message.time) * _NANOSECONDS))
            logged = max(published, earliest)
            writer.add_message(
                numbers[message.topic], logged, message.data, published, sequence)
        writer.finish()


def _register(writer: Writer, topic: RecordedTopic) -> int:
    schema = writer.register_schema(topic.type, 'ros2msg', topic.definition.encode())
    return writer.register_channel(
        topic.topic, 'cdr', schema, {'offered_qos_profiles': topic.qos})


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


def read_recording(path: Path, only: Collection[str] = ()) -> RecordedRun:
    """
    Read a file, or some of its topics; of one that was cut off what there is.

    Raises a RecordError if it cannot be opened, or is no file of the black box.
    """
    try:
        with path.open('rb') as file:
            run = _read(file, only)
    except (OSError, McapError) as error:
        raise RecordError(f'{path} cannot be read: {error}') from error
    if not run.topics or not run.begin:
        raise RecordError(f'{path} is no file of the black box'
                          + (f': {run.damage}' if run.damage else ''))
    return run


def _read(file: BinaryIO, only: Collection[str]) -> RecordedRun:
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
                        _decoder(factory, record, schemas[record.schema_id]))
                case Message() if not only or topics[record.channel_id][0] in only:
                    topic, decode = topics[record.channel_id]
                    came = record.publish_time / _NANOSECONDS
                    run.topics[topic].append(Received(came, decode(record.data)))
                    run.end = max(run.end, came)
    except Exception as error:  # damaged bytes raise whatever their decoder does
        run.damage = str(error) or type(error).__name__
    return run


def _decoder(factory: DecoderFactory, channel: Channel, schema: Schema) -> Callable[[bytes], Any]:
    decode = factory.decoder_for(channel.message_encoding, schema)
    if decode is None:
        raise RecordError(f'{channel.topic} holds no ROS messages')
    return decode


def _note(run: RecordedRun, name: str, values: dict[str, str]) -> None:
    """Note a record of metadata."""
    if name == SUMMARY:
        run.about, run.reasons = values, values['reasons'].splitlines()
        run.begin = float(values['begin'])
    run.parameters |= run_parameters({name: values})
