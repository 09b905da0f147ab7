"""Process of a node: start, run and end."""

from importlib import import_module
import os
import signal
from threading import Event, Thread, Timer
import time

from nodes.node_rig import diagnostics_of, NODES
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_msgs.msg import Empty
from std_srvs.srv import Trigger
from support import DEADLINE

from facade_manipulator import config_path
from facade_manipulator.nodes import run
from facade_manipulator.nodes.base_node import BaseNode
from facade_manipulator.nodes.lifecycle import ManagedNode
from facade_manipulator.nodes.workarounds import take_waiting
from facade_manipulator.topics import Service

pytestmark = pytest.mark.realtime
MODULES = [
    f'simulation.{name}' if name == 'gondola_simulator' else f'nodes.{name}'
    for name in NODES
]
CONNECTED = ['compensator', 'ik_service']  # of the process `manipulator`
MESSAGES = 4  # the callback of the second raises an exception


@pytest.fixture(params=['events', 'single-threaded'])
def executor(request, monkeypatch, ros_domain, handlers):
    """Run a test in both executors."""
    if request.param == 'single-threaded':
        monkeypatch.setattr(run, 'EventsExecutor', SingleThreadedExecutor)


def node_with(callback, period=0.01, make=BaseNode, receive=None, **hooks):
    """
    Return a function that makes a node with a timer, and a list that collects the nodes.

    The node publishes and receives messages on `sent` if `receive` is given.
    """

    def make_nodes():
        node = make('ending')
        node.diagnostics = diagnostics_of(node)
        node.timer = node.create_timer(period, callback)
        for hook, function in hooks.items():
            setattr(node, hook, function)
        if receive:
            node.sent = node.create_publisher(Empty, 'sent', 10)
            node.create_subscription(Empty, 'sent', receive, 10)
        nodes.append(node)
        return nodes

    nodes = []
    return make_nodes, nodes


def end_process(number=signal.SIGINT):
    os.kill(os.getpid(), number)


def failing(count):
    """Return a callback that raises an exception a number of times, then ends the process."""
    calls = iter(range(count))

    def fail():
        if next(calls, None) is not None:
            raise ZeroDivisionError('a defect')
        end_process()

    return fail


@pytest.mark.parametrize('number', run.STOP_SIGNALS)
def test_signal_closes_an_idle_node_while_ros_runs(executor, capfd, number):
    closed = []

    def close():
        closed.append(rclpy.ok())

    make_nodes, _ = node_with(int, period=100.0, close=close)
    Timer(0.3, end_process, [number]).start()
    begin = time.monotonic()
    assert run.run(make_nodes, []) == 0
    assert closed == [True]
    assert time.monotonic() - begin < 5.0
    log = capfd.readouterr().err
    assert '[ending]: ready' in log
    assert 'ended' not in log


def test_second_signal_ends_a_node_that_cannot_keep_up(executor, ros_domain):
    def flood():
        while not has_ended.is_set():
            publisher.publish(Empty())
            time.sleep(0.005)

    has_ended = Event()
    closed = []

    def receive_slowly(_):
        time.sleep(0.02)

    def close():
        closed.append(rclpy.ok())

    make_nodes, _ = node_with(int, receive=receive_slowly, close=close)
    context = rclpy.Context()
    context.init(domain_id=ros_domain)
    publisher = rclpy.create_node('fast', context=context).create_publisher(
        Empty, 'sent', 10
    )
    sender = Thread(target=flood)
    sender.start()
    for delay in (1.0, 2.0, 3.0):
        Timer(delay, end_process).start()
    begin = time.monotonic()
    try:
        assert run.run(make_nodes, []) == 0
        assert closed == [True]
        assert time.monotonic() - begin < 8.0
        time.sleep(max(0.0, begin + 3.2 - time.monotonic()))  # the last signal
    finally:
        has_ended.set()
        sender.join()
        context.try_shutdown()


def test_signal_during_the_start_ends_the_process(ros_domain, handlers):
    Timer(0.3, end_process).start()
    assert run.run(lambda: time.sleep(DEADLINE), []) == 0


def test_shutdown_transition_ends_the_process(ros_domain, handlers):
    def end():
        nodes[0].timer.cancel()
        nodes[0].trigger_shutdown()

    make_nodes, nodes = node_with(end, make=ManagedNode)
    assert run.run(make_nodes, []) == 0


def test_end_of_ros_without_a_signal_is_a_failure(executor, capfd):
    assert run.run(node_with(rclpy.try_shutdown)[0], []) == 1
    assert 'ended without a signal' in capfd.readouterr().err


def test_exception_is_counted_and_handled_by_its_node(executor, capfd):
    handled = []
    make_nodes, nodes = node_with(failing(2), handle_exception=handled.append)
    assert run.run(make_nodes, []) == 0
    counted = nodes[0].diagnostics.rejections()
    assert counted['rejected: exception'] == 2
    assert counted['last rejection'].startswith(
        "ZeroDivisionError('a defect'); next: report"
    )
    assert 'in fail' in capfd.readouterr().err
    assert [type(error) for error in handled] == 2 * [ZeroDivisionError]


def exceptions_of(nodes):
    """Return the number of exceptions that each node has counted."""
    return [one.diagnostics.rejections().get('rejected: exception', 0) for one in nodes]


def test_exception_is_counted_only_by_the_called_node(executor):
    """A callback of the first node calls a callback of the second, as in `manipulator`."""
    handled = []
    make_called, called = node_with(int, period=100.0, handle_exception=handled.append)

    def fail_caller(_):
        pytest.fail('the caller has no defect')

    make_caller, callers = node_with(
        lambda: called[0].fail(), handle_exception=fail_caller
    )

    def make_nodes():
        nodes = [*make_caller(), *make_called()]
        called[0].fail = called[0].owned(failing(2))
        return nodes

    assert run.run(make_nodes, []) == 0
    assert exceptions_of([*callers, *called]) == [0, 2]
    assert len(handled) == 2


@pytest.mark.parametrize('callback', ['message', 'service', 'managed service', 'event'])
def test_exception_of_each_callback_is_handled(executor, callback):
    def fail(*_):
        raise ZeroDivisionError('a defect')

    def handle(error):
        handled.append(error)
        end_process()

    def make_nodes():
        node = (ManagedNode if callback == 'managed service' else BaseNode)('ending')
        node.diagnostics = diagnostics_of(node)
        node.handle_exception = handle
        service = Service(Trigger, 'asked')
        if callback == 'message':
            node.create_subscription(Empty, 'sent', fail, 10)
        elif callback == 'event':
            events = SubscriptionEventCallbacks(matched=fail)
            node.create_subscription(
                Empty, 'sent', lambda _: None, 10, event_callbacks=events
            )
        elif callback == 'service':
            node.create_service(*service, fail)
        else:
            node.offer(service, fail)
        node.sent = node.create_publisher(Empty, 'sent', 10)
        node.client = node.create_client(*service)
        node.create_timer(0.01, lambda: node.sent.publish(Empty()))
        node.create_timer(0.1, lambda: node.client.call_async(Trigger.Request()))
        return [node]

    handled = []
    assert run.run(make_nodes, []) == 0
    assert isinstance(handled[0], ZeroDivisionError)


def test_bad_request_to_a_service_is_not_a_defect(executor):
    """A parameter of an unknown type makes rclpy raise an exception."""

    def ask():
        (node,) = nodes
        if exceptions_of(nodes) == [run.MOST_EXCEPTIONS + 1]:
            end_process()
        elif node.client.service_is_ready():
            node.client.call_async(SetParameters.Request(parameters=[unknown]))

    unknown = ParameterMessage(name='a', value=ParameterValue(type=100))
    make_nodes, nodes = node_with(
        ask, handle_exception=lambda _: pytest.fail('the node has no defect')
    )

    def make_client():
        (node,) = make_nodes()
        node.client = node.create_client(SetParameters, 'ending/set_parameters')
        return nodes

    assert run.run(make_client, []) == 0


@pytest.mark.parametrize('period', [10.0, 0.01])
def test_ten_exceptions_in_ten_seconds_end_the_node(
    executor, monkeypatch, capfd, period
):
    monkeypatch.setattr(run, 'EXCEPTION_PERIOD', period)
    closed = []
    fail = failing(2 * run.MOST_EXCEPTIONS)
    make_nodes, _ = node_with(fail, close=lambda: closed.append(True))
    if period < 1.0:
        assert run.run(make_nodes, []) == 0
    else:
        with pytest.raises(ZeroDivisionError, match='a defect'):
            run.run(make_nodes, [])
        assert capfd.readouterr().err.count('Traceback') == run.MOST_EXCEPTIONS
    assert closed == [True]


def test_messages_after_an_exception_are_received(executor):
    def receive(_):
        received.append(None)
        if len(received) == 2:
            raise ZeroDivisionError('a defect')

    def publish():
        (node,) = nodes
        if len(received) == MESSAGES:
            end_process()
        elif not sent and node.sent.get_subscription_count():
            for _ in range(MESSAGES):
                node.sent.publish(Empty())
                sent.append(None)

    received = []
    # a busy computer may call the timer again before it delivers the first message
    sent = []
    make_nodes, nodes = node_with(publish, receive=receive)
    assert run.run(make_nodes, []) == 0


@pytest.mark.parametrize(
    'arguments, status, text',
    [
        (['--help'], 0, '--params-file'),
        (['--bogus'], 2, 'unrecognized arguments: --bogus'),
        (['--ros-args', '-p', 'a:=1', '--', 'more'], 2, 'unrecognized arguments: more'),
    ],
)
def test_arguments_of_another_program_are_rejected(
    handlers, capfd, arguments, status, text
):
    with pytest.raises(SystemExit) as end:
        run.run(pytest.fail, arguments)
    captured = capfd.readouterr()
    assert end.value.code == status
    assert text in captured.out + captured.err


@pytest.mark.parametrize(
    'module', [*MODULES, 'nodes.manipulator'], ids=lambda name: name.rpartition('.')[2]
)
def test_help_of_a_node_describes_the_node(capsys, handlers, module):
    executable = import_module(f'facade_manipulator.{module}')
    with pytest.raises(SystemExit) as end:
        executable.main(['--help'])
    text = capsys.readouterr().out
    assert end.value.code == 0
    assert executable.__doc__.splitlines()[0] in text
    assert str(config_path('manipulator.yaml')) in text


@pytest.mark.parametrize(
    'names', [*([name] for name in NODES), CONNECTED], ids='+'.join
)
def test_renamed_node_does_not_start(handlers, ros_domain, capfd, names):
    renaming = ['--ros-args', '-r', '__node:=other']
    status = run.run(lambda: [NODES[name]() for name in names], renaming)
    assert status == 2
    assert (
        'could not start: node name rejected: other; topics, services and parameter files '
        f'require the name {names[0]}; next: '
    ) in capfd.readouterr().err


@pytest.mark.parametrize('name', NODES)
def test_node_with_its_own_name_as_remapping_starts(executor, name):
    """Launch passes the name of a node as a remapping."""

    def make_nodes():
        Timer(0.3, end_process).start()
        return [NODES[name]()]

    assert run.run(make_nodes, ['--ros-args', '-r', f'__node:={name}']) == 0


def test_simulated_time_is_rejected_as_a_live_change(executor):
    def set_time():
        use_sim_time = Parameter('use_sim_time', value=True)
        (nodes[0].result,) = nodes[0].set_parameters([use_sim_time])
        end_process()

    make_nodes, nodes = node_with(set_time)
    assert run.run(make_nodes, []) == 0
    assert not nodes[0].result.successful
    assert 'read-only' in nodes[0].result.reason


def test_messages_before_the_executor_started_are_processed(ros):
    node = rclpy.create_node('late')
    other = ros.node('other')
    received = []
    node.create_subscription(Empty, 'sent', received.append, 3)
    node.create_service(
        Trigger, 'asked', lambda request, response: received.append(request) or response
    )
    publisher = other.create_publisher(Empty, 'sent', 3)
    client = other.create_client(Trigger, 'asked')
    ros.until(
        lambda: client.service_is_ready() and publisher.get_subscription_count(), 'both'
    )
    for _ in range(3):
        publisher.publish(Empty())
    answers = [client.call_async(Trigger.Request()) for _ in range(2)]

    def are_answered():
        return take_waiting(node) or all(answer.done() for answer in answers)

    ros.until(are_answered, 'answers')
    assert [type(one) for one in received] == 3 * [Empty] + 2 * [Trigger.Request]
    node.destroy_node()
