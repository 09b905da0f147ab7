"""Start and end of a node's process: the same for every executable."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import errno
import gc
import os
from pathlib import Path
import signal
import sys
import time
from typing import NoReturn

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args
from std_msgs.msg import Empty

from facade_manipulator import interfaces
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.nodes.parameters import reject_unknown_parameters
from facade_manipulator.ros.clocks import reject_simulated_time
from facade_manipulator.ros.interfaces import publisher, subscription
from facade_manipulator.ros.rclpy_internals import require_of_rclpy, ROSError, take_what_waits

SHUT_DOWN, USAGE_ERROR = 1, 2
NO_LOG_FILES = '--disable-external-lib-logs'  # argument of ROS
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
CHECK_TIMEOUT = 1.0  # s, for an executor's first message, which takes some 20 ms
CHECK_PERIOD = 0.02  # s, between the messages sent meanwhile
LAST_EVENTS = 8  # in which an executor lets go of a node
LONGEST_SPIN = 600.0  # s
WATCH_PERIOD = 0.05  # s


def run(
    make_nodes: Callable[[], Sequence[Node]], args: list[str] | None = None,
    watch_period: float = WATCH_PERIOD,
) -> int:
    """
    Spin the nodes until a signal or lifecycle's shutdown; return the process's exit status.

    A `ManipulatorError` while the nodes are made, such as a parameter out of range, is one
    message on stderr and exit status 2; so is the end of ROS without a signal, with status 1:
    no node ends without a word. A node with a method ``close`` is closed first, while
    ROS still runs: rclpy's own signal handlers would end ROS before, under a waiting executor.
    A signal is seen within `watch_period` [s].
    """
    received: list[int | str] = []  # signals, and names of nodes that were shut down
    _on_signals(_interrupt)
    nodes: Sequence[Node] = ()
    try:
        nodes = _start(make_nodes, args)
        _on_signals(lambda number, _: received.append(number))
        reject_unknown_parameters(nodes, args)
        for node in nodes:  # a managed node says what is next
            reject_simulated_time(node)
            require_of_rclpy(node.get_clock(), 'handle')
            node.get_logger().info('ready' + getattr(node, 'following_step', str)())
        namespace = nodes[0].get_namespace()
        _spin(nodes, received, choose_executor(namespace), watch_period)
    except ExternalShutdownException:
        pass
    except KeyboardInterrupt:
        return 0
    except ManipulatorError as error:
        print(f'could not start: {error}', file=sys.stderr)
        return USAGE_ERROR
    finally:
        _close(nodes)
        nodes = ()
        gc.unfreeze()
        gc.collect()  # nodes end before the interpreter does: ruckig would report them as leaks
        rclpy.try_shutdown()
        for number in STOP_SIGNALS:  # a second one now would look as if the node had died
            signal.signal(number, signal.SIG_IGN)
    if not received:
        print('ended, though by no signal: ROS was shut down in this process', file=sys.stderr)
        return SHUT_DOWN
    return 0


def _on_signals(action: Callable[[int, object], object]) -> None:
    for number in STOP_SIGNALS:
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:  # of nohup
            signal.signal(number, action)


def _interrupt(*_: object) -> NoReturn:
    """End while nodes are made: nothing moves, and what they wait for may take its time."""
    raise KeyboardInterrupt


def _reject_other_arguments(args: list[str] | None) -> None:
    """Answer ``--help``, and end at an argument that ROS does not read: nobody else does."""
    words = remove_ros_args(args=sys.argv if args is None else ['node', *args])
    argparse.ArgumentParser(
        prog=Path(words[0]).name, description='A node of facade_manipulator.', epilog=(
            'ROS arguments follow --ros-args: --params-file FILE, -p NAME:=VALUE, -r __ns:=/NAME. '
            'Parameters: ros2 param list, ros2 param describe, config/manipulator.yaml.'),
    ).parse_args(words[1:])


def _start(make_nodes: Callable[[], Sequence[Node]], args: list[str] | None) -> Sequence[Node]:
    """Make the nodes; what ROS itself rejects, such as a parameter file, is a message too."""
    with ros_errors():
        _reject_other_arguments(args)
        initialise(args)
        return make_nodes()


def initialise(args: list[str] | None = None) -> None:
    """
    Initialise ROS, with signals left to this process.

    Raises a ManipulatorError if ROS rejects its arguments, or cannot write its logs.
    """
    if NO_LOG_FILES not in (sys.argv if args is None else args):
        _require_log_folder()
    with ros_errors():
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)


def _require_log_folder() -> None:
    """Raise a ManipulatorError where ROS would fail with its own report of several lines."""
    base = os.environ.get('ROS_HOME') or (
        f'{os.environ["HOME"]}/.ros' if os.environ.get('HOME') else '')
    folder = os.environ.get('ROS_LOG_DIR') or (f'{base}/log' if base else '')
    try:
        if not folder:
            raise OSError('HOME is not set')
        folder = os.path.expanduser(folder)
        os.makedirs(folder, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), folder)
    except OSError as error:
        reason = f'{folder}: {error.strerror}' if error.strerror else error
        raise ManipulatorError(f'ROS cannot write its logs: {reason}; next: set ROS_LOG_DIR to a '
                               'folder that you may write') from error


@contextmanager
def ros_errors() -> Iterator[None]:
    """Raise a ManipulatorError for what ROS itself rejects."""
    try:
        yield
    except ROSError as error:
        is_enforced = os.environ.get('ROS_SECURITY_STRATEGY') == 'Enforce'
        hint = ': ROS_SECURITY_STRATEGY is Enforce; is this enclave in its keystore?'
        raise ManipulatorError(f'{error}{hint if is_enforced else ""}') from error


def _spin(
    nodes: Sequence[Node], received: list[int | str], executor: Executor, watch_period: float,
) -> None:
    for node in nodes:
        executor.add_node(node)
    gc.freeze()  # what start-up made stays: no collection has to look at it again
    end = Future()
    rclpy.get_default_context().on_shutdown(lambda: end.set_result(None))
    steady = Clock(clock_type=ClockType.STEADY_TIME)  # simulated time may stand still

    unread = list(nodes)

    def watch() -> None:
        while unread:  # the executor listens before it calls a timer
            take_what_waits(unread.pop())
        received.extend(node.get_name() for node in nodes if getattr(node, 'is_over', False))
        if received:
            end.set_result(None)

    nodes[0].create_timer(watch_period, watch, clock=steady)
    try:
        spin_until(executor, end)
    finally:
        end.cancel()  # after an error it would still call the executor, which is gone by then


def _close(nodes: Sequence[Node]) -> None:
    for node in nodes:
        if hasattr(node, 'close'):
            node.close()
        node.destroy_node()


def choose_executor(namespace: str = '') -> Executor:
    """
    Return an EventsExecutor if messages arrive in it, else a SingleThreadedExecutor.

    The messages are in the nodes' namespace, where the policy of SROS2 allows them.

    rclpy's EventsExecutor hands a message on in a third of the processor time of the
    SingleThreadedExecutor, which builds a wait set for every event. It is experimental: in rclpy
    7.1.6 `spin()` without a time-out delivers nothing, and guard conditions are not supported. So
    it is spun with a time-out, and only after it has shown that messages arrive.
    """
    try:
        from rclpy.experimental import EventsExecutor

        executor = EventsExecutor()
        _require_messages(executor, namespace)
    except Exception as error:  # experimental code may fail in ways nobody has seen yet
        get_logger('facade_manipulator').warning(
            f'the EventsExecutor does not work here ({error}): using the slower '
            'SingleThreadedExecutor')
        return SingleThreadedExecutor()
    return executor


def spin_until(executor: Executor, end: Future) -> None:
    """
    Spin until a future is done; something has to happen in the executor for it to be seen.

    To come back from the EventsExecutor at every event would cost 5 % of a fast node's time. The
    SingleThreadedExecutor leaves a callback on the future for every event that it waits for.
    """
    while not end.done():
        if isinstance(executor, SingleThreadedExecutor):
            executor.spin_once(timeout_sec=LONGEST_SPIN)
        else:
            executor.spin_until_future_complete(end, timeout_sec=LONGEST_SPIN)


def _require_messages(executor: Executor, namespace: str) -> None:
    """Raise unless a node receives its own message, published by its own timer."""
    node = rclpy.create_node(
        'executor_check', namespace=namespace, use_global_arguments=False, enable_rosout=False,
        start_parameter_services=False)
    received: list[Empty] = []
    subscription(node, interfaces.EXECUTOR_CHECK, received.append)
    sender = publisher(node, interfaces.EXECUTOR_CHECK)
    node.create_timer(CHECK_PERIOD, lambda: sender.publish(Empty()))
    executor.add_node(node)
    try:
        deadline = time.monotonic() + CHECK_TIMEOUT
        while not received:
            if time.monotonic() > deadline:
                raise TimeoutError(f'no message within {CHECK_TIMEOUT:g} s')
            executor.spin_once(timeout_sec=CHECK_PERIOD)
    finally:
        executor.remove_node(node)
        for _ in range(LAST_EVENTS):  # it lets go of the node in an event of its own
            executor.spin_once(timeout_sec=0.0)
        node.destroy_node()
