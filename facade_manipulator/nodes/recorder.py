"""
The black box: every topic, parameter and CAN frame of the last minutes, on the disk.

Every few seconds it writes what came; of that it makes one MCAP file when something stops the
machine, on request, and of what it finds after a loss of power. It runs in a process of its own
and only listens: whatever happens to it, the machine goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from importlib.metadata import distributions
from itertools import pairwise
import os
from pathlib import Path
import platform
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from std_srvs.srv import Trigger
import yaml

from facade_manipulator import interfaces
from facade_manipulator.blackbox import (
    Arrivals,
    BlackBoxSettings,
    CAN_TOPIC,
    CanListener,
    DueFile,
    RecordedTopic,
    RecordTrigger,
    run_metadata,
    Shelf,
    Stream,
    write_recording,
)
from facade_manipulator.drives.cia402 import load_profile
from facade_manipulator.errors import ManipulatorError, RecordError
from facade_manipulator.interfaces import Quality, Topic
from facade_manipulator.messages import status_values
from facade_manipulator.resources import config_path
from facade_manipulator.ros import (
    class_of,
    declare,
    Deferred,
    DeferredReplies,
    diagnostic_status,
    DiagnosticsPublisher,
    HOLD,
    is_installed,
    message_from,
    message_type,
    MessageQueue,
    ParameterReader,
    Rejections,
    run,
    service,
    steady_timer,
)

DEPTH = 200  # messages of a topic that wait until they are taken
OPERATION = 'driver: operation'
STOPS = ('halting', 'halted', 'stopped', 'bus lost', 'control loop lost')  # states of the driver
MOVING = ('activating', 'active', 'homing', 'halting', 'deactivating')
SILENCE = 3.0  # s without diagnostics of a driver that had power
WATCH_PERIOD = 0.5  # s
TAKE_PERIOD = 0.1  # s
ERROR = DiagnosticStatus.ERROR
Metadata = Mapping[str, Mapping[str, str]]
LONGEST_WRITE = 30.0  # s, for a file
SEGMENT = 3.0  # s, which a loss of power costs; each takes some 20 ms of a processor
LOW_PRIORITY = 10  # nice value of the thread that writes
INTERRUPTED = 'recorder: it was killed or lost power'


class RecorderNode(Node):
    """Keep what is said and write it down when the machine stops."""

    def __init__(self, **kwargs) -> None:
        super().__init__('recorder', **kwargs)
        settings = declare(self, BlackBoxSettings)
        self._duration = settings.duration
        self._trigger = RecordTrigger(settings.duration, settings.aftermath)
        self._shelf = Shelf(settings.folder, settings.disk, self.get_namespace())
        self._topics = [CAN_TOPIC, *(
            RecordedTopic(
                self.resolve_topic_name(one.name), *message_type(class_of(one)),
                playback(recorded_quality(one))) for one in recorded_topics())]
        self._stream = Stream(  # a file begins before its first reason, and may have later ones
            self._shelf.folder, self._shelf.name, self._topics,
            2 * settings.duration + settings.aftermath, round(1e6 * settings.memory),
            0.5e6 * settings.disk)
        self._chain: tuple[float, Path | None] = 0.0, None
        self._installed = {one.name: one.version for one in distributions()}
        self._flushed = 0.0
        self._writer = ThreadPoolExecutor(1, 'black box', lambda: os.setpriority(
            os.PRIO_PROCESS, 0, LOW_PRIORITY))
        self._outcome, self._error, self._files = 'nothing recorded yet', '', 0
        self._interrupted = 0
        self._job: Future | None = None  # the newest, of a segment or of a file
        self._file: Future | None = None
        self._job_time = 0.0
        self._driver_state, self._driver_time = '', time.monotonic()
        self._knows_goal = False
        self._listener: CanListener | None = None
        self._rejections = Rejections(self)
        self._readers = {name: ParameterReader(self, name, self._rejections)
                         for name in interfaces.RECORDED}
        replies = DeferredReplies(self)
        replies.attach(service(self, interfaces.SAVE, self._save))
        reads: dict[Topic, Callable[[Any], None]] = {
            interfaces.DIAGNOSTICS: self._read_diagnostics,
            interfaces.PARAMETER_EVENTS: self._read_event,
            interfaces.GOAL_STATUS: self._read_goal_status}
        self._queues = [
            (MessageQueue(self, one, recorded_quality(one)), reads.get(one))
            for one in recorded_topics()]
        self._arrivals = Arrivals()
        self._prefix = self.get_namespace().strip('/')
        self._diagnostics = DiagnosticsPublisher(self, self._components)
        steady_timer(self, TAKE_PERIOD, self._take)
        steady_timer(self, WATCH_PERIOD, self._watch)

    def _take(self) -> None:
        """Keep what has come."""
        self._arrivals.begin()
        for queue, read in self._queues:
            for received, data in queue.take():
                self._stream.add(self._arrivals.time(received), queue.topic, data)
                if read is not None:
                    with self._rejections:
                        read(message_from(data, queue.kind, queue.topic))

    def _read_diagnostics(self, message: DiagnosticArray) -> None:
        now = time.monotonic()
        for status in message.status:
            name, stops = self._own(status.name), status.level == ERROR
            if name == OPERATION:
                self._driver_time = now
                self._driver_state = status_values(status).get('state', '')
                stops |= self._driver_state in STOPS
            if name.partition(': ')[0] in interfaces.RECORDED:
                self._note_reason(name, status.message if stops else '')

    def _read_goal_status(self, status: DiagnosticStatus) -> None:
        if self._knows_goal:  # the first one is latched: what it says may be long past
            self._note_reason('compensator', (
                HOLD if status_values(status).get('reason') == HOLD else ''))
        self._knows_goal = True

    def _note_reason(self, source: str, reason: str) -> None:
        if self._trigger.watch(time.monotonic(), source, reason):
            self._flushed = 0.0  # people switch the power off when the machine has stopped

    def _read_event(self, event: ParameterEvent) -> None:
        if (name := self._own(event.node)) in interfaces.RECORDED:
            self._readers[name].update(event)

    def _own(self, name: str) -> str:
        """Return the name of a node of this namespace, or of its component, without that."""
        namespace, _, name = name.rpartition('/')
        return name if namespace.strip('/') == self._prefix else ''

    def _watch(self) -> None:
        now = time.monotonic()
        for reader in self._readers.values():
            reader.ask_once()
        self._listen_to_bus()
        silence = now - self._driver_time
        self._note_reason('driver', (
            f'no diagnostics for {silence:.0f} s while it was {self._driver_state}'
            if self._driver_state in MOVING and silence > SILENCE else ''))
        if not self._is_writing and (due := self._trigger.due(now)) is not None:
            self._record(due)
        elif not self._is_busy and now - self._flushed >= SEGMENT:
            self._begin(self._flush, self._metadata(self._trigger.reasons))

    def _listen_to_bus(self) -> None:
        """Listen to the bus that the driver uses, once its parameters are known."""
        driver = self._readers['driver'].values
        if self._listener is None and driver.get('bus.interface') == 'socketcan':
            self._listener = CanListener(
                driver['bus.channel'],
                lambda time, data: self._stream.add(time, CAN_TOPIC.topic, data))

    def _save(self, _: Trigger.Request, response: Trigger.Response) -> Deferred | Trigger.Response:
        def answer(job: Future) -> Trigger.Response:
            response.success = job.exception() is None
            response.message = str(job.exception() or f'recorded in {job.result()}')
            return response

        if self._is_writing:  # a copy for each call would fill the memory
            response.message = 'the file before is still being written: ask again'
            return response
        due = DueFile(('recorder/save was called',), time.monotonic())
        return Deferred(self._record(due), answer)

    @property
    def _is_writing(self) -> bool:
        return self._file is not None and not self._file.done()

    @property
    def _is_busy(self) -> bool:
        return self._job is not None and not self._job.done()

    def _record(self, due: DueFile) -> Future:
        """Write what is kept, in the writer's thread."""
        self._take()
        self._file = self._begin(
            self._write, due, self._metadata(due.reasons), self._attachments())
        return self._file

    def _begin(self, job: Callable[..., Path | None], *arguments: Any) -> Future:
        self._flushed = self._job_time = time.monotonic()
        self._job = self._writer.submit(job, *arguments)
        self._job.add_done_callback(self._note)
        return self._job

    def _metadata(self, reasons: tuple[str, ...]) -> dict[str, dict[str, str]]:
        about = {'reasons': '\n'.join(reasons), 'namespace': self.get_namespace(),
                 'version': self._installed.get('facade_manipulator', ''), **host()}
        return {**run_metadata(about, {
            name: reader.values for name, reader in self._readers.items() if reader.values}),
            'versions': self._installed}

    def _attachments(self) -> list[Path]:
        """Return the files that this machine was started with."""
        profiles = {value for name, value in self._readers['driver'].values.items()
                    if name.endswith('.profile')}
        return [*(path for name in sorted(profiles) for path in _drive_files(name)),
                *(path for path in parameter_files() if path.is_file())]

    def _flush(self, metadata: Metadata) -> None:
        """Write what has come to the disk, and before all else what a lost recorder had there."""
        try:
            self._shelf.folder.mkdir(parents=True, exist_ok=True)
            self._interrupted += self._stream.recover(lambda segments: self._shelf.write(
                time.time(), lambda path: write_recording(
                    path, self._topics, segments, (), INTERRUPTED), self._stream.draft()))
            self._shelf.make_room(self._stream.disk)
            self._stream.flush(metadata)
        except OSError as error:
            raise self._shelf.error(error) from error

    def _write(self, due: DueFile, metadata: Metadata, attachments: list[Path]) -> Path:
        begin = time.monotonic()
        try:
            self._flush(metadata)
            segments = self._stream.since(due.first - self._duration)
            first, over = self._chain
            path = self._shelf.write(
                time.time(), lambda draft: write_recording(
                    draft, self._topics, segments, attachments),
                self._stream.draft(), over if due.first == first else None, self._stream.disk)
        except RecordError:
            self._trigger.again(begin, due)
            raise
        self._chain = due.first, path
        self._trigger.rest(time.monotonic(), time.monotonic() - begin)
        return path

    def _note(self, job: Future) -> None:
        error = job.exception()
        message = str(error) if error else ''
        if message and message != self._error:
            self.get_logger().error(message)
        self._error = message
        if error is None and job.result() is not None:
            self._files += 1
            self._outcome = f'recorded in {job.result()}'
            self.get_logger().info(self._outcome)

    def _components(self) -> list[DiagnosticStatus]:
        listener = self._listener
        trouble = self._slow_writing() or self._error or (listener.error if listener else '')
        values = {
            'kept [s]': min(self._stream.span, self._duration),
            'memory [MB]': 1e-6 * self._stream.size,
            'stream [MB]': 1e-6 * self._stream.disk,
            'messages lost': self._stream.dropped,
            'interrupted recordings': self._interrupted,
            'CAN': listener.channel if listener else 'no SocketCAN interface',
            'files written': self._files,
            'last file': self._outcome,
            'folder': self._shelf.folder,
            **self._rejections.values(),
        }
        return [diagnostic_status(
            'black box', 'error' if trouble else 'ok', trouble or self._outcome, values)]

    def _slow_writing(self) -> str:
        took = time.monotonic() - self._job_time
        if not self._is_busy or took <= LONGEST_WRITE:
            return ''
        return f'writing a file takes {took:.0f} s, bound {LONGEST_WRITE:g} s: does the disk hang?'

    def close(self) -> None:
        """End when what is being written is written."""
        if (due := self._trigger.due(float('inf'))) is not None:
            self._record(due)
        self._writer.shutdown()
        if not self._error:
            self._stream.close()
        for queue, _ in self._queues:
            queue.close()
        if self._listener is not None:
            self._listener.close()


def recorded_topics() -> list[Topic]:
    """Return the topics that are recorded on this computer."""
    return [one for one in interfaces.TOPICS if one.recorded and is_installed(one)]


def recorded_quality(topic: Topic) -> Quality:
    """Return how a topic is subscribed to: a stream holds nobody up."""
    latched = topic.quality.latched
    return Quality(DEPTH, latched or topic.recorded == interfaces.EVERY, latched)


def playback(quality: Quality) -> str:
    """
    Return a quality of service as `ros2 bag play` offers it.

    References
    ----------
    rosbag2_storage, qos.cpp, of metadata version 9.

    """
    forever = {'sec': 9223372036, 'nsec': 854775807}
    return yaml.safe_dump([{
        'history': 'keep_last', 'depth': quality.depth,
        'reliability': 'reliable' if quality.reliable else 'best_effort',
        'durability': 'transient_local' if quality.latched else 'volatile',
        'deadline': forever, 'lifespan': forever,
        'liveliness': 'automatic', 'liveliness_lease_duration': forever,
        'avoid_ros_namespace_conventions': False}], sort_keys=False)


def host() -> dict[str, str]:
    """Return what the computer is, for the engineer who does not stand before it."""
    return {'host': platform.node(), 'platform': platform.platform(),
            'python': platform.python_version(),
            'middleware': os.environ.get('RMW_IMPLEMENTATION', '')}


def parameter_files() -> list[Path]:
    """Return the parameter files that this process was started with."""
    return [Path(path) for option, path in pairwise(sys.argv) if option == '--params-file']


def _drive_files(profile: str) -> list[Path]:
    with suppress(ManipulatorError, OSError):
        return [config_path(f'drives/{profile}.yaml'), load_profile(profile).eds]
    return []


main = partial(run, lambda: [RecorderNode()])

if __name__ == '__main__':
    raise SystemExit(main())
