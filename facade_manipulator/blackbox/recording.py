"""What a file of the black box says: messages by topic, parameters, why it was written."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
import json
from pathlib import Path
from typing import Any, NamedTuple

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory

from facade_manipulator.errors import RecordError

OF_THE_GRAPH = ('/diagnostics', '/parameter_events')  # topics of no namespace
SUMMARY, PARAMETERS = 'black box', 'parameters of '
_NANOSECONDS = 1e9


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
    damage: str = ''  #: why the file could not be read to its end; empty if it could


def read_recording(path: Path) -> RecordedRun:
    """
    Read a file; of one that was cut off what there is.

    Raises a RecordError if it cannot be opened, or is no file of the black box.
    """
    try:
        with path.open('rb') as file:
            run = _Reader().read(file)
    except (OSError, McapError) as error:
        raise RecordError(f'{path} cannot be read: {error}') from error
    if not run.topics or not run.begin:
        raise RecordError(f'{path} is no file of the black box'
                          + (f': {run.damage}' if run.damage else ''))
    return run


class _Reader:
    """Turns the records of an MCAP file into a `RecordedRun`, as far as they go."""

    def __init__(self) -> None:
        self._run = RecordedRun()
        self._namespace = ''
        self._schemas: dict[int, Schema] = {}
        self._topics: dict[int, tuple[str, Any]] = {}
        self._factory = DecoderFactory()
        self._handlers = {Metadata: self._metadata, Schema: self._schema,
                          Channel: self._channel, Message: self._message}

    def read(self, file) -> RecordedRun:
        records = StreamReader(file).records
        try:
            for record in records:
                handle = self._handlers.get(type(record))
                if handle is not None:
                    handle(record)
        except Exception as error:  # damaged bytes raise whatever their decoder does
            self._run.damage = str(error) or type(error).__name__
        return self._run

    def _metadata(self, record: Metadata) -> None:
        if record.name == SUMMARY:
            self._namespace = record.metadata['namespace'].rstrip('/') + '/'
            self._run.reasons = record.metadata['reasons'].splitlines()
            self._run.begin = float(record.metadata['begin'])
        elif record.name.startswith(PARAMETERS):
            self._run.parameters[record.name.removeprefix(PARAMETERS)] = {
                name: json.loads(value) for name, value in record.metadata.items()}

    def _schema(self, record: Schema) -> None:
        self._schemas[record.id] = record

    def _channel(self, record: Channel) -> None:
        decode = self._factory.decoder_for(
            record.message_encoding, self._schemas[record.schema_id])
        topic = record.topic
        if topic not in OF_THE_GRAPH:
            topic = topic.removeprefix(self._namespace)
        self._topics[record.id] = topic, decode

    def _message(self, record: Message) -> None:
        topic, decode = self._topics[record.channel_id]
        time = record.log_time / _NANOSECONDS
        self._run.topics[topic].append(Received(time, decode(record.data)))
        self._run.end = max(self._run.end, time)
