"""Start, run loop and end of the process of a node."""

from __future__ import annotations

import os
import signal
from threading import Timer
import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_msgs.msg import Empty
from std_srvs.srv import Trigger

from facade_manipulator.errors import ManipulatorError, ParameterError
from facade_manipulator.nodes import run
from facade_manipulator.nodes.diagnostics import Rejections
from facade_manipulator.nodes.lifecycle import ManagedNode
from facade_manipulator.nodes.workarounds import take_waiting

pytestmark = pytest.mark.realtime
DEADLINE = 10.0


@pytest.fixture(params=['events', 'single-threaded'], autouse=True)
def executor(request, monkeypatch):
    """Run each test in both executors."""
    if request.param == 'single-threaded':
        monkeypatch.setattr(run, 'EventsExecutor', SingleThreadedExecutor)


def node_with(callback, period=0.01, name='ending', **hooks):
    """Return a function that makes a node with a timer."""
    def make_nodes():
        node = rclpy.create_node(name)
        node.rejections = Rejections(node)
        node.create_timer(period, callback)
        for hook, function in hooks.items():
            setattr(node, hook, function)
        return [node]

    return make_nodes


def end_process(number=signal.SIGINT):
    os.kill(os.getpid(), number)


@pytest.mark.parametrize('number', run.STOP_SIGNALS)
def test_signal_closes_the_node_while_ros_runs(ros_domain, handlers, capfd, number):
    closed = []
    assert run.run(node_with(
        lambda: end_process(number), close=lambda: closed.append(rclpy.ok())), []) == 0
    assert closed == [True]
    log = capfd.readouterr().err
    assert '[ending]: ready' in log and 'ended' not in log


def test_signal_ends_an_idle_node_within_a_second(ros_domain, handlers):
    timer = Timer(0.3, end_process)
    timer.start()
    begin = time.monotonic()
    assert run.run(node_with(int, period=100.0), []) == 0
    assert time.monotonic() - begin < 5.0


def test_signal_during_the_start_ends_the_process(ros_domain, handlers):
    timer = Timer(0.3, end_process)
    timer.start()
    assert run.run(lambda: time.sleep(DEADLINE), []) == 0


def test_shutdown_transition_ends_the_process(ros_domain, handlers):
    def make_nodes():
        node = ManagedNode('managed')
        node.rejections = Rejections(node)
        timer = node.create_timer(0.1, lambda: (timer.cancel(), node.trigger_shutdown()))
        return [node]

    assert run.run(make_nodes, []) == 0


def test_end_of_ros_without_a_signal_is_a_failure(ros_domain, handlers, capfd):
    assert run.run(node_with(rclpy.try_shutdown), []) == 1
    assert 'ended without a signal' in capfd.readouterr().err


def test_exception_is_logged_and_counted_and_the_node_continues(ros_domain, handlers, capfd):
    calls, counted = [], []

    def fail_twice():
        calls.append(time.monotonic())
        if len(calls) < 3:
            raise ZeroDivisionError('a defect')
        counted.append(nodes[0].rejections.values())
        end_process()

    nodes = []
    assert run.run(lambda: nodes.extend(node_with(fail_twice)()) or nodes, []) == 0
    assert counted[0]['rejected: exception'] == 2
    assert counted[0]['last rejection'] == "ZeroDivisionError('a defect')"
    assert 'in fail_twice' in capfd.readouterr().err


def test_ten_exceptions_in_ten_seconds_end_the_node(ros_domain, handlers):
    calls = []

    def fail():
        calls.append(1)
        raise ZeroDivisionError('a defect')

    closed = []
    with pytest.raises(ZeroDivisionError, match='a defect'):
        run.run(node_with(fail, close=lambda: closed.append(True)), [])
    assert len(calls) == run.MOST_EXCEPTIONS and closed == [True]


def test_ten_exceptions_in_a_longer_time_end_nothing(ros_domain, handlers, monkeypatch):
    monkeypatch.setattr(run, 'EXCEPTION_PERIOD', 0.01)
    calls = []

    def fail():
        calls.append(1)
        if len(calls) > 2 * run.MOST_EXCEPTIONS:
            end_process()
        raise ZeroDivisionError('a defect')

    assert run.run(node_with(fail), []) == 0


@pytest.mark.parametrize('is_own', [True, False])
def test_only_exceptions_of_own_callbacks_are_handed_to_the_node(
        ros_domain, handlers, monkeypatch, is_own):
    if is_own:
        monkeypatch.setattr(run, 'OWN_CODE', os.path.dirname(__file__))
    handled = []

    def fail():
        end_process()
        raise ZeroDivisionError('a defect')

    assert run.run(node_with(fail, handle_exception=handled.append), []) == 0
    assert len(handled) == is_own


def test_messages_after_an_exception_are_received(ros_domain, handlers):
    received = []

    def make_nodes():
        nodes = node_with(lambda: len(received) == 4 and end_process())()
        publisher = nodes[0].create_publisher(Empty, 'told', 10)

        def receive(message):
            received.append(message)
            if len(received) == 2:
                raise ZeroDivisionError('a defect')

        def publish():
            if publisher.get_subscription_count():
                timer.cancel()
                for _ in range(4):
                    publisher.publish(Empty())

        nodes[0].create_subscription(Empty, 'told', receive, 10)
        timer = nodes[0].create_timer(0.01, publish)
        return nodes

    assert run.run(make_nodes, []) == 0


def test_error_at_the_start_is_one_line(ros_domain, handlers, capfd):
    def fail():
        raise ParameterError('limits.speed = 9 m/s is above its maximum 5 m/s')

    assert run.run(fail, []) == run.USAGE_ERROR
    assert 'could not start: limits.speed = 9 m/s' in capfd.readouterr().err


@pytest.mark.parametrize('arguments, status, text', [
    (['--help'], 0, '--params-file'), (['--bogus'], 2, 'unrecognized arguments: --bogus'),
    (['--ros-args', '-p', 'a:=1', '--', 'more'], 2, 'unrecognized arguments: more')])
def test_arguments_of_another_program_start_nothing(handlers, capfd, arguments, status, text):
    with pytest.raises(SystemExit) as end:
        run.run(pytest.fail, arguments)
    captured = capfd.readouterr()
    assert end.value.code == status and text in captured.out + captured.err


def test_simulated_time_is_rejected_with_a_reason(ros_domain, handlers, capfd):
    arguments = ['--ros-args', '-p', 'use_sim_time:=true']
    assert run.run(node_with(int), arguments) == run.USAGE_ERROR
    log = capfd.readouterr().err
    assert 'use_sim_time rejected: true, required is false' in log and 'next: remove' in log


def test_simulated_time_is_rejected_as_a_live_change(ros):
    node = ros.node()
    run._reject_simulated_time(node)
    result, = node.set_parameters([Parameter('use_sim_time', value=True)])
    assert not result.successful and 'next: remove use_sim_time' in result.reason
    assert node.get_parameter('use_sim_time').value is False


def test_malformed_arguments_of_ros_are_a_message(ros_domain):
    with pytest.raises(ManipulatorError, match='params-file'):
        run.initialise(['--ros-args', '--params-file', '/nowhere.yaml'])


def test_messages_before_the_executor_listened_are_taken(ros):
    node, other, received = rclpy.create_node('late'), ros.node('other'), []
    node.create_subscription(Empty, 'told', received.append, 3)
    node.create_service(
        Trigger, 'asked', lambda request, response: received.append(request) or response)
    publisher, client = other.create_publisher(Empty, 'told', 3), other.create_client(
        Trigger, 'asked')
    ros.until(lambda: client.service_is_ready() and publisher.get_subscription_count(), 'both')
    for _ in range(3):
        publisher.publish(Empty())
    answers = [client.call_async(Trigger.Request()) for _ in range(2)]

    def all_are_answered():
        take_waiting(node)
        return all(answer.done() for answer in answers)

    ros.until(all_are_answered, 'the answers')
    assert [type(one) for one in received] == 3 * [Empty] + 2 * [Trigger.Request]
    node.destroy_node()
