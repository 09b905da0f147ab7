"""
Blocking client for a supervisor of one manipulator.

::

    with ManipulatorClient() as manipulator:
        manipulator.configure()
        manipulator.home()
        manipulator.activate()
        manipulator.go_to(Pose(0.1, 0.25, 0.0))
        manipulator.deactivate()

Every call has a deadline, which is extended while the driver executes a request. A rejected
request raises a `ManipulatorError` with the message of the node. A request for a state that is
already reached is not sent.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from functools import cache, partial
import math
from threading import Thread
import time
from typing import Any, NamedTuple

from lifecycle_msgs.msg import Transition
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from facade_manipulator import topics
from facade_manipulator.errors import attributed, ManipulatorError, NEXT
from facade_manipulator.kinematics import Carriages, Pose
from facade_manipulator.nodes.conversions import pose_stamped, ros_time
from facade_manipulator.nodes.driver_status import DRIVER_SILENCE, SILENT
from facade_manipulator.nodes.planar_messages import (
    Frames,
    stamp_text,
    status_level,
    status_values,
)

Callback = Callable[[], Any]


class RequestRejectedError(ManipulatorError):
    """A node rejected a request; the message contains the node's reason."""


class NoAnswerError(ManipulatorError):
    """A node did not answer a request in time."""


class GoalProgress(NamedTuple):
    """Progress of a goal, received on compensator/goal_status."""

    state: str  #: such as ``'moving'`` or ``'held back'``
    distance: float  #: of the measured head from the goal [m], NaN where unknown
    angle: float  #: of the measured head from the goal [rad], NaN where unknown
    message: str  #: state, reason and next step


class GoalNotReachedError(NoAnswerError):
    """
    The head did not reach a goal in time; the goal remains active.

    `progress` is the progress of the goal at the timeout.
    """

    def __init__(self, message: str, progress: GoalProgress) -> None:
        super().__init__(message)
        self.progress = progress


class ManipulatorStatus(NamedTuple):
    """State of the drives, received in the newest message on driver/status."""

    state: str  #: such as ``'active'`` or ``'stopped'``; ``'silent'`` without messages
    level: str  #: ok, warn, error or stale
    message: str  #: state, most severe problem and next step
    next_step: str  #: of the operator, ``''`` while goals are followed
    power: str  #: of the drives by their statuswords: confirmed off, unknown or on


class ManipulatorClient(AbstractContextManager['ManipulatorClient']):
    """
    Blocking client of one manipulator.

    Parameters
    ----------
    namespace : str
        Namespace of the manipulator's nodes.
    node_name : str
    check : callable, optional
        Called every few milliseconds while a call waits; its exception ends the wait.

    Attributes
    ----------
    node : rclpy.node.Node
    goal : Pose or None
        The last goal sent.
    answer_timeout : float
        Longest wait for an answer of a node [s].
    repeat_after : float
        Time until a harmless request without an answer is sent again [s].
    silence : float
        Time without driver/status after which the driver counts as silent [s].

    Notes
    -----
    Not thread-safe. `rclpy.init` must have been called. Messages are received in a thread, so that
    Ctrl-C interrupts a waiting call but no callback: the client can still halt.

    """

    ANSWER_TIMEOUT = 10.0  # s; the node may have just been started on a busy computer
    REPEAT_AFTER = 1.0  # s, until a harmless request without an answer is sent again
    #: states on driver/status while the driver executes a request
    WORKING = frozenset(
        {
            'configuring',
            'homing',
            'activating',
            'deactivating',
            'clearing faults',
            'cleaning up',
        }
    )
    #: states on driver/status that are older than a driver with another lifecycle state
    OUTDATED_STATES = frozenset({'unconfigured', 'configuring'})
    START_NODES = 'start the nodes in the same namespace and ROS domain as this program'
    CHECK_DRIVER = 'check whether the driver still runs'
    CHECK_GOAL = (
        'check the distance on compensator/goal_status, or increase the timeout'
    )
    # Fast DDS (its issue 5258) finds nodes of another user, but receives no message from them
    SAME_USER = (
        'start this program as the user of the nodes, or set '
        'FASTDDS_BUILTIN_TRANSPORTS=UDPv4 for it and the nodes'
    )
    #: progress of a goal whose messages were lost, such as behind those of other goals
    UNKNOWN_PROGRESS = GoalProgress(
        'unknown', math.nan, math.nan, 'the state of the goal is unknown'
    )
    SILENT_DRIVER = ManipulatorStatus(
        SILENT.state,
        'stale',
        f'{SILENT}{NEXT}{SILENT.next_step}',
        SILENT.next_step,
        'unknown',
    )

    def __init__(
        self,
        namespace: str = '',
        node_name: str = 'supervisor',
        check: Callback = lambda: None,
    ) -> None:
        self.node = Node(node_name, namespace=namespace)
        self.goal: Pose | None = None
        self.answer_timeout = self.ANSWER_TIMEOUT
        self.repeat_after = self.REPEAT_AFTER
        self.silence = DRIVER_SILENCE
        self._stamp = ''  # of the last goal sent
        self._check = check
        self._frames = Frames.of(namespace)
        # the last messages of each topic: time of reception [s, monotonic], values and text
        self._received: dict[topics.Topic, deque[tuple[float, dict[str, str]]]] = {}
        for topic in (topics.DRIVER_STATUS, topics.GOAL_STATUS, topics.REJECTIONS):
            self._received[topic] = deque([(-math.inf, {})], maxlen=10)
            receive = partial(self._receive, topic)
            self.node.create_subscription(
                topic.type, topic.name, receive, topic.subscription_qos
            )
        self._client = cache(lambda service: self.node.create_client(*service))
        # created with the first goal: an observer needs no permission to publish
        self._publisher = cache(lambda topic: self.node.create_publisher(*topic))
        self._executor = SingleThreadedExecutor(context=self.node.context)
        self._executor.add_node(self.node)
        self._is_closed = False
        self._thread = Thread(target=self._spin, daemon=True)
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the ROS graph; the manipulator continues its task."""
        self._is_closed = True
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()

    @property
    def status(self) -> ManipulatorStatus:
        """Return the state of the drives; it is ``'silent'`` while the driver is silent."""
        values = self._driver_values()
        if not values:
            return self.SILENT_DRIVER
        return ManipulatorStatus(
            values.get('state', ''),
            values['level'],
            values['message'],
            values.get('next step', ''),
            values.get('power', 'unknown'),
        )

    @property
    def progress(self) -> GoalProgress | None:
        """Return the progress of the last goal sent; None before it is reported."""
        values = self._of_goal(self._stamp)
        if not self._stamp or not values:
            return None
        # otherwise the values belong to another goal
        if values.get('rejected goal stamp') == self._stamp:
            return GoalProgress('rejected', math.nan, math.nan, values['rejection'])
        return GoalProgress(
            values.get('state', ''),
            1e-3 * float(values.get('distance [mm]', 'nan')),
            math.radians(float(values.get('angle [deg]', 'nan'))),
            values['message'],
        )

    def configure(self) -> None:
        """Open the bus and check the drives, unless they are already configured."""
        self._change_state('configure', 'inactive', 'active')

    def home(self, again: bool = False) -> None:
        """Home all axes, unless they are all homed."""
        if again or 'home' in self._next_driver_values()['next step']:
            self._trigger(topics.HOME)

    def activate(self) -> None:
        """Power the drives on, unless they already have power; the axes hold their positions."""
        self._change_state('activate', 'active')

    def deactivate(self) -> None:
        """Brake to rest, and power the drives off."""
        self._change_state('deactivate')

    def cleanup(self) -> None:
        """Close the bus, as the first step of recovery from a lost bus or a restarted drive."""
        self._change_state('cleanup')

    def halt(self) -> str:
        """Brake and hold; return a message with the next step."""
        return self._trigger(topics.HALT)

    def clear_faults(self) -> str:
        """Clear the cause of a stop; return a message with the next step."""
        return self._trigger(topics.CLEAR_FAULTS)

    def driver_state(self) -> str:
        """Return the label of the driver's lifecycle state."""
        return self._call(topics.GET_STATE, is_harmless=True).current_state.label

    def send_goal(self, pose: Pose) -> str:
        """
        Publish a goal for the head on the wall (frame ``facade``); return its stamp.

        The stamp identifies the goal on compensator/goal_status. The goal is published again until
        that topic reports the stamp. Raises a NoAnswerError if no compensator answers.
        """
        goals = self._publisher(topics.GOAL_POSE)
        # otherwise the stamp would age
        self.wait_until(
            goals.get_subscription_count, 'a compensator', next_step=self.START_NODES
        )

        message = pose_stamped(self._frames.facade, ros_time(), pose)
        stamp = stamp_text(message.header.stamp)
        self.goal = pose
        self._stamp = stamp

        def publish_again() -> bool:
            """Publish the goal again; return whether all compensators have reported it."""
            goals.publish(message)  # discovery of a subscriber may be late
            matched = goals.get_subscription_count()
            all_matched = matched >= self.node.count_subscribers(goals.topic)
            return all_matched and bool(self._of_goal(stamp))

        self.wait_until(
            publish_again, 'a compensator to report the goal', next_step=self.SAME_USER
        )
        return stamp

    def go_to(self, *goals: Pose, timeout: float = 60.0) -> None:
        """
        Move the head to successive goals on the wall (frame ``facade``); return at the last goal.

        Raises a RequestRejectedError for a goal that is rejected or no longer followed. Raises a
        GoalNotReachedError for a goal that is not reached within the timeout [s]; this goal stays
        in force.
        """
        for goal in goals:
            stamp = self.send_goal(goal)
            try:
                self.wait_until(partial(self._is_reached, stamp), 'the goal', timeout)
            except NoAnswerError as error:
                raise self._not_reached_error(str(error)) from error

    def _not_reached_error(self, problem: str) -> GoalNotReachedError:
        """Return the error for the last goal sent, with its progress and a next step."""
        progress = self.progress or self.UNKNOWN_PROGRESS
        next_step = '' if NEXT in progress.message else f'{NEXT}{self.CHECK_GOAL}'
        return GoalNotReachedError(
            f'{problem}: {progress.message}{next_step}', progress
        )

    def solve(self, goal: Pose) -> Carriages:
        """
        Return the carriage positions [m] for a head pose in frame ``rail``.

        Raises a RequestRejectedError with the limit that the pose violates.
        """
        message = pose_stamped(self._frames.rail, ros_time(), goal)
        poses = self._call(topics.SOLVE, is_harmless=True, goal=message).plan.poses
        if not poses:
            stamp = stamp_text(message.header.stamp)
            rejection = self.wait_until(
                partial(self._of_goal, stamp, topics.REJECTIONS),
                'the reason on ik_service/rejections',
                next_step='read the reason in the log of the ik_service',
            )
            raise RequestRejectedError(rejection['message'])
        point = poses[0].pose.position
        return Carriages(point.x, point.y, point.z)

    def wait_until(
        self,
        condition: Callback,
        what: str,
        timeout: float | None = None,
        next_step: str = '',
    ) -> Any:
        """
        Wait until a condition is true, and return its value.

        Raises a NoAnswerError at a timeout [s], by default `answer_timeout`, with the next step of
        the operator if given.
        """
        timeout = self.answer_timeout if timeout is None else timeout
        end = time.monotonic() + timeout
        while not (value := condition()):
            if time.monotonic() > end:
                advice = f'; next: {next_step}' if next_step else ''
                raise NoAnswerError(
                    f'timed out after {timeout:g} s waiting for {what}{advice}'
                )
            self._check()
            time.sleep(0.01)  # s, between two checks of the condition
        return value

    def _call(
        self, service: topics.Service, is_harmless: bool = False, **fields: Any
    ) -> Any:
        """
        Return the response to a request with the given fields.

        Fast DDS may lose a request to a node that has just started (its issues 2641 and 3009). A
        harmless request is repeated until it is answered. Any other request is sent once; its
        caller waits for the answer to `driver_state` first. Raises a NoAnswerError after
        `answer_timeout` while the driver executes no request.
        """
        client = self._client(service)
        requests: list[Any] = []

        def response() -> Any:
            for request in requests:
                if request.done():
                    return request.result()
            return None

        self.wait_until(
            client.service_is_ready,
            f'service {service.name}',
            next_step=self.START_NODES,
        )

        def send() -> None:
            if is_harmless or not requests:
                requests.append(client.call_async(service.type.Request(**fields)))

        send()
        what = f'the answer of {service.name}'
        return self._wait_repeating(response, what, send, self.SAME_USER)

    def _wait_repeating(
        self, condition: Callback, what: str, repeat: Callback, next_step: str
    ) -> Any:
        """
        Wait like `wait_until`, and call a function every `repeat_after`.

        Raises a NoAnswerError after `answer_timeout` while the driver executes no request.
        """
        end = time.monotonic() + self.answer_timeout
        while True:
            with suppress(NoAnswerError):
                return self.wait_until(condition, what, self.repeat_after)
            if self._driver_values().get('state') in self.WORKING:
                end = time.monotonic() + self.answer_timeout
            if time.monotonic() >= end:
                raise NoAnswerError(
                    f'timed out after {self.answer_timeout:g} s waiting for {what}; '
                    f'next: {next_step}'
                )
            repeat()

    def _trigger(self, service: topics.Service) -> str:
        """
        Call a service of the driver without arguments; return its message.

        Raises a RequestRejectedError if the request fails.
        """
        self.driver_state()
        response = self._call(service)
        if not response.success:
            name = service.name.removeprefix('driver/')
            raise RequestRejectedError(attributed(name, 'rejected', response.message))
        return response.message

    def _change_state(self, label: str, *reached: str) -> None:
        """Request a transition, unless the driver is already in a state listed in `reached`."""
        if self.driver_state() in reached:
            return
        response = self._call(topics.CHANGE_STATE, transition=Transition(label=label))
        if not response.success:
            # The response cannot contain a reason, and the driver repeats the reason until the
            # next request.
            reason = self._next_driver_values()['message']
            raise RequestRejectedError(attributed(label, 'rejected', reason))

    def _next_driver_values(self) -> dict[str, str]:
        """
        Return the values of the next message on driver/status.

        A message from before the last transition may arrive after its response. Such a message is
        skipped if it contradicts the label of the lifecycle state. The label is requested again,
        because it follows the state of the drives a moment later, such as after a failed cleanup.
        """
        label = self.driver_state()
        begin = time.monotonic()
        reports = self._received[topics.DRIVER_STATUS]

        def present() -> dict[str, str] | None:
            received, values = reports[-1]
            is_older = (
                values.get('state') in self.OUTDATED_STATES
                and label not in self.OUTDATED_STATES
            )
            return None if received < begin or is_older else values

        def update_label() -> None:
            nonlocal label
            label = self.driver_state()

        return self._wait_repeating(
            present, 'driver/status', update_label, self.CHECK_DRIVER
        )

    def _driver_values(self) -> dict[str, str]:
        """Return the values of driver/status; empty while the driver is silent."""
        received, values = self._received[topics.DRIVER_STATUS][-1]
        return values if time.monotonic() - received < self.silence else {}

    def _is_reached(self, stamp: str) -> bool:
        """Return whether a goal is reached; raise a RequestRejectedError if it has failed."""
        values = self._of_goal(stamp)
        if values.get('rejected goal stamp') == stamp:
            raise RequestRejectedError(f'rejected: {values["rejection"]}')
        if values.get('state') in ('ended', 'superseded'):
            raise RequestRejectedError(values['message'])
        return values.get('state') == 'reached'

    def _of_goal(
        self, stamp: str, topic: topics.Topic = topics.GOAL_STATUS
    ) -> dict[str, str]:
        """Return the newest values on a topic that belong to the goal with a stamp."""
        for _, values in reversed(list(self._received[topic])):
            if stamp in (values.get('goal stamp'), values.get('rejected goal stamp')):
                return values
        return {}

    def _receive(self, topic: topics.Topic, status: Any) -> None:
        """Store the values of a status message and its time of reception."""
        values = status_values(status)
        values['message'] = status.message
        values['level'] = status_level(status)
        self._received[topic].append((time.monotonic(), values))

    def _spin(self) -> None:
        while self.node.context.ok() and not self._is_closed:
            with suppress(Exception):  # a malformed message must not end the client
                self._executor.spin_once(0.1)  # s, between two checks whether to end
