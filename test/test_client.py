"""Client: lost requests, rejections with the node's reason, and goals until they are reached."""

from concurrent.futures import Future
from functools import partial
import math
import os
import signal
import threading
import time

from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import State
from nav_msgs.srv import GetPlan
import pytest
from std_srvs.srv import Trigger

from facade_manipulator import topics
from facade_manipulator.client import (
    GoalNotReachedError,
    ManipulatorClient,
    NoAnswerError,
    RequestRejectedError,
)
from facade_manipulator.kinematics import Pose
from facade_manipulator.nodes.diagnostics import diagnostic_status
from facade_manipulator.nodes.planar_messages import planar_pose, stamp_text

GOAL = Pose(0.05, 0.25, 0.0)


def driver_report(state, message, next_step):
    """Return a message on driver/status."""
    return diagnostic_status(
        '', 'ok', message, {'state': state, 'next step': next_step}
    )


class Machine:
    """Node with the services and topics of a manipulator, which works while a client waits."""

    def __init__(self, ros) -> None:
        self.ros = ros
        self.label = 'unconfigured'
        self.success = True
        self.requests = []  # except get_state
        self.goals = []
        self.act = int  # in each step
        self.status = None  # of the driver, which repeats it
        node = ros.node('machine', namespace='gondola_1')
        self.node = node
        self.driver_status = node.create_publisher(*topics.DRIVER_STATUS)
        self.goal_status = node.create_publisher(*topics.GOAL_STATUS)
        self.rejections = node.create_publisher(*topics.REJECTIONS)
        for service in (topics.HOME, topics.HALT, topics.CLEAR_FAULTS):
            node.create_service(*service, partial(self.trigger, service.name))
        node.create_service(*topics.GET_STATE, lambda *parts: self.get_state(*parts))
        node.create_service(
            *topics.CHANGE_STATE, lambda *parts: self.change_state(*parts)
        )

    def step(self) -> None:
        self.act()
        if self.status is not None:
            self.driver_status.publish(self.status)
        self.ros.executor.spin_once(0.0)

    def report(self, state: str, message: str = '', next_step: str = '') -> None:
        """Publish a status of the driver, and again in each step."""
        self.report_once(state, message, next_step)
        self.status = driver_report(state, message, next_step)

    def report_once(self, state: str, message: str = '', next_step: str = '') -> None:
        """Publish a status of a driver that is then silent."""
        self.status = None
        self.driver_status.publish(driver_report(state, message, next_step))

    def get_state(self, _: object, response):
        response.current_state = State(label=self.label)
        return response

    def trigger(self, name: str, _: object, response):
        self.requests.append(name)
        response.success = self.success
        response.message = f'{name} answers'
        return response

    def change_state(self, request, response):
        self.requests.append(request.transition.label)
        self.report('stopped', 'q2 is silent; next: clear_faults')
        response.success = self.success
        return response

    def answer_goals(self, state: str, values: dict[str, str] | None = None) -> None:
        """Answer every goal with a state, with the stamp of the goal instead of STAMP."""

        def answer(message: PoseStamped) -> None:
            self.goals.append(message)
            stamp = stamp_text(message.header.stamp)
            of_goal = {'goal stamp': 'STAMP', 'state': state} | (values or {})
            for text, found in (
                ('of another', {'goal stamp': '1.0', 'state': 'reached'}),
                (f'{state}: reason', of_goal),
            ):
                filled = {
                    key: value.replace('STAMP', stamp) for key, value in found.items()
                }
                status = diagnostic_status('', 'ok', text, filled)
                self.goal_status.publish(status)

        self.node.create_subscription(
            *topics.GOAL_POSE[:2], answer, topics.GOAL_POSE.subscription_qos
        )


@pytest.fixture
def machine(ros):
    return Machine(ros)


@pytest.fixture
def client(machine):
    with ManipulatorClient('gondola_1', check=machine.step) as made:
        made.repeat_after = 0.1
        yield made


@pytest.fixture
def unanswered(client, monkeypatch):
    """Return a function that ignores the requests of a service and returns the answer."""

    def leave_open(service) -> Future:
        answer = Future()
        monkeypatch.setattr(client._client(service), 'call_async', lambda _: answer)
        return answer

    client.answer_timeout = 0.3
    return leave_open


def test_requests_are_sent_once_and_rejections_raised_with_reason(client, machine):
    requests = {
        client.configure: 'configure',
        client.home: 'driver/home',
        client.activate: 'activate',
        client.halt: 'driver/halt',
        client.clear_faults: 'driver/clear_faults',
        client.deactivate: 'deactivate',
    }
    for request in requests:
        machine.report('inactive', next_step='home, activate')
        client.wait_until(lambda: client.status.next_step, 'driver/status')
        request()
    assert machine.requests == list(requests.values())
    machine.success = False
    with pytest.raises(
        RequestRejectedError, match='^halt rejected: driver/halt answers'
    ):
        client.halt()
    with pytest.raises(
        RequestRejectedError, match='activate rejected: q2 is silent; next: clear'
    ):
        client.activate()


def test_request_for_reached_state_is_not_sent(client, machine):
    machine.label = 'active'
    machine.report('active')
    client.configure()
    client.home()
    client.activate()
    assert machine.requests == []
    client.home(again=True)
    assert machine.requests == ['driver/home']


OLDER = [  # state, message and next step on driver/status before a request
    ('unconfigured', '', 'configure'),
    ('configuring', '', ''),
    ('inactive', 'inactive; an older failure', 'activate'),
]


@pytest.mark.parametrize('older', OLDER)
@pytest.mark.parametrize('is_homed', [False, True])
def test_home_decides_on_status_after_the_request(client, machine, older, is_homed):
    next_step = 'activate' if is_homed else 'home, activate'
    machine.report(*older)
    client.wait_until(lambda: client.status.state == older[0], 'driver/status')

    def get_state(_, response):
        machine.report('inactive', next_step=next_step)
        response.current_state = State(label='inactive')
        return response

    machine.get_state = get_state
    client.home()
    assert machine.requests == ([] if is_homed else ['driver/home'])


@pytest.mark.parametrize('older', OLDER[:2])
def test_home_skips_a_late_status_of_another_state(client, machine, older):
    """Messages of a topic may arrive after a later response."""
    machine.label = 'inactive'
    late = iter([older] * 3)

    def act():
        machine.report(*next(late, ('inactive', '', 'home, activate')))

    machine.act = act
    client.home()
    assert machine.requests == ['driver/home']


def test_failed_cleanup_raises_its_reason_while_the_state_changes(client, machine):
    """The driver returns to inactive first, and then follows the drives to unconfigured."""
    # before the request, and right after its response
    labels = iter(['inactive', 'inactive'])

    def get_state(_, response):
        response.current_state = State(label=next(labels, 'unconfigured'))
        return response

    def change_state(_, response):
        machine.report('unconfigured', 'the power of q2 is not confirmed off')
        response.success = False
        return response

    machine.get_state = get_state
    machine.change_state = change_state
    client.answer_timeout = 2.0
    with pytest.raises(RequestRejectedError, match='q2 is not confirmed off'):
        client.cleanup()


@pytest.mark.parametrize('older', OLDER)
def test_failed_transition_raises_the_reason_after_the_answer(client, machine, older):
    machine.report(*older)
    client.wait_until(lambda: client.status.state == older[0], 'driver/status')

    def change_state(_, response):
        machine.act = lambda: machine.report('stopped', 'q2 is silent')
        response.success = False
        return response

    machine.change_state = change_state
    with pytest.raises(RequestRejectedError, match='activate rejected: q2 is silent'):
        client.activate()


def test_lost_request_is_repeated_only_if_harmless(client, machine, monkeypatch):
    """Fast DDS may lose a request to a node that has just started."""
    lost = [Future(), Future()]
    asked = []
    get_state = client._client(topics.GET_STATE)
    ask = get_state.call_async

    def lose_first_requests(request):
        asked.append(request)
        return lost.pop() if lost else ask(request)

    monkeypatch.setattr(get_state, 'call_async', lose_first_requests)
    client.home(again=True)
    assert len(asked) == 3
    assert machine.requests == ['driver/home']


def test_request_waits_while_the_driver_works(client, machine, unanswered):
    answer = unanswered(topics.HALT)
    end = time.monotonic() + 1.0

    def work() -> None:
        machine.report('homing')
        if time.monotonic() > end and not answer.done():
            answer.set_result(Trigger.Response(success=True, message='halted'))

    machine.act = work
    assert client.halt() == 'halted'


@pytest.mark.parametrize('state', ['inactive', 'homing'])
def test_request_to_idle_or_silent_driver_times_out(client, machine, unanswered, state):
    client.silence = 0.2
    machine.report_once(state)
    unanswered(topics.HALT)
    with pytest.raises(
        NoAnswerError, match='timed out after 0.3 s waiting for .* driver/halt'
    ):
        client.halt()


def test_reached_goal_ends_go_to(client, machine):
    machine.answer_goals('reached')
    client.go_to(GOAL, GOAL._replace(x=0.0))
    assert machine.goals[0].header.frame_id == 'gondola_1/facade'
    assert planar_pose(machine.goals[0].pose, 'goal') == pytest.approx(GOAL)
    assert client.goal == GOAL._replace(x=0.0)


@pytest.mark.parametrize(
    'state, values, error, message',
    [
        ('ended', {}, RequestRejectedError, 'ended: reason'),
        ('superseded', {}, RequestRejectedError, 'superseded: reason'),
        (
            'moving',
            {'rejected goal stamp': 'STAMP', 'rejection': 'far'},
            RequestRejectedError,
            'rejected: far',
        ),
        (
            'moving',
            {},
            GoalNotReachedError,
            'timed out after 0.3 s waiting for the goal: moving',
        ),
        (
            'moving',
            {'goal stamp': '2.0'},
            NoAnswerError,
            'waiting for a compensator to report',
        ),
    ],
)
def test_unreached_goal_raises_error_with_its_reason(
    client, machine, state, values, error, message
):
    client.answer_timeout = 0.5
    machine.answer_goals(state, values)
    with pytest.raises(error, match=message):
        client.go_to(GOAL, timeout=0.3)


def test_error_of_a_missed_goal_contains_its_progress(client, machine):
    machine.answer_goals('moving', {'distance [mm]': '12.5', 'angle [deg]': '180.0'})
    with pytest.raises(GoalNotReachedError) as caught:
        client.go_to(GOAL, timeout=0.3)
    progress = caught.value.progress
    assert progress == client.progress
    assert progress.state == 'moving'
    assert progress.message == 'moving: reason'
    assert (progress.distance, progress.angle) == pytest.approx((0.0125, math.pi))


def test_progress_of_a_rejected_goal_is_its_rejection(client, machine):
    values = {
        'goal stamp': '2.0',
        'distance [mm]': '1.0',
        'rejected goal stamp': 'STAMP',
        'rejection': 'x is above its limit',
    }
    machine.answer_goals('moving', values)
    client.send_goal(GOAL)
    assert client.progress.state == 'rejected'
    assert client.progress.message == 'x is above its limit'
    assert math.isnan(client.progress.distance)


def test_progress_is_none_before_the_first_goal(client):
    assert client.progress is None


def test_status_is_the_newest_message_of_the_driver(client, machine):
    assert client.status.state == 'silent'
    machine.report('stopped', 'q2 is silent; next: clear_faults', 'clear_faults')
    client.wait_until(lambda: client.status.state != 'silent', 'driver/status')
    assert client.status == (
        'stopped',
        'ok',
        'q2 is silent; next: clear_faults',
        'clear_faults',
        'unknown',
    )


def test_status_of_a_silent_driver_names_a_next_step(client, machine):
    client.silence = 0.2
    machine.report('active')
    client.wait_until(lambda: client.status.state == 'active', 'driver/status')
    machine.status = None
    client.wait_until(lambda: client.status.state == 'silent', 'silence')
    assert client.status.message == (
        'the driver is silent; next: check whether the driver still runs'
    )


def test_goal_is_sent_to_a_compensator_discovered_late(ros, client, machine):
    bystander = ros.node('bystander', namespace='gondola_1')
    ros.collect(bystander, *topics.GOAL_POSE[:2])
    threading.Timer(0.1, machine.answer_goals, ('reached',)).start()
    client.go_to(GOAL)
    assert machine.goals


def test_goal_is_stamped_when_a_compensator_subscribes(client, machine):
    client.answer_timeout = 0.1
    with pytest.raises(NoAnswerError, match='waiting for a compensator'):
        client.send_goal(GOAL)
    assert client.goal is None
    assert not machine.goals


@pytest.mark.parametrize('reason', ['', 'y is above its limit'])
def test_solve_returns_carriages_or_raises_the_limit(client, machine, reason):
    def answer(
        request: GetPlan.Request, response: GetPlan.Response
    ) -> GetPlan.Response:
        assert request.goal.header.frame_id == 'gondola_1/rail'
        if not reason:
            response.plan.poses = [PoseStamped()]
            response.plan.poses[0].pose.position.z = 0.3
        for of, text in (
            ('1.0', 'of another'),
            (stamp_text(request.goal.header.stamp), reason),
        ):
            machine.rejections.publish(
                diagnostic_status('', 'ok', text, {'goal stamp': of})
            )
        return response

    machine.node.create_service(*topics.SOLVE, answer)
    if reason:
        with pytest.raises(RequestRejectedError, match=f'^{reason}$'):
            client.solve(GOAL)
    else:
        assert client.solve(GOAL) == (0.0, 0.0, 0.3)


def test_interrupted_client_can_still_halt(client):
    interrupt = (os.getpid(), signal.SIGINT)
    threading.Timer(0.2, os.kill, interrupt).start()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            client.wait_until(lambda: False, 'nothing')
        assert client.halt() == 'driver/halt answers'
    finally:
        signal.signal(signal.SIGINT, before)


def test_closed_client_leaves_no_node_in_its_executor(ros):
    client = ManipulatorClient('gondola_1')
    executor = client.node.executor
    client.close()
    assert not executor.get_nodes()


def published(client):
    """Return the topics with a publisher of the client, in the graph of ROS."""
    found = client.node.get_publisher_names_and_types_by_node(
        'supervisor', '/gondola_1'
    )
    return {name for name, _ in found}


def test_observing_client_publishes_no_command(client):
    client.wait_until(lambda: '/rosout' in published(client), 'the publishers')
    assert published(client) == {'/rosout', '/parameter_events'}


def test_first_goal_of_a_client_creates_its_publisher(client, machine):
    machine.answer_goals('reached')
    client.go_to(GOAL)
    client.wait_until(lambda: '/gondola_1/goal_pose' in published(client), 'goal_pose')
    assert published(client) == {'/rosout', '/parameter_events', '/gondola_1/goal_pose'}
