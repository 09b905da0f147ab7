"""
The black box: every topic, parameter and CAN frame of the last minutes, in memory.

It writes one MCAP file when something stops the machine, or on request. It runs in a process of
its own and only listens: whatever happens to it, the machine goes on.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from importlib.metadata import version
import os
from pathlib import Path
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from facade_manipulator.blackbox import (
    Arrivals,
    BlackBoxSettings,
    CAN_TOPIC,
    CanListener,
    Kept,
    MessageRing,
    RecordedTopic,
    RecordTrigger,
    Shelf,
    write_recording,
)
from facade_manipulator.messages import status_values
from facade_manipulator.ros import (
    declare,
    Deferred,
    DeferredReplies,
    diagnostic_status,
    DiagnosticsPublisher,
    GOAL_STATUS,
    HOLD,
    message_type,
    MessageQueue,
    ParameterReader,
    run,
    steady_timer,
)

NAME = 'facade_manipulator'
DEPTH = 200  # messages of a topic that wait until they are taken
STREAM = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)  # holds nobody up
EVERY = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE)
KEPT = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE,
                  durability=DurabilityPolicy.TRANSIENT_LOCAL)
# topic: type, quality of service; the last two are the whole graph's, the others the namespace's
TOPICS = {
    'goal_pose': (PoseStamped, EVERY),
    'disturbance': (PoseWithCovarianceStamped, STREAM),
    'disturbance_odometry': (Odometry, STREAM),
    'contact_wrench': (WrenchStamped, STREAM),
    'lateral_offset': (PointStamped, STREAM),
    'head_on_wall': (PoseStamped, STREAM),  # what `calibrate estimator` asks for
    'corrected_pose': (PoseStamped, STREAM),
    'joint_setpoints': (JointState, STREAM),
    'joint_states': (JointState, STREAM),
    'end_effector_pose': (PoseStamped, STREAM),
    'compensator/reference': (PoseStamped, STREAM),
    GOAL_STATUS: (DiagnosticStatus, KEPT),
    'software_stop': (Bool, STREAM),
    'ik_service/status': (DiagnosticStatus, KEPT),
    'ik_service/rejections': (DiagnosticStatus, KEPT),
    '/parameter_events': (ParameterEvent, EVERY),
    '/diagnostics': (DiagnosticArray, EVERY),
}
COMPONENTS = ('driver', 'ik_service', 'compensator', 'gondola_simulator')
OPERATION = 'driver: operation'
STOPS = ('halting', 'halted', 'stopped', 'bus lost', 'control loop lost')  # states of the driver
MOVING = ('activating', 'active', 'homing', 'halting', 'deactivating')
SILENCE = 3.0  # s without diagnostics of a driver that had power
WATCH_PERIOD = 0.5
TAKE_PERIOD = 0.1  # s
ERROR = DiagnosticStatus.ERROR
LONGEST_WRITE = 30.0  # s, for a file
LOW_PRIORITY = 10  # nice value of the thread that writes


class RecorderNode(Node):
    """Keep what is said and write it down when the machine stops."""

    def __init__(self, **kwargs) -> None:
        super().__init__('recorder', **kwargs)
        settings = declare(self, BlackBoxSettings)
        self._ring = MessageRing(settings.duration, round(1e6 * settings.memory))
        self._trigger = RecordTrigger(settings.aftermath, settings.duration)
        self._shelf = Shelf(settings.folder, settings.disk)
        self._topics = [CAN_TOPIC, *(
            RecordedTopic(self.resolve_topic_name(topic), *message_type(kind))
            for topic, (kind, _) in TOPICS.items())]
        self._writer = ThreadPoolExecutor(1, 'black box', lambda: os.setpriority(
            os.PRIO_PROCESS, 0, LOW_PRIORITY))
        self._outcome, self._error, self._files = 'nothing recorded yet', '', 0
        self._job: Future | None = None
        self._job_time = 0.0
        self._driver_state, self._driver_time = '', time.monotonic()
        self._knows_goal = False
        self._listener: CanListener | None = None
        self._readers = {name: ParameterReader(self, name) for name in COMPONENTS}
        replies = DeferredReplies(self)
        replies.attach(self.create_service(Trigger, 'recorder/save', self._save))
        reads = {'/diagnostics': self._read_diagnostics, '/parameter_events': self._read_event,
                 GOAL_STATUS: self._read_goal_status}
        self._queues = [(MessageQueue(self, kind, topic, qos), reads.get(topic))
                        for topic, (kind, qos) in TOPICS.items()]
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
                self._ring.add(self._arrivals.time(received), queue.topic, data)
                if read is not None:
                    read(deserialize_message(data, queue.kind))

    def _read_diagnostics(self, message: DiagnosticArray) -> None:
        now = time.monotonic()
        for status in message.status:
            name, stops = self._own(status.name), status.level == ERROR
            if name == OPERATION:
                self._driver_time = now
                self._driver_state = status_values(status).get('state', '')
                stops |= self._driver_state in STOPS
            if name.partition(': ')[0] in COMPONENTS:
                self._trigger.watch(now, name, status.message if stops else '')

    def _read_goal_status(self, status: DiagnosticStatus) -> None:
        if self._knows_goal:  # the first one is latched: what it says may be long past
            self._trigger.watch(time.monotonic(), 'compensator', (
                HOLD if status_values(status).get('reason') == HOLD else ''))
        self._knows_goal = True

    def _read_event(self, event: ParameterEvent) -> None:
        if (name := self._own(event.node)) in COMPONENTS:
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
        self._trigger.watch(now, 'driver', (
            f'no diagnostics for {silence:.0f} s while it was {self._driver_state}'
            if self._driver_state in MOVING and silence > SILENCE else ''))
        if not self._is_writing and (reasons := self._trigger.due(now)):
            self._record(reasons)

    def _listen_to_bus(self) -> None:
        """Listen to the bus that the driver uses, once its parameters are known."""
        driver = self._readers['driver'].values
        if self._listener is None and driver.get('bus.interface') == 'socketcan':
            self._listener = CanListener(
                driver['bus.channel'],
                lambda time, data: self._ring.add(time, CAN_TOPIC.topic, data))

    def _save(self, _: Trigger.Request, response: Trigger.Response) -> Deferred | Trigger.Response:
        def answer(job: Future) -> Trigger.Response:
            response.success = job.exception() is None
            response.message = str(job.exception() or f'recorded in {job.result()}')
            return response

        if self._is_writing:  # a copy for each call would fill the memory
            response.message = 'the file before is still being written: ask again'
            return response
        return Deferred(self._record(('recorder/save was called',)), answer)

    @property
    def _is_writing(self) -> bool:
        return self._job is not None and not self._job.done()

    def _record(self, reasons: tuple[str, ...]) -> Future:
        """Write what is kept, in the writer's thread."""
        self._take()
        self._job = self._writer.submit(self._write, *self._ring.copy(), reasons)
        self._job_time = time.monotonic()
        self._job.add_done_callback(self._note)
        return self._job

    def _write(self, before: list[Kept], kept: list[Kept], reasons: tuple[str, ...]) -> Path:
        about = {'reasons': '\n'.join(reasons), 'namespace': self.get_namespace(),
                 'version': version(NAME)}
        parameters = {name: dict(reader.values)  # as of now: the executor goes on changing them
                      for name, reader in self._readers.items() if reader.values}
        return self._shelf.write(time.time(), lambda path: write_recording(
            path, self._topics, (before, kept), about, parameters))

    def _note(self, job: Future) -> None:
        error = job.exception()
        self._error = str(error) if error else ''
        if error:
            self.get_logger().error(self._error)
        else:
            self._files += 1
            self._outcome = f'recorded in {job.result()}'
            self.get_logger().info(self._outcome)

    def _components(self) -> list[DiagnosticStatus]:
        listener = self._listener
        trouble = self._slow_writing() or self._error or (listener.error if listener else '')
        values = {
            'kept [s]': self._ring.span,
            'memory [MB]': 1e-6 * self._ring.size,
            'CAN': listener.channel if listener else 'no SocketCAN interface',
            'files written': self._files,
            'last file': self._outcome,
            'folder': self._shelf.folder,
        }
        return [diagnostic_status(
            'black box', 'error' if trouble else 'ok', trouble or self._outcome, values)]

    def _slow_writing(self) -> str:
        took = time.monotonic() - self._job_time
        if not self._is_writing or took <= LONGEST_WRITE:
            return ''
        return f'writing a file takes {took:.0f} s, bound {LONGEST_WRITE:g} s: does the disk hang?'

    def close(self) -> None:
        """End when what is being written is written."""
        if reasons := self._trigger.due(float('inf')):
            self._record(reasons)
        self._writer.shutdown()
        for queue, _ in self._queues:
            queue.close()
        if self._listener is not None:
            self._listener.close()


main = partial(run, lambda: [RecorderNode()])

if __name__ == '__main__':
    raise SystemExit(main())
