"""The client: lost requests, rejections with the node's reason, goals until they are reached."""

from __future__ import annotations

from concurrent.futures import Future
import os
import signal
import threading
import time

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.srv import GetPlan
import pytest
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from facade_manipulator import client as client_module
from facade_manipulator import topics
from facade_manipulator.client import ManipulatorClient, NoAnswerError, RequestRejectedError
from facade_manipulator.kinematics import Pose
from facade_manipulator.nodes.messages import planar_pose

pytestmark = pytest.mark.quick
GOAL = Pose(0.05, 0.25, 0.0)


def status(message: str, **values: str) -> DiagnosticStatus:
    return DiagnosticStatus(message=message, values=[
        KeyValue(key=key.replace('_', ' '), value=value) for key, value in values.items()])


class Machine:
    """A node with the services and topics of a manipulator, spun in its own thread."""

    def __init__(self, ros) -> None:
        self.ros, self.label, self.success = ros, 'unconfigured', True
        self.requests: list[str] = []
        self.goals: list[PoseStamped] = []
        self.answering = threading.Event()
        self.answering.set()
        self.node = ros.node('machine', namespace='gondola_1')
        ros.executor.remove_node(self.node)
        self.driver_status = self.node.create_publisher(*topics.DRIVER_STATUS)
        self.goal_status = self.node.create_publisher(*topics.GOAL_STATUS)
        self.rejections = self.node.create_publisher(*topics.REJECTIONS)
        self.node.create_service(*topics.GET_STATE, self.get_state)
        for service in (topics.HOME, topics.HALT, topics.CLEAR_FAULTS):
            self.node.create_service(
                *service, lambda _, response, name=service.name: self.trigger(name, response))
        self.node.create_service(*topics.CHANGE_STATE, self.change_state)
        self.executor = SingleThreadedExecutor(context=self.node.context)
        self.executor.add_node(self.node)
        self.is_over = False
        self.thread = threading.Thread(target=self.spin, daemon=True)
        self.thread.start()

    def spin(self) -> None:
        while not self.is_over:
            self.executor.spin_once(0.02)

    def close(self) -> None:
        self.is_over = True
        self.answering.set()
        self.thread.join()

    def report(self, state: str, message: str = '', next_step: str = '') -> None:
        self.driver_status.publish(status(message, state=state, next_step=next_step))

    def get_state(self, _: object, response: GetState.Response) -> GetState.Response:
        self.requests.append('get_state')
        response.current_state = State(label=self.label)
        return response

    def trigger(self, name: str, response: Trigger.Response) -> Trigger.Response:
        self.requests.append(name)
        self.answering.wait()
        response.success, response.message = self.success, f'{name} answers'
        return response

    def change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        self.requests.append(request.transition.label)
        self.report('stopped', 'q2 is silent; next: clear_faults')
        response.success = self.success
        return response


@pytest.fixture
def machine(ros):
    made = Machine(ros)
    yield made
    made.close()


@pytest.fixture
def client(ros, machine, monkeypatch):
    monkeypatch.setattr(client_module, 'REPEAT_AFTER', 0.1)
    with ManipulatorClient('gondola_1') as made:
        yield made


def sent(machine) -> list[str]:
    return [name for name in machine.requests if name != 'get_state']


def test_requests_are_sent_once_and_rejections_raised_with_reason(client, machine):
    machine.report('inactive', next_step='home, activate')
    requests = {
        client.configure: 'configure', client.home: 'driver/home', client.activate: 'activate',
        client.halt: 'driver/halt', client.clear_faults: 'driver/clear_faults',
        client.deactivate: 'deactivate'}
    for request in requests:
        machine.report('inactive', next_step='home, activate')
        client.wait_until(lambda: client._driver_values().get('next step'), 'driver/status')
        request()
    assert sent(machine) == list(requests.values())
    machine.success = False
    with pytest.raises(RequestRejectedError, match='driver/halt rejected: driver/halt answers'):
        client.halt()
    with pytest.raises(RequestRejectedError, match='activate rejected: q2 is silent; next: clear'):
        client.activate()


def test_request_for_reached_state_is_not_sent(client, machine):
    machine.label = 'active'
    machine.report('active')
    client.configure()
    client.home()
    client.activate()
    assert sent(machine) == []
    client.home(again=True)
    assert sent(machine) == ['driver/home']


def test_lost_question_is_repeated_and_request_sent_once(client, machine, monkeypatch):
    """Sentence 15: Fast DDS may lose a request to a node that has just started."""
    lost = [Future(), Future()]
    get_state, home = client._client(topics.GET_STATE), client._client(topics.HOME)
    ask, asked = get_state.call_async, []

    def lose_some(request):
        asked.append(request)
        return lost.pop() if lost else ask(request)

    monkeypatch.setattr(get_state, 'call_async', lose_some)
    sends, send = [], home.call_async
    monkeypatch.setattr(home, 'call_async', lambda request: sends.append(request) or send(request))
    client.home(again=True)
    assert len(asked) == 3
    assert len(sends) == 1 and sent(machine) == ['driver/home']


def test_request_waits_while_the_driver_works(client, machine, monkeypatch):
    monkeypatch.setattr(client_module, 'ANSWER_TIMEOUT', 0.3)
    machine.answering.clear()
    news = threading.Timer(1.0, machine.answering.set)
    reports = [threading.Timer(0.1 * k, machine.report, ('homing',)) for k in range(10)]
    for timer in (news, *reports):
        timer.start()
    assert client._trigger(topics.HOME) == 'driver/home answers'
    assert sent(machine) == ['driver/home']


@pytest.mark.parametrize('state', ['inactive', 'homing'])
def test_request_to_idle_or_silent_driver_times_out(client, machine, monkeypatch, state):
    monkeypatch.setattr(client_module, 'ANSWER_TIMEOUT', 0.3)
    monkeypatch.setattr(client_module, 'SILENCE', 0.2)
    machine.report(state)
    machine.answering.clear()
    with pytest.raises(NoAnswerError, match='timed out after 0.3 s waiting for .* driver/halt'):
        client.halt()


def answer_goals(machine, state: str, **values: str) -> None:
    """Let the machine answer every goal with a state."""
    def answer(message: PoseStamped) -> None:
        machine.goals.append(message)
        stamp = f'{message.header.stamp.sec}.{message.header.stamp.nanosec:09d}'
        of_goal = {key: stamp if value == 'STAMP' else value for key, value in values.items()}
        machine.goal_status.publish(status('of another goal', goal_stamp='1.0', state='reached'))
        machine.goal_status.publish(status(
            f'{state}: reason', **({'goal_stamp': stamp, 'state': state} | of_goal)))

    topic = topics.GOAL_POSE
    machine.node.create_subscription(topic.type, topic.name, answer, topic.qos)


def test_reached_goal_ends_go_to(client, machine):
    answer_goals(machine, 'reached')
    client.go_to(GOAL, GOAL._replace(x=0.0))
    assert machine.goals[0].header.frame_id == 'gondola_1/facade'
    assert planar_pose(machine.goals[0].pose, 'goal') == pytest.approx(GOAL)
    assert client.goal == GOAL._replace(x=0.0)


@pytest.mark.parametrize('state, values, error, message', [
    ('ended', {}, RequestRejectedError, 'ended: reason'),
    ('superseded', {}, RequestRejectedError, 'superseded: reason'),
    ('moving', {'rejected_goal_stamp': 'STAMP', 'rejection': 'far'}, RequestRejectedError,
     'rejected: far'),
    ('moving', {}, NoAnswerError, 'timed out after 0.3 s waiting for the goal: moving'),
    ('moving', {'goal_stamp': '2.0'}, NoAnswerError, 'waiting for a compensator to report')])
def test_goal_that_is_not_reached_raises_its_reason(
        client, machine, monkeypatch, state, values, error, message):
    monkeypatch.setattr(ManipulatorClient.wait_until, '__defaults__', (0.5,))
    answer_goals(machine, state, **values)
    with pytest.raises(error, match=message):
        client.go_to(GOAL, timeout=0.3)


def test_goal_reaches_a_compensator_discovered_late(ros, client, machine):
    ros.collect(ros.node('bystander', namespace='gondola_1'), PoseStamped, 'goal_pose',
                topics.GOAL_POSE.qos)
    threading.Timer(0.1, answer_goals, (machine, 'reached')).start()
    client.go_to(GOAL)
    assert machine.goals


def test_goal_without_subscriber_is_an_error(client, monkeypatch):
    monkeypatch.setattr(ManipulatorClient.wait_until, '__defaults__', (0.1,))
    with pytest.raises(NoAnswerError, match='a compensator to report the goal'):
        client.send_goal(GOAL)


@pytest.mark.parametrize('reason', ['', 'y is above its limit'])
def test_solve_returns_carriages_or_raises_the_limit(client, machine, reason):
    def answer(request: GetPlan.Request, response: GetPlan.Response) -> GetPlan.Response:
        assert request.goal.header.frame_id == 'gondola_1/rail'
        stamp = request.goal.header.stamp
        if not reason:
            response.plan.poses = [PoseStamped()]
            response.plan.poses[0].pose.position.z = 0.3
        for of, text in (('1.0', 'of another'), (f'{stamp.sec}.{stamp.nanosec:09d}', reason)):
            machine.rejections.publish(status(text, goal_stamp=of))
        return response

    machine.node.create_service(*topics.SOLVE, answer)
    if reason:
        with pytest.raises(RequestRejectedError, match=f'^{reason}$'):
            client.solve(GOAL)
    else:
        assert client.solve(GOAL) == (0.0, 0.0, 0.3)


def test_interrupted_client_can_still_halt(client, machine):
    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            client.wait_until(lambda: False, 'nothing')
        assert client.halt() == 'driver/halt answers'
    finally:
        signal.signal(signal.SIGINT, before)


def test_exception_of_check_ends_waiting(ros):
    def check() -> None:
        raise InterruptedError

    with ManipulatorClient(check=check) as made, pytest.raises(InterruptedError):
        made.wait_until(lambda: False, 'nothing')


def test_observing_client_publishes_no_command(client):
    time.sleep(0.1)
    published = {name for name, _ in client.node.get_publisher_names_and_types_by_node(
        'supervisor', '/gondola_1')}
    assert published <= {'/rosout', '/parameter_events'}
