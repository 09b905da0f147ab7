"""
The black box: every topic, parameter and CAN frame of the last minutes, on the disk.

Every few seconds it writes what came; of that it makes one MCAP file when something stops the
machine, on request, and of what it finds after a loss of power. It runs in a process of its own
and only listens: whatever happens to it, the machine goes on.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from std_srvs.srv import Trigger
import yaml

from facade_manipulator import blackbox, diagnostics, interfaces, ros
from facade_manipulator.interfaces import Quality, Topic
from facade_manipulator.maintenance import ChangeLog
from facade_manipulator.messages import HOLD, status_values

PERIOD = 0.25  # s, in which messages are read that may name a stop
TURN = 1.0  # s, in which those are taken that are only kept: to be woken for each would cost more
DEPTH = 2000  # messages of a topic that wait until they are taken
OPERATION, STATE = str(diagnostics.OPERATION), diagnostics.OPERATION.key('state')
SOFTWARE = {diagnostics.OPERATION.key(one) for one in ('version', 'profiles')}
STOPS = ('halting', 'halted', 'stopped', 'bus lost', 'control loop lost')  # states of the driver
MOVING = ('activating', 'active', 'homing', 'halting', 'deactivating')
SENSORS = interfaces.RANGE_1, interfaces.FIX_X, interfaces.FIX_POSE
SILENCE = 3.0  # s without diagnostics of a driver that had power
Reader = Callable[[float, Any], None]  # of a message and when it came


class RecorderNode(Node):
    """Keep what is said and write it down when the machine stops."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('recorder', **kwargs)
        self._driver_state, self._driver_time = '', time.monotonic()
        self._knows_goal = False
        self._listener: blackbox.CanListener | None = None
        self._prefix = self.get_namespace().strip('/')
        self._rejections = ros.Rejections(self)
        self._readers = {name: ros.ParameterReader(self, name, self._rejections)
                         for name in interfaces.RECORDED}
        self._topics = [blackbox.CAN_TOPIC]  # the black box has the same list
        self._read, self._kept = ros.MessageQueues(self), ros.MessageQueues(self)
        settings = ros.declare(self, blackbox.BlackBoxSettings)
        self._changes = ChangeLog(settings.folder, self.get_namespace())
        self._black_box = blackbox.BlackBox(
            settings, self.get_namespace(), self._topics, self._parameters_known, self._take,
            self.get_logger())
        reads: dict[Topic, Reader] = {
            interfaces.DIAGNOSTICS: self._read_diagnostics,
            interfaces.PARAMETER_EVENTS: self._read_event,
            interfaces.GOAL_STATUS: self._read_goal_status}
        for topic in recorded_topics():
            self._record(topic, reads.get(topic))
        ros.may_defer(self, ros.service(self, interfaces.SAVE, self._save))
        self._diagnostics = ros.DiagnosticsPublisher(self, self._components)
        ros.steady_timers(self, PERIOD, self._watch, TURN, self._turn)

    def _record(self, topic: Topic, read: Reader | None = None) -> None:
        def keep(queue: ros.MessageQueue, messages: ros.Arrived) -> None:
            self._black_box.add(queue.topic, messages)
            if read is not None:
                queue.read(messages, read, self._rejections)

        queue = (self._read if read else self._kept).subscribe(topic, DEPTH, keep)
        self._topics.append(blackbox.RecordedTopic(
            queue.topic, *ros.message_type(queue.kind), playback(queue.quality)))

    def _record_sensors(self) -> None:
        """Record the sensors that the estimator has by other names, once these are known."""
        values = self._readers[interfaces.ESTIMATOR].values
        for like in SENSORS:
            with suppress(TypeError, ros.ROSError):  # no names: not of our estimator
                for name in filter(None, values.get(like.parameter, ())):
                    if self.resolve_topic_name(name) not in {one.topic for one in self._topics}:
                        self._record(like._replace(name=name))

    def _parameters_known(self) -> dict[str, dict[str, Any]]:
        return {name: reader.values for name, reader in self._readers.items() if reader.values}

    def _watch(self) -> None:
        for name, reader in self._readers.items():
            if not reader.values:
                reader.ask_once()
            self._changes.note(name, reader.values)
        self._listen_to_bus()
        self._record_sensors()
        self._read.take()
        silence = time.monotonic() - self._driver_time
        self._black_box.note('driver', (
            f'no diagnostics for {silence:.0f} s while it was {self._driver_state}'
            if self._driver_state in MOVING and silence > SILENCE else ''))
        self._black_box.watch()

    def _turn(self) -> None:
        for reader in self._readers.values():
            reader.ask_once()  # again, if its node has been restarted
        self._take()

    def _take(self) -> None:
        """Keep what has come of all topics and of the bus."""
        for queues in (self._read, self._kept):
            queues.take()
        if self._listener is not None:
            self._listener.hand_on()

    def _listen_to_bus(self) -> None:
        """Listen to the bus that the driver uses, once its parameters are known."""
        driver = self._readers['driver'].values
        if self._listener is None and driver.get('bus.interface') == 'socketcan':
            self._listener = blackbox.CanListener(
                driver['bus.channel'],
                lambda time, data: self._black_box.add(blackbox.CAN_TOPIC.topic, [(time, data)]))

    def _read_diagnostics(self, came: float, message: DiagnosticArray) -> None:
        for status in message.status:
            name, stops = self._own(status.name), status.level == DiagnosticStatus.ERROR
            if name == OPERATION:
                self._driver_time = came
                values = status_values(status)
                self._driver_state = values.get(STATE, '')
                self._changes.note('software', {
                    key: values[key] for key in SOFTWARE & values.keys()})
                stops |= self._driver_state in STOPS
            if name.partition(': ')[0] in interfaces.RECORDED:
                cause, _, _ = status.message.partition('; next: ')
                self._black_box.note(name, cause if stops else '')

    def _read_goal_status(self, _: float, status: DiagnosticStatus) -> None:
        if self._knows_goal:  # the first one is latched: what it says may be long past
            self._black_box.note('compensator', (
                HOLD if status_values(status).get('reason') == HOLD else ''))
        self._knows_goal = True

    def _read_event(self, _: float, event: ParameterEvent) -> None:
        if (name := self._own(event.node)) in interfaces.RECORDED:
            self._readers[name].update(event)
            if event.changed_parameters:  # again before the next look, perhaps
                self._changes.note(name, self._readers[name].values)

    def _own(self, name: str) -> str:
        """Return the name of a node of this namespace, or of its component, without that."""
        namespace, _, name = name.rpartition('/')
        return name if namespace.strip('/') == self._prefix else ''

    def _save(
        self, _: Trigger.Request, response: Trigger.Response
    ) -> ros.Deferred | Trigger.Response:
        def answer(job: Future[Any]) -> Trigger.Response:
            response.success = job.exception() is None
            response.message = str(job.exception() or f'recorded in {job.result()}')
            return response

        if self._black_box.is_writing:
            response.message = 'the file before is still being written: ask again'
            return response
        return ros.Deferred(self._black_box.save('recorder/save was called'), answer)

    def _components(self) -> list[DiagnosticStatus]:
        listener, box = self._listener, self._black_box
        trouble = box.trouble or (listener.error if listener else '') or self._changes.error
        return [ros.diagnostic_status(
            'black box', 'error' if trouble else 'ok', trouble or box.outcome, {
                **box.values(), **self._rejections.values(),
                'CAN': listener.channel if listener else 'no SocketCAN interface'})]

    def close(self) -> None:
        """End when what is being written is written."""
        self._take()
        if self._listener is not None:
            self._listener.close()
        self._black_box.close()
        self._changes.close()
        for queues in (self._read, self._kept):
            queues.close()


def recorded_topics() -> list[Topic]:
    """Return the topics that are recorded on this computer."""
    return [one for one in interfaces.TOPICS if one.recorded and ros.is_installed(one)]


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


main = partial(ros.run, lambda: [RecorderNode()], watch_period=PERIOD)

if __name__ == '__main__':
    raise SystemExit(main())
