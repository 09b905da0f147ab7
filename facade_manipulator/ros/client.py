"""
A supervisor to copy: the manipulator's services and topics as blocking calls of one object.

::

    with ManipulatorClient() as manipulator:
        manipulator.configure()
        manipulator.home()
        manipulator.activate()
        manipulator.go_to(Pose(0.1, 0.25, 0.0))
        manipulator.deactivate()

Every call has a deadline, and what a node rejects is raised with the node's own message. A request
for a state that is reached already is not sent; its reply says so.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache, partial
import signal
import time
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.srv import GetPlan
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from facade_manipulator import interfaces
from facade_manipulator.diagnostics import DiagnosticComponent, OPERATION, Report
from facade_manipulator.errors import InputError, ManipulatorError
from facade_manipulator.interfaces import Service, Topic
from facade_manipulator.kinematics import Carriages, difference, Pose
from facade_manipulator.messages import millimetres, readable_pose, status_level, status_values
from facade_manipulator.ros.conversions import frames, node_time, pose_stamped
from facade_manipulator.ros.diagnostics import REJECTED_STAMP, stamp_text
from facade_manipulator.ros.interfaces import client, publisher
from facade_manipulator.ros.message_queues import MessageQueues

ANSWER_TIMEOUT = 5.0  # s
CONFIGURE_TIMEOUT = 30.0  # s
#: states in which the driver works on a request: it takes as long as the drives do
WORKING = frozenset({
    'configuring', 'homing', 'activating', 'deactivating', 'clearing faults', 'cleaning up'})
ACTIVE = 'active'  # lifecycle state, and state of the drives
CONFIGURED = frozenset({'inactive', ACTIVE})  # lifecycle states
NEWS = 3.0  # s, three periods of /diagnostics: a driver that said nothing since is silent
# s, more than a node takes to start, after which a request is sent once more: Fast DDS may lose
# one that is sent as soon as its service is found (its issues 2641 and 3009), 1 of 70 to a driver
# that starts on a busy computer
REQUEST_AGAIN = 3.0
REASON_TIMEOUT = 1.5  # s
GOAL_TIMEOUT = 60.0  # s
REACHED, OVER = 'reached', ('rejected', 'ended', 'superseded')  # states of a goal
STANDS_WITHIN, STANDS_FOR = 2e-4, 1.0  # m or rad, s
SENDINGS, SEND_AGAIN = 5, 0.3  # of a goal of which compensator/goal_status says nothing yet, s
KEPT = interfaces.REJECTIONS.quality.depth  # statuses, in which one looks for those of a goal
SPIN_STEP = 0.02  # s, after which a waiting call looks at its condition again
# of what /diagnostics brings, whoever publishes: namespaces, components of each, characters of one
GONDOLAS, COMPONENTS, LONGEST = 32, 64, 20_000
DIAGNOSTICS = GONDOLAS * len(interfaces.NODES)  # messages a second of as many gondolas

Value = TypeVar('Value')


class RequestRejectedError(ManipulatorError):
    """A node rejected a request; the message is the node's reason."""


class NoAnswerError(ManipulatorError):
    """Nobody answered a request in time."""


@contextmanager
def interrupted_later() -> Iterator[None]:
    """
    Raise Ctrl-C's KeyboardInterrupt at the end of the context.

    Raised within rclpy's executor, it may leave a callback for ever about to be called, and no
    other of the node is: whoever then wants to halt has no answer.
    """
    interrupts: list[int] = []
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield  # somebody else's, and no exception
        return
    with suppress(ValueError):  # in another thread none is raised
        signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))
    try:
        yield
    finally:
        with suppress(ValueError):
            signal.signal(signal.SIGINT, signal.default_int_handler)
    if interrupts:
        raise KeyboardInterrupt


class ManipulatorClient:
    """
    Blocking client of one manipulator.

    Parameters
    ----------
    namespace : str
        Namespace of the manipulator's nodes.
    node_name : str
    check : callable, optional
        Called every few milliseconds while a call waits; what it raises ends the waiting.
    **node_options
        Of rclpy's Node.

    Notes
    -----
    Not thread-safe: one client, one thread. `rclpy.init` must have been called.

    """

    def __init__(
        self, namespace: str = '', node_name: str = 'supervisor',
        check: Callable[[], None] = lambda: None, **node_options: Any,
    ) -> None:
        self._check = check
        self.node = Node(node_name, namespace=namespace, **node_options)
        self.namespace = self.node.get_namespace().strip('/')
        self._frames = frames(self.node)
        #: of every namespace, by it and the name without it
        self.gondolas: dict[str, dict[str, Report]] = {}
        self.head_in_rail: Pose | None = None
        self.goal: Pose | None = None
        self.goal_status: DiagnosticStatus | None = None
        self._rejections: deque[DiagnosticStatus] = deque(maxlen=KEPT)
        self._progress: deque[DiagnosticStatus] = deque(maxlen=KEPT)
        # made when asked for: an observer has no right to move anything
        self._publisher = cache(partial(publisher, self.node))
        self._client = cache(partial(client, self.node))
        self._queues = MessageQueues(self.node)
        self.subscribe(interfaces.DIAGNOSTICS, self._receive_diagnostics, DIAGNOSTICS)
        self.subscribe(interfaces.IK_STATUS, self._receive_goal_status, 1)
        self.subscribe(interfaces.REJECTIONS, lambda _, one: self._rejections.append(one), KEPT)
        self.subscribe(interfaces.GOAL_STATUS, lambda _, one: self._progress.append(one), KEPT)
        self.subscribe(interfaces.END_EFFECTOR_POSE, self._receive_head, 1)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)

    def subscribe(self, topic: Topic, receive: Callable[[float, Any], None], depth: int) -> None:
        """
        Let a function receive when a message came [s, monotonic], and that, as the client waits.

        Of what came since, it is called for the last `depth` messages.
        """
        self._queues.subscribe(topic, depth, lambda queue, messages: queue.read(
            messages, receive, suppress(InputError)))

    def _receive_goal_status(self, _: float, status: DiagnosticStatus) -> None:
        self.goal_status = status

    def __enter__(self) -> ManipulatorClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the ROS graph; the manipulator goes on as it is."""
        self._executor.shutdown()
        self._queues.close()
        self.node.destroy_node()

    def component(self, name: str) -> Report | None:
        """Return what /diagnostics last said of a component of this manipulator."""
        return self.gondolas.get(self.namespace, {}).get(name)

    def value(self, component: DiagnosticComponent, key: str) -> str | None:
        """Return one value of a component's diagnostics, None before one came."""
        known = self.component(str(component))
        return status_values(known.status).get(component.key(key)) if known else None

    def spin(self, duration: float) -> None:
        """Process what has come, and what arrives for a while [s]."""
        end, left = time.monotonic() + duration, duration
        while left >= 0.0:
            self._turn(min(left, SPIN_STEP))
            left = end - time.monotonic()

    def _turn(self, longest: float = SPIN_STEP) -> None:
        self._check()
        with interrupted_later():
            self._executor.spin_once(longest)
        self._queues.take()

    def wait_until(
        self, condition: Callable[[], Value | None], what: str, timeout: float = ANSWER_TIMEOUT
    ) -> Value:
        """
        Return the condition's first true value.

        Raises
        ------
        NoAnswerError
            It was not true within `timeout` [s].

        """
        end = time.monotonic() + timeout
        while not (value := condition()):
            if time.monotonic() > end:
                raise NoAnswerError(f'{what}: not within {timeout:g} s')
            self._turn()
        return value

    def configure(self) -> str:
        """Bring the bus up and check the drives, unless that is done; return what was done."""
        state = self.driver_state(CONFIGURE_TIMEOUT)  # a driver may just have been started
        if state in CONFIGURED:
            return self._nothing_to_do('configure', f'the driver is {state}')
        return self._change_state('configure', CONFIGURE_TIMEOUT)

    def activate(self) -> str:
        """Power the drives on, unless they follow goals; they hold. Return what was done."""
        if self.driver_state() == ACTIVE and self._latest('state') == ACTIVE:
            return self._nothing_to_do('activate', 'the drives are active')
        return self._change_state('activate')

    def deactivate(self) -> None:
        """Ramp down and power off."""
        self._change_state('deactivate')

    def cleanup(self) -> None:
        """Let go of the bus."""
        self._change_state('cleanup')

    def driver_state(self, timeout: float = ANSWER_TIMEOUT) -> str:
        """Return the label of the driver's lifecycle state, within a time [s]."""
        return self.call(interfaces.GET_STATE, GetState.Request(), timeout).current_state.label

    def home(self, again: bool = False) -> str:
        """Home all axes, unless they are homed; return the driver's report."""
        if not again and self._latest('not homed') == '':
            return self._nothing_to_do('home', 'all axes are homed')
        return self._trigger(interfaces.HOME)

    def halt(self) -> str:
        """Brake and hold; return the driver's next step."""
        return self._trigger(interfaces.HALT)

    def clear_faults(self) -> str:
        """Reset what stopped the drives; return the driver's next step."""
        return self._trigger(interfaces.CLEAR_FAULTS)

    def enable_compensation(self, enabled: bool = True) -> str:
        """Fade the compensation in or out."""
        reply = self.call(interfaces.ENABLE, SetBool.Request(data=enabled))
        return _message(interfaces.ENABLE, reply)

    def tare(self) -> str:
        """Make the present disturbance the nominal position of the gondola."""
        return self._trigger(interfaces.TARE)

    def send_goal(self, pose: Pose) -> str:
        """
        Send a goal for the head on the wall (frame ``facade``), until it has arrived.

        It is sent a few times, within 1.5 s, where `compensator/goal_status` does not mention it.
        Return its stamp, by which that names it.

        Raises
        ------
        NoAnswerError
            Nobody subscribes to goals.

        """
        goals = self._publisher(interfaces.GOAL_POSE)
        topic = self.node.resolve_topic_name(interfaces.GOAL_POSE.name)
        self.wait_until(  # all who subscribe: a goal published before would miss some
            lambda: 0 < self.node.count_subscribers(topic) <= goals.get_subscription_count(),
            'a compensator that subscribes to goal_pose')
        self.goal = pose
        self._progress.clear()
        message = pose_stamped(self._frames.facade, node_time(self.node), pose)
        stamp = stamp_text(message.header.stamp)
        for _ in range(SENDINGS):
            goals.publish(message)
            with suppress(NoAnswerError):  # the compensator may not be discovered yet, others are
                self.wait_until(lambda: _newest(self._progress, stamp), 'the goal to arrive',
                                SEND_AGAIN)
                break
        return stamp

    def go_to(self, *goals: Pose, timeout: float = GOAL_TIMEOUT,
              on_progress: Callable[[int, DiagnosticStatus], None] = lambda *_: None) -> None:
        """
        Move the head along goals on the wall (frame ``facade``); return when the last is reached.

        Parameters
        ----------
        *goals : Pose
            One after the other; each is left as soon as it is reached.
        timeout : float
            For each of them [s].
        on_progress : callable
            Takes the number of the goal, from 0, and every new `compensator/goal_status` of it.

        Raises
        ------
        RequestRejectedError
            A goal is rejected or not followed any more, with the reason; the head stays.
        NoAnswerError
            A goal is not reached in time, with what was said of it last.

        """
        for number, goal in enumerate(goals):
            stamp = self.send_goal(goal)
            self._await_goal(stamp, timeout, partial(on_progress, number))

    def _await_goal(
        self, stamp: str, timeout: float, on_progress: Callable[[DiagnosticStatus], None]
    ) -> None:
        end, last = time.monotonic() + timeout, None
        while time.monotonic() < end:
            status = _newest(self._progress, stamp)
            if status is not None and status is not last:
                last = status
                on_progress(status)
                values = status_values(status)
                if values.get(REJECTED_STAMP) == stamp:
                    raise RequestRejectedError(f'rejected: {values["rejection"]}')
                if values.get('state') in OVER:
                    raise RequestRejectedError(status.message)
                if values.get('state') == REACHED:
                    return
            self._turn()
        raise NoAnswerError(f'the goal was not reached within {timeout:g} s: '
                            f'{last.message if last else "no compensator/goal_status"}')

    def stand_at(self, pose: Pose, timeout: float = GOAL_TIMEOUT) -> None:
        """
        Move the head to a pose on the rail, without a compensator; return when it stands there.

        Parameters
        ----------
        pose : Pose
            In frame ``rail``.
        timeout : float
            [s].

        Raises
        ------
        RequestRejectedError
            A compensator publishes corrected poses too, or the drives are stopped.
        NoAnswerError
            Nobody subscribes to corrected poses, or the head does not get there in time.

        """
        on_rail = self._publisher(interfaces.CORRECTED_POSE)
        self.wait_until(on_rail.get_subscription_count, 'an ik_service', timeout)
        topic = self.node.resolve_topic_name(interfaces.CORRECTED_POSE.name)
        if self.node.count_publishers(topic) > 1:
            raise RequestRejectedError(
                'a compensator publishes corrected_pose: start driver and ik_service alone')
        end = time.monotonic() + timeout
        while time.monotonic() < end:  # again where a stream that was interrupted has left it
            on_rail.publish(pose_stamped(self._frames.rail, node_time(self.node), pose))
            head = self._await_rest(timeout)
            if _distance(head, pose) < STANDS_WITHIN:
                return
            operation = self.component(str(OPERATION))
            if operation is not None and status_level(operation.status) == 'error':
                raise RequestRejectedError(operation.status.message)
        raise NoAnswerError(
            f'the head stands at {millimetres(head)}, not at {millimetres(pose)}, for '
            f'{timeout:g} s: ik_service/status and /diagnostics say why')

    def _await_rest(self, timeout: float) -> Pose:
        """Wait until the head has not moved for a while; return where it is."""
        since, place = time.monotonic(), self.head_in_rail

        def rests() -> Pose | None:
            nonlocal since, place
            head = self.head_in_rail
            if head is None or place is None or _distance(head, place) > STANDS_WITHIN:
                since, place = time.monotonic(), head
            return head if time.monotonic() - since > STANDS_FOR else None

        return self.wait_until(rests, 'a head at rest', timeout)

    def hold(self) -> str:
        """End the way to the goal; the head stays on the wall."""
        return self._trigger(interfaces.HOLD)

    def solve(
        self, goal: Pose, start: Pose | None = None, spacing: float = 0.0
    ) -> list[Carriages]:
        """
        Ask ik_service for the carriages of a goal, or of the straight path to it.

        Parameters
        ----------
        goal, start : Pose
            In frame ``rail``.
        spacing : float
            Distance of the path's poses [m]; 0 leaves it to ik_service.

        Raises
        ------
        RequestRejectedError
            With the limit that a pose violates.

        """
        now = node_time(self.node)
        rail = self._frames.rail
        request = GetPlan.Request(goal=pose_stamped(rail, now, goal), tolerance=spacing)
        if start is not None:
            request.start = pose_stamped(rail, now, start)
        self._rejections.clear()
        plan = self.call(interfaces.SOLVE, request).plan
        if not plan.poses:
            status = self.wait_until(
                lambda: _newest(self._rejections, stamp_text(request.goal.header.stamp)),
                'the reason on ik_service/rejections')
            raise RequestRejectedError(status.message)
        points = [item.pose.position for item in plan.poses]
        return [Carriages(point.x, point.y, point.z) for point in points]

    def call(self, service: Service, request: Any, timeout: float = ANSWER_TIMEOUT) -> Any:
        """
        Call a service of the manipulator and return its response.

        A request without an answer is sent once more; where both are answered, a success counts.
        Raises a NoAnswerError after a time [s] in which the driver does not work on a request.
        """
        caller = self._client(service)
        self.wait_until(caller.service_is_ready, f'service {service.name}', timeout)
        what, sent = f'the answer of {service.name}', list[Any]()
        for patience in (min(REQUEST_AGAIN, timeout), timeout):
            sent.append(caller.call_async(request))
            with suppress(NoAnswerError):
                self._wait_for_success(sent, what, patience)
                break
        answers = [one.result() for one in sent if one.done()]
        if not answers:
            raise NoAnswerError(f'{what}: not within {timeout:g} s')
        return next(filter(_is_success, answers), answers[-1])

    def _wait_for_success(self, sent: list[Any], what: str, patience: float) -> None:
        """Wait until a request has succeeded or all have been answered."""
        def is_over() -> bool:
            answers = [one.result() for one in sent if one.done()]
            return len(answers) == len(sent) or any(map(_is_success, answers))

        while not is_over():
            try:
                self.wait_until(is_over, what, patience)
            except NoAnswerError:
                if not self._is_driver_working():
                    raise

    def _is_driver_working(self) -> bool:
        operation = self.component(str(OPERATION))
        return (operation is not None and time.monotonic() - operation.received < NEWS
                and self.value(OPERATION, 'state') in WORKING)

    def _trigger(self, service: Service) -> str:
        return _message(service, self.call(service, Trigger.Request()))

    def _nothing_to_do(self, request: str, reason: str) -> str:
        message = f'{request}: nothing to do, {reason}'
        self.node.get_logger().info(message)
        return message

    def _latest(self, key: str) -> str | None:
        """Return a value that the driver publishes from now on, None if it is silent."""
        begin = time.monotonic()

        def has_come() -> bool:
            component = self.component(str(OPERATION))
            return component is not None and component.received >= begin

        with suppress(NoAnswerError):
            self.wait_until(has_come, 'driver: operation in /diagnostics', REASON_TIMEOUT)
            return self.value(OPERATION, key)
        return None

    def _change_state(self, label: str, timeout: float = ANSWER_TIMEOUT) -> str:
        begin = time.monotonic()
        request = ChangeState.Request(transition=Transition(label=label))
        if not self.call(interfaces.CHANGE_STATE, request, timeout).success:
            raise RequestRejectedError(f'{label}: {self._driver_reason(begin)}')
        return f'{label}: done'

    def _driver_reason(self, since: float) -> str:
        """Return the driver's message; a transition's reply itself has no room for one."""
        def reason() -> str | None:
            component = self.component(str(OPERATION))
            return component.status.message if component and component.received >= since else None

        try:
            return self.wait_until(reason, 'the reason in /diagnostics', REASON_TIMEOUT)
        except NoAnswerError:
            return 'rejected; the reason stands in the log of the driver'

    def _receive_diagnostics(self, came: float, message: DiagnosticArray) -> None:
        for status in message.status:
            if _length(status) > LONGEST:
                continue  # none of ours: who needs it hears that its component is silent
            namespace, _, name = status.name.rpartition('/')
            gondola = self.gondolas.get(namespace, {})
            _keep(gondola, name, Report(came, status), COMPONENTS)
            _keep(self.gondolas, namespace, gondola, GONDOLAS)

    def _receive_head(self, _: float, message: PoseStamped) -> None:
        self.head_in_rail = readable_pose(message)


def _length(status: DiagnosticStatus) -> int:
    return len(status.name) + len(status.message) + len(status.hardware_id) + sum(
        len(item.key) + len(item.value) for item in status.values)


def _keep(known: dict[str, Value], key: str, value: Value, most: int) -> None:
    """Put a value last; of too many the one goes that was put there the longest ago."""
    known.pop(key, None)
    known[key] = value
    if len(known) > most:
        del known[next(iter(known))]


def _newest(statuses: Sequence[DiagnosticStatus], stamp: str) -> DiagnosticStatus | None:
    """Return the newest of the statuses that speaks of the goal with a stamp."""
    return next((status for status in reversed(statuses) if stamp in (
        status_values(status).get(key) for key in ('goal stamp', REJECTED_STAMP))), None)


def _distance(a: Pose, b: Pose) -> float:
    return max(map(abs, difference(a, b)))


def _is_success(response: Any) -> bool:
    """Return whether a request has succeeded; where a response does not say, it has."""
    return getattr(response, 'success', True)


def _message(service: Service, reply: Any) -> str:
    if not reply.success:
        raise RequestRejectedError(f'{service.name}: {reply.message}')
    return reply.message
