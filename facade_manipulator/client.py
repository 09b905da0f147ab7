"""
Blocking calls of a supervisor to one manipulator.

::

    with ManipulatorClient() as manipulator:
        manipulator.configure()
        manipulator.home()
        manipulator.activate()
        manipulator.go_to(Pose(0.1, 0.25, 0.0))
        manipulator.deactivate()

Every call has a deadline. A rejected request raises a `ManipulatorError` with the message of the
node. A request for a state that is already reached is not sent.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import cache, cached_property
import math
from threading import Thread
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.srv import GetPlan
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_srvs.srv import Trigger

from facade_manipulator import topics
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Carriages, Pose
from facade_manipulator.messages import seconds, status_values
from facade_manipulator.nodes.conversions import frames, pose_stamped
from facade_manipulator.topics import Service

ANSWER_TIMEOUT = 10.0  # s: the node may have just been started on a busy computer
GOAL_TIMEOUT = 60.0  # s
REPEAT_AFTER = 1.0  # s, until a harmless request without an answer is sent again
SILENCE = 2.0  # s without driver/status, after which the driver counts as silent
SEND_AGAIN = 0.3  # s, until a goal is published again that goal_status does not mention
SENDINGS = 5  # of such a goal
POLL_PERIOD = 0.01  # s, between two checks of a condition
SPIN_PERIOD = 0.1  # s, after which the receiving thread checks whether the client is closed
#: states on driver/status in which the driver works on a request
WORKING = frozenset({
    'configuring', 'homing', 'activating', 'deactivating', 'clearing faults', 'cleaning up'})
FINAL_STATES = frozenset({'reached', 'rejected', 'ended', 'superseded'})  # of a goal
NO_STATE = '', 'no compensator/goal_status'  # of a goal, before its first status


class RequestRejectedError(ManipulatorError):
    """A node rejected a request; the message is the node's reason."""


class NoAnswerError(ManipulatorError):
    """A request was not answered in time."""


class ManipulatorClient:
    """
    Blocking client of one manipulator.

    Parameters
    ----------
    namespace : str
        Namespace of the manipulator's nodes.
    node_name : str
    check : callable, optional
        Called every few milliseconds while a call waits; an exception of it ends the waiting.
    **node_options
        Options of rclpy's Node.

    Attributes
    ----------
    node : rclpy.node.Node
    goal : Pose or None
        The goal that was sent last.

    Notes
    -----
    Not thread-safe. `rclpy.init` must have been called. Messages are received in a thread, so that
    Ctrl-C interrupts a waiting call but no callback: the client can still halt.

    """

    def __init__(
        self, namespace: str = '', node_name: str = 'supervisor',
        check: Callable[[], None] = lambda: None, **node_options: Any,
    ) -> None:
        self.node = Node(node_name, namespace=namespace, **node_options)
        self.goal: Pose | None = None
        self._check = check
        self._frames = frames(self.node)
        # time of reception [s, monotonic] and last driver/status
        self._driver = -math.inf, DiagnosticStatus()
        self._stamp = ''  # of the goal that was sent last
        self._goal_state = NO_STATE
        # stamps and reasons on ik_service/rejections
        self._rejections: deque[tuple[str, str]] = deque(maxlen=10)
        self._client = cache(lambda service: self.node.create_client(*service))
        for (kind, name, qos), receive in (
                (topics.DRIVER_STATUS, self._receive_driver),
                (topics.GOAL_STATUS, self._receive_goal_status),
                (topics.REJECTIONS, self._receive_rejection)):
            self.node.create_subscription(kind, name, receive, qos)
        self._executor = SingleThreadedExecutor(context=self.node.context)
        self._executor.add_node(self.node)
        self._is_closed = False
        self._thread = Thread(target=self._spin, daemon=True)
        self._thread.start()

    def __enter__(self) -> ManipulatorClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the ROS graph; the manipulator continues its task."""
        self._is_closed = True
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()

    def configure(self) -> None:
        """Bring the bus up and check the drives, unless that is done."""
        if self.driver_state() not in ('inactive', 'active'):
            self._change_state('configure')

    def home(self, again: bool = False) -> None:
        """Home all axes, unless all are homed."""
        if again or 'home' in self._driver_status('next step'):
            self._trigger(topics.HOME)

    def activate(self) -> None:
        """Power the drives on, unless that is done; they hold."""
        if self.driver_state() != 'active':
            self._change_state('activate')

    def deactivate(self) -> None:
        """Ramp down and power the drives off."""
        self._change_state('deactivate')

    def cleanup(self) -> None:
        """Close the bus."""
        self._change_state('cleanup')

    def halt(self) -> str:
        """Brake and hold; return the next step."""
        return self._trigger(topics.HALT)

    def clear_faults(self) -> str:
        """Reset the cause of a stop; return the next step."""
        return self._trigger(topics.CLEAR_FAULTS)

    def driver_state(self) -> str:
        """Return the label of the driver's lifecycle state."""
        return self._call(topics.GET_STATE, GetState.Request(), True).current_state.label

    def send_goal(self, pose: Pose) -> str:
        """
        Publish a goal for the head on the wall (frame ``facade``) and return its stamp.

        The stamp identifies the goal on compensator/goal_status; the goal is published again while
        that topic does not mention it. Raises a NoAnswerError without a subscriber.
        """
        goals = self._goal_publisher
        self.wait_until(  # a goal published earlier would miss some subscribers
            lambda: 0 < self.node.count_subscribers(goals.topic) <= goals.get_subscription_count(),
            'a compensator that subscribes to goal_pose')
        message, self._stamp = self._pose(self._frames.facade, pose)
        self.goal, self._goal_state = pose, NO_STATE
        for _ in range(SENDINGS):
            goals.publish(message)
            with suppress(NoAnswerError):
                self.wait_until(lambda: self._goal_state[0], 'goal_status', SEND_AGAIN)
                break
        return self._stamp

    def go_to(self, *goals: Pose, timeout: float = GOAL_TIMEOUT) -> None:
        """
        Move the head along goals on the wall (frame ``facade``); return when the last is reached.

        Raises a RequestRejectedError for a goal that is rejected or no longer followed, and a
        NoAnswerError for a goal that is not reached in time [s]; the head keeps its place.
        """
        for goal in goals:
            self.send_goal(goal)
            try:
                self.wait_until(
                    lambda: self._goal_state[0] in FINAL_STATES, 'the goal', timeout)
            except NoAnswerError as error:
                raise NoAnswerError(f'{error}: {self._goal_state[1]}') from error
            if self._goal_state[0] != 'reached':
                raise RequestRejectedError(self._goal_state[1])

    def solve(self, goal: Pose) -> Carriages:
        """
        Return the carriages [m] of a pose of the head in frame ``rail``.

        Raises a RequestRejectedError with the limit that the pose violates.
        """
        message, stamp = self._pose(self._frames.rail, goal)
        poses = self._call(topics.SOLVE, GetPlan.Request(goal=message), True).plan.poses
        if not poses:
            raise RequestRejectedError(self.wait_until(
                lambda: dict(self._rejections).get(stamp), 'the reason on ik_service/rejections'))
        point = poses[0].pose.position
        return Carriages(point.x, point.y, point.z)

    def wait_until(
        self, condition: Callable[[], Any], what: str, timeout: float = ANSWER_TIMEOUT
    ) -> Any:
        """Return the first true value of a condition; raises a NoAnswerError after a time [s]."""
        end = time.monotonic() + timeout
        while not (value := condition()):
            if time.monotonic() > end:
                raise NoAnswerError(f'timed out after {timeout:g} s waiting for {what}')
            self._check()
            time.sleep(POLL_PERIOD)
        return value

    def _call(self, service: Service, request: Any, is_harmless: bool = False) -> Any:
        """
        Return the response to a request.

        Fast DDS may lose a request to a node that has just started (its issues 2641 and 3009). A
        harmless request is repeated until it is answered. Any other request is sent once, after
        the driver has answered a harmless one. Raises a NoAnswerError after a time in which the
        driver does not work on a request.
        """
        if not is_harmless:
            self.driver_state()
        client, answers = self._client(service), list[Any]()
        self.wait_until(client.service_is_ready, f'service {service.name}')
        end = time.monotonic() + ANSWER_TIMEOUT
        while time.monotonic() < end:
            if is_harmless or not answers:
                answers.append(client.call_async(request))
            with suppress(NoAnswerError):
                return self.wait_until(
                    lambda: next((one.result() for one in answers if one.done()), None),
                    service.name, REPEAT_AFTER)
            is_silent = time.monotonic() - self._driver[0] > SILENCE
            if not is_silent and self._driver_status('state') in WORKING:
                end = time.monotonic() + ANSWER_TIMEOUT
        raise NoAnswerError(
            f'timed out after {ANSWER_TIMEOUT:g} s waiting for the answer of {service.name}')

    def _driver_status(self, key: str) -> str:
        """Return a value of a new or the present driver/status."""
        self.wait_until(lambda: time.monotonic() - self._driver[0] < SILENCE, 'driver/status')
        return status_values(self._driver[1]).get(key, '')

    def _trigger(self, service: Service) -> str:
        response = self._call(service, Trigger.Request())
        if not response.success:
            raise RequestRejectedError(f'{service.name} rejected: {response.message}')
        return response.message

    def _change_state(self, label: str) -> None:
        begin = time.monotonic()
        request = ChangeState.Request(transition=Transition(label=label))
        if not self._call(topics.CHANGE_STATE, request).success:
            with suppress(NoAnswerError):  # the response itself has no room for a reason
                self.wait_until(lambda: self._driver[0] >= begin, 'driver/status', SILENCE)
            raise RequestRejectedError(f'{label} rejected: {self._driver[1].message}')

    @cached_property
    def _goal_publisher(self) -> Publisher:
        """Return a publisher, made for the first goal: an observer needs no permission for it."""
        return self.node.create_publisher(*topics.GOAL_POSE)

    def _pose(self, frame_id: str, pose: Pose) -> tuple[PoseStamped, str]:
        """Return a message and its stamp as the values of a status have it."""
        message = pose_stamped(frame_id, seconds(self.node.get_clock().now().to_msg()), pose)
        return message, f'{message.header.stamp.sec}.{message.header.stamp.nanosec:09d}'

    def _receive_driver(self, status: DiagnosticStatus) -> None:
        self._driver = time.monotonic(), status

    def _receive_goal_status(self, status: DiagnosticStatus) -> None:
        values = status_values(status)
        if values.get('rejected goal stamp') == self._stamp:
            self._goal_state = 'rejected', f'rejected: {values.get("rejection")}'
        elif values.get('goal stamp') == self._stamp:
            self._goal_state = values.get('state', ''), status.message

    def _receive_rejection(self, status: DiagnosticStatus) -> None:
        self._rejections.append((status_values(status).get('goal stamp', ''), status.message))

    def _spin(self) -> None:
        while self.node.context.ok() and not self._is_closed:
            with suppress(Exception):  # a malformed message must not end the client
                self._executor.spin_once(SPIN_PERIOD)
