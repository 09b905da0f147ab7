"""The client: no goal is lost, and a request is answered with the node's own message."""

from __future__ import annotations

from concurrent.futures import Future
from functools import partial
import signal
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.srv import GetPlan
import pytest
from qualities import GOAL_STATUS, LATEST, RECENT, RELIABLE
from std_srvs.srv import SetBool, Trigger
from support import DEADLINE

from facade_manipulator.compensation.following import GoalProgress, GoalState
from facade_manipulator.diagnostics import OPERATION
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import planar_pose
from facade_manipulator.ros.client import (
    COMPONENTS,
    GONDOLAS,
    LONGEST,
    ManipulatorClient,
    NoAnswerError,
    RequestRejectedError,
)
from facade_manipulator.ros.conversions import pose_stamped, stamp
from facade_manipulator.ros.diagnostics import (
    diagnostic_status,
    goal_status,
    RejectedGoal,
    rejection_status,
)
from facade_manipulator.ros.lifecycle import Deferred, may_defer

pytestmark = pytest.mark.quick
GOAL = Pose(0.05, 0.25, 0.0)


@pytest.fixture
def client(ros):
    with ManipulatorClient('gondola_1', check=lambda: ros.executor.spin_once(0.0)) as made:
        yield made


def say(node, level, state, **values):
    """Publish again and again in /diagnostics what the driver does; return the timer."""
    publisher = node.create_publisher(DiagnosticArray, '/diagnostics', RELIABLE)
    message = DiagnosticArray(status=[diagnostic_status(
        'gondola_1/driver: operation', level, 'q2 is silent; next: clear_faults',
        {'state': state, **values})])
    return node.create_timer(0.02, lambda: publisher.publish(message))


def test_the_first_goal_reaches_all_who_listen(ros, client, monkeypatch):
    monkeypatch.setattr(sys.modules[ManipulatorClient.__module__], 'SEND_AGAIN', 0.02)
    heard = [ros.collect(ros.node(f'listener_{i}', namespace='gondola_1'), PoseStamped,
                         'goal_pose', LATEST) for i in range(3)]
    client.wait_until(lambda: client.node.count_subscribers('goal_pose') == 3, 'the listeners')
    client.send_goal(GOAL)
    ros.until(lambda: all(heard), 'the goal at each listener')
    assert client.goal == GOAL


def test_a_goal_reaches_a_compensator_that_is_discovered_after_it_was_first_sent(ros, client):
    ros.collect(ros.node('bystander', namespace='gondola_1'), PoseStamped, 'goal_pose', LATEST)
    client.wait_until(lambda: client.node.count_subscribers('goal_pose') == 1, 'the bystander')
    heard = []

    def begin_late():
        if client.goal and not heard:
            heard.append(ros.collect(ros.node('compensator', namespace='gondola_1'), PoseStamped,
                                     'goal_pose', LATEST))
        ros.executor.spin_once(0.0)

    client._check = begin_late
    client.send_goal(GOAL)
    assert heard[0]


def test_goal_on_a_remapped_topic_is_sent(ros, monkeypatch):
    monkeypatch.setattr(sys.modules[ManipulatorClient.__module__], 'SEND_AGAIN', 0.02)
    heard = ros.collect(ros.node('compensator'), PoseStamped, '/site/goal', LATEST)
    with ManipulatorClient(
            check=lambda: ros.executor.spin_once(0.0),
            cli_args=['--ros-args', '-r', 'goal_pose:=/site/goal']) as client:
        client.send_goal(GOAL)
    ros.until(lambda: heard, 'the goal')


def test_a_goal_that_nobody_takes_is_an_error(client, monkeypatch):
    monkeypatch.setattr(ManipulatorClient.wait_until, '__defaults__', (0.1,))
    with pytest.raises(NoAnswerError, match='subscribes to goal_pose: not within 0.1 s'):
        client.send_goal(GOAL)
    assert client.goal is None


def test_each_request_goes_to_its_service_and_a_refusal_is_raised_with_its_reason(
        ros, client, monkeypatch):
    machine, asked, success = ros.node('machine', namespace='gondola_1'), [], True
    diagnostics = machine.create_publisher(DiagnosticArray, '/diagnostics', RELIABLE)

    def answer(name, request, response):
        asked.append((name, request))
        response.success = success
        if name == 'driver/change_state':
            diagnostics.publish(DiagnosticArray(status=[diagnostic_status(
                'gondola_1/driver: operation', 'error', 'q2 is silent', {'state': 'stopped'})]))
        else:
            response.message = f'{name} answers'
        return response

    for name, kind in (('home', Trigger), ('halt', Trigger), ('clear_faults', Trigger),
                       ('change_state', ChangeState)):
        name = f'driver/{name}'
        machine.create_service(kind, name, partial(answer, name))
    for name, kind in (('tare', Trigger), ('hold', Trigger), ('enable', SetBool)):
        name = f'compensator/{name}'
        machine.create_service(kind, name, partial(answer, name))
    machine.create_service(GetState, 'driver/get_state', lambda _, response: GetState.Response(
        current_state=State(label='unconfigured')))
    assert client.driver_state() == 'unconfigured' and client.value(OPERATION, 'state') is None
    monkeypatch.setattr(sys.modules[ManipulatorClient.__module__], 'REASON_TIMEOUT', 0.1)
    requests = {
        client.home: 'driver/home', client.halt: 'driver/halt', client.tare: 'compensator/tare',
        client.clear_faults: 'driver/clear_faults', client.hold: 'compensator/hold',
        client.enable_compensation: 'compensator/enable'}
    transitions = client.configure, client.activate, client.deactivate, client.cleanup
    assert [request() for request in requests] == [f'{name} answers' for name in requests.values()]
    assert asked[-1][1].data
    client.enable_compensation(False)
    assert not asked[-1][1].data
    for change in transitions:
        change()
        assert asked[-1][1].transition.label == change.__name__
    success = False
    for request, name in requests.items():
        with pytest.raises(RequestRejectedError, match=f'{name}: {name} answers'):
            request()
    for change in transitions:
        with pytest.raises(RequestRejectedError, match=f'{change.__name__}: q2 is silent'):
            change()
    assert client.value(OPERATION, 'state') == 'stopped'
    monkeypatch.setattr(diagnostics, 'publish', lambda _: None)
    with pytest.raises(RequestRejectedError, match='activate: rejected; .* in the log'):
        client.activate()


@pytest.mark.parametrize('state, drives, unhomed, nothing_to_do', [
    ('unconfigured', 'unconfigured', 'q1, q2, q3', ()),
    ('inactive', 'inactive', 'q2', ('configure',)),
    ('inactive', 'inactive', '', ('configure', 'home')),
    ('active', 'active', '', ('configure', 'home', 'activate')),
    ('active', 'halted', '', ('configure', 'home'))])
def test_request_for_a_state_that_is_reached_is_not_sent(
        ros, client, state, drives, unhomed, nothing_to_do):
    machine, asked = ros.node('machine', namespace='gondola_1'), []

    def answer(name, _, response):
        asked.append(name)
        response.success = True
        return response

    machine.create_service(Trigger, 'driver/home', partial(answer, 'home'))
    machine.create_service(
        ChangeState, 'driver/change_state', lambda request, response: answer(
            request.transition.label, request, response))
    machine.create_service(GetState, 'driver/get_state', lambda _, response: GetState.Response(
        current_state=State(label=state)))
    say(machine, 'ok', drives, **{'not homed': unhomed})
    replies = {name: getattr(client, name)() for name in ('configure', 'home', 'activate')}
    for name, reply in replies.items():
        assert (name not in asked) == (name in nothing_to_do)
        assert reply.startswith(f'{name}: nothing to do, ') == (name in nothing_to_do)
    if 'home' in nothing_to_do:
        client.home(again=True)
        assert asked[-1] == 'home'


@pytest.fixture
def homing(ros, client, monkeypatch):
    """Return a driver's node that homes, and what ends that; a client has patience for 0.2 s."""
    monkeypatch.setattr(ManipulatorClient.call, '__defaults__', (0.2,))
    machine, job = ros.node('machine', namespace='gondola_1'), Future()
    may_defer(machine, machine.create_service(Trigger, 'driver/home', lambda *_: Deferred(
        job, lambda job: Trigger.Response(success=True, message=job.result()))))
    client.wait_until(lambda: client.node.count_services('/gondola_1/driver/home'), 'the service')
    return machine, job


def test_a_request_takes_as_long_as_the_driver_works_on_it(client, homing):
    machine, job = homing
    say(machine, 'ok', 'homing')
    client.wait_until(lambda: client.value(OPERATION, 'state'), 'the news')
    machine.create_timer(1.0, lambda: job.done() or job.set_result('homed'))
    assert client.home(again=True) == 'homed'


@pytest.mark.parametrize('late', [None, Trigger.Response(success=True, message='homed')])
def test_a_request_that_gets_lost_is_sent_once_more_and_a_success_counts(
        ros, client, monkeypatch, late):
    """What answers the second rejects it while the first is under way; nobody answers a third."""
    monkeypatch.setattr(sys.modules[ManipulatorClient.__module__], 'REQUEST_AGAIN', 0.2)
    machine, first = ros.node('machine', namespace='gondola_1'), Future()
    jobs = [first, Future(), Future()]
    may_defer(machine, machine.create_service(Trigger, 'driver/home', lambda *_: Deferred(
        jobs.pop(0), Future.result)))
    jobs[1].set_result(Trigger.Response(success=late is None, message='the second'))
    client.wait_until(lambda: client.node.count_services('/gondola_1/driver/home'), 'the service')
    if late is not None:
        machine.create_timer(0.6, lambda: first.done() or first.set_result(late))
    assert client.home(again=True) == ('homed' if late else 'the second')
    assert len(jobs) == 1


@pytest.mark.parametrize('state', ['homing', 'inactive'])
def test_a_driver_that_is_silent_or_works_on_nothing_is_not_waited_for(
        client, homing, monkeypatch, state):
    monkeypatch.setattr(sys.modules[ManipulatorClient.__module__], 'NEWS', 0.3)
    news = say(homing[0], 'ok', state)
    client.wait_until(lambda: client.value(OPERATION, 'state'), 'the news')
    if state == 'homing':
        news.cancel()
    with pytest.raises(NoAnswerError, match='the answer of driver/home: not within 0.2 s'):
        client.home(again=True)


@pytest.mark.parametrize('start', [None, Pose(0.0, 0.2, 0.1)])
def test_a_question_is_asked_and_answered_in_metres_and_a_rejection_is_its_own(ros, client, start):
    other, asked = ros.node('ik_service', namespace='gondola_1'), []
    rejections = other.create_publisher(DiagnosticStatus, 'ik_service/rejections', RECENT)
    client.wait_until(rejections.get_subscription_count, 'the client')

    def answer(request, response):
        asked.append(request)
        if len(asked) == 1:
            response.plan.poses = [pose_stamped('actuator_space', 0.0, Pose(0.1, 0.2, 0.0))] * 2
            response.plan.poses[1].pose.position.z = 0.3
        for of, words in ((stamp(1.0), "another's"), (request.goal.header.stamp, 'too far')):
            rejections.publish(rejection_status('solve', InputError('frame', words), of))
        return response

    other.create_service(GetPlan, 'ik_service/solve', answer)
    assert client.solve(GOAL, start, 0.01)[1] == (0.1, 0.2, 0.3)
    assert (asked[0].goal.header.frame_id, asked[0].tolerance) == ('gondola_1/rail',
                                                                   pytest.approx(0.01))
    assert planar_pose(asked[0].goal.pose, 'goal') == pytest.approx(GOAL)
    assert asked[0].start.header.frame_id == ('gondola_1/rail' if start else '')
    with pytest.raises(RequestRejectedError, match='^too far$'):
        client.solve(GOAL)


def test_to_spin_is_to_look_once_at_least_and_for_as_long_as_is_said(client):
    turns, begin = [], time.monotonic()
    client._check = lambda: turns.append(time.monotonic())
    client.spin(0.0)
    assert len(turns) == 1
    client.spin(0.1)
    assert time.monotonic() >= begin + 0.1 and len(turns) > 2


def test_the_head_stands_on_the_rail_when_it_has_been_there_for_a_while(
        ros, client, monkeypatch):
    monkeypatch.setattr(sys.modules[ManipulatorClient.__module__], 'STANDS_FOR', 0.1)
    other, moved = ros.node('ik', namespace='gondola_1'), []
    heads = other.create_publisher(PoseStamped, 'end_effector_pose', RELIABLE)
    asked = ros.collect(other, PoseStamped, 'corrected_pose', LATEST)
    way = [Pose(0.0, 0.2 + 0.01 * step, 0.0) for step in range(8)]

    def move():
        if way:
            moved.append(time.monotonic())
        heads.publish(pose_stamped('rail', 1.0, way.pop() if way else GOAL))

    other.create_timer(0.02, move)
    client.stand_at(GOAL)
    assert time.monotonic() >= moved[-1] + 0.1
    assert planar_pose(asked[-1].pose, 'goal') == pytest.approx(GOAL)
    assert client.head_in_rail == pytest.approx(GOAL)
    with pytest.raises(NoAnswerError, match=r'y \+250.0 mm.* not at .*y \+300.0 mm.* for 0.3 s'):
        client.stand_at(GOAL._replace(y=0.3), 0.3)
    say(other, 'error', 'stopped')
    client.wait_until(lambda: client.value(OPERATION, 'state'), 'the news')
    with pytest.raises(RequestRejectedError, match='q2 is silent; next: clear_faults'):
        client.stand_at(GOAL._replace(y=0.3))
    other.create_publisher(PoseStamped, 'corrected_pose', LATEST)
    client.wait_until(lambda: client.node.count_publishers('corrected_pose') == 2, 'the other')
    with pytest.raises(RequestRejectedError, match='a compensator publishes corrected_pose'):
        client.stand_at(GOAL)


def test_a_client_that_was_interrupted_anywhere_can_still_halt(ros, client, monkeypatch):
    ros.node('driver', namespace='gondola_1').create_service(
        Trigger, 'driver/halt', lambda _, response: Trigger.Response(success=True))
    client.node.create_timer(0.01, lambda: None)
    group = client.node.default_callback_group
    begin = group.beginning_execution

    def interrupted(entity):
        monkeypatch.undo()
        result = begin(entity)
        signal.raise_signal(signal.SIGINT)  # as where the callback is about to be called
        return result

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        monkeypatch.setattr(group, 'beginning_execution', interrupted)
        with pytest.raises(KeyboardInterrupt):
            client.spin(DEADLINE)
        assert client.halt() == ''
    finally:
        signal.signal(signal.SIGINT, before)


def test_one_who_only_looks_publishes_nothing_of_the_machine(client):
    published = {name for name, _ in client.node.get_publisher_names_and_types_by_node(
        'supervisor', '/gondola_1')}
    assert published <= {'/rosout', '/parameter_events'}


def test_memory_for_diagnostics_of_others_is_bounded(ros, client):
    publisher = ros.node('hostile').create_publisher(DiagnosticArray, '/diagnostics', RELIABLE)
    ros.until(publisher.get_subscription_count, 'the client')
    for names, message in (
        ([f'g{k}/driver: operation' for k in range(5 * GONDOLAS)], 'active'),
        ([f'g/part {k}' for k in range(5 * COMPONENTS)], 'active'),
        (['long/driver: operation'], 'x' * (LONGEST + 1)),
        (['last/one'], 'active'),
    ):
        publisher.publish(DiagnosticArray(
            status=[diagnostic_status(name, 'ok', message, {}) for name in names]))

    def has_come():
        client.spin(0.02)
        return 'last' in client.gondolas
    ros.until(has_come, 'the last message')
    assert len(client.gondolas) == GONDOLAS and len(client.gondolas['g']) == COMPONENTS
    assert f'part {5 * COMPONENTS - 1}' in client.gondolas['g']
    assert 'long' not in client.gondolas


def test_who_looks_on_for_long_remembers_the_last_goals_alone(ros, client):
    goals = ros.node('compensator', namespace='gondola_1').create_publisher(
        DiagnosticStatus, GOAL_STATUS, RECENT)
    progress = GoalProgress(GoalState.MOVING)
    for number in range(1, 3 * RECENT.depth):
        goals.publish(goal_status(stamp(number), progress, '', None))
        client.wait_until(
            lambda n=number: len(client._progress) >= min(n, RECENT.depth), 'the progress')
    client.spin(0.1)
    assert len(client._progress) == RECENT.depth


def test_what_is_said_of_a_goal_is_told_once_and_what_names_no_goal_is_passed_over(ros, client):
    other = ros.node('compensator', namespace='gondola_1')
    statuses = other.create_publisher(DiagnosticStatus, GOAL_STATUS, RECENT)

    def say(goal, state):
        statuses.publish(goal_status(goal.header.stamp, GoalProgress(state), '', None))

    def answer(goal):
        statuses.publish(DiagnosticStatus(message='of something else'))
        say(goal, GoalState.MOVING)
        other.create_timer(0.1, lambda: say(goal, GoalState.REACHED))

    other.create_subscription(PoseStamped, 'goal_pose', answer, LATEST)
    told = []
    client.go_to(GOAL, on_progress=lambda number, status: told.append((number, status)))
    assert {number for number, _ in told} == {0}
    assert [status.message for _, status in (told[0], told[-1])] == ['moving', 'reached']
    assert len({id(status) for _, status in told}) == len(told)  # each once


@pytest.mark.parametrize('state, reason, words', [
    (GoalState.REJECTED, 'far', 'rejected: far'), (GoalState.ENDED, 'hold', 'ended: hold'),
    (GoalState.SUPERSEDED, 'newer', 'superseded: newer'),
    (GoalState.MOVING, '', 'the goal was not reached within 0.2 s: moving'),
    (None, '', 'not reached within 0.2 s: no compensator/goal_status')])
def test_a_goal_that_is_not_reached_is_an_error_with_its_reason(
        ros, client, monkeypatch, state, reason, words):
    monkeypatch.setattr(sys.modules[ManipulatorClient.__module__], 'SEND_AGAIN', 0.02)
    other = ros.node('compensator', namespace='gondola_1')
    statuses = other.create_publisher(DiagnosticStatus, GOAL_STATUS, RECENT)

    def answer(goal):
        rejected = RejectedGoal(goal.header.stamp, reason) if state is GoalState.REJECTED else None
        if state is not None:
            statuses.publish(goal_status(
                goal.header.stamp, GoalProgress(state), reason, None, rejected))

    other.create_subscription(PoseStamped, 'goal_pose', answer, LATEST)
    client.wait_until(statuses.get_subscription_count, 'the client')
    with pytest.raises((RequestRejectedError, NoAnswerError), match=words):
        client.go_to(GOAL, timeout=0.2)
