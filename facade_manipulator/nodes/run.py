"""Process of one or several nodes: start, run and end."""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
import gc
import os
from pathlib import Path
import re
import signal
import sys
import time
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterType
import rclpy
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from facade_manipulator import config_path, parameters
from facade_manipulator.drives.realtime import request_node_priority
from facade_manipulator.errors import file_sentence, ManipulatorError, ParameterError
from facade_manipulator.nodes.base_node import BaseNode, CallbackError
from facade_manipulator.nodes.node_parameters import (
    parameter_files,
    reject_unknown_parameters,
)
from facade_manipulator.nodes.workarounds import ROSError, take_waiting

try:
    from rclpy.experimental import EventsExecutor
except ImportError:  # half the processor time of the other executor; some rclpy lack it
    EventsExecutor = SingleThreadedExecutor

LOG_STEP = 'next: set ROS_LOG_DIR to a folder that you may write'


FAILED, USAGE_ERROR = 1, 2  # exit statuses
SIMULATED_TIME = (
    'use_sim_time rejected: it is true and must be false, because a publisher of /clock '
    'could stop the supervision of the drives; next: remove use_sim_time'
)


def run(
    make_nodes: Callable[[], Sequence[BaseNode]], args: list[str] | None = None
) -> int:
    """
    Run the nodes of a process until a signal or a lifecycle shutdown; return the exit status.

    The method ``close`` of each node is called while ROS still runs. A `ManipulatorError` at the
    start ends in one line on standard error and exit status 2. After an end of ROS without a
    signal, the exit status is 1.
    """
    signals: list[int] = []
    handle_signals(signal.default_int_handler)  # no carriage moves yet: end at once
    nodes: Sequence[BaseNode] = ()
    try:
        with ros_errors():
            parameters.read_sections(parameter_files(args))  # its errors name the file
            _reject_other_arguments(make_nodes, args)
            initialise(args)
            nodes = make_nodes()
        _require_own_names(nodes)
        handle_signals(partial(_stop, signals))
        reject_unknown_parameters(nodes, args)
        for node in nodes:
            if node.get_parameter('use_sim_time').value:
                raise ParameterError(SIMULATED_TIME)
            node.set_descriptor(
                'use_sim_time',
                ParameterDescriptor(type=ParameterType.PARAMETER_BOOL, read_only=True),
            )
            node.get_logger().info(f'ready{node.next_step()}')
        if all(node.wants_priority for node in nodes):
            request_node_priority()
        gc.freeze()  # later collections skip the objects of the start
        _spin(nodes, signals)
    except ExternalShutdownException:
        print(
            'ended without a signal: ROS was shut down in this process', file=sys.stderr
        )
        return FAILED
    except KeyboardInterrupt:
        return 0
    except ManipulatorError as error:
        print(f'could not start: {error}', file=sys.stderr)
        return USAGE_ERROR
    finally:
        handle_signals(signal.SIG_IGN)  # another signal must not interrupt the end
        for node in nodes:
            node.close()
            node.destroy_node()
        nodes = ()
        gc.unfreeze()
        gc.collect()  # before the interpreter ends: ruckig would report its objects as leaks
        rclpy.try_shutdown()
    return 0


def _stop(signals: list[int], number: int, _: object) -> None:
    """Request the end; a second signal also ends callbacks that do not return."""
    # with EventsExecutor the loop never ends while messages arrive faster than callbacks return
    if signals:
        raise KeyboardInterrupt
    signals.append(number)


# number of exceptions within this time [s] that ends a node
MOST_EXCEPTIONS, EXCEPTION_PERIOD = 10, 10.0


def _spin(nodes: Sequence[BaseNode], signals: Sequence[int]) -> None:
    """Run callbacks; log and count exceptions, and raise the tenth programming error in 10 s."""
    executor = EventsExecutor()
    for node in nodes:
        executor.add_node(node)
    times: deque[float] = deque(maxlen=MOST_EXCEPTIONS)
    behind = list(nodes)  # nodes for which messages may wait in the middleware
    while not signals and not any(node.is_finalized for node in nodes):
        try:
            _run_callbacks(executor, nodes, behind)
        except Exception as error:
            behind = list(nodes)
            if _report_exception(nodes, error):
                times.append(time.monotonic())
            is_last = len(times) == MOST_EXCEPTIONS
            if is_last and times[-1] - times[0] < EXCEPTION_PERIOD:
                raise _original(error) from None
        if not rclpy.ok():
            raise ExternalShutdownException


SIGNAL_CHECK_PERIOD = 0.1  # s, maximum delay of a signal


def _run_callbacks(
    executor: Executor, nodes: Sequence[BaseNode], behind: list[BaseNode]
) -> None:
    """Run callbacks for `SIGNAL_CHECK_PERIOD`, then the callbacks of waiting messages."""
    # returning at each event would cost a twentieth of the time of a fast node
    executor.spin_until_future_complete(Future(), timeout_sec=SIGNAL_CHECK_PERIOD)
    while behind:
        take_waiting(behind.pop())
    for node in nodes:
        node.raise_event_error()


def _original(error: Exception) -> Exception:
    """Return the exception that a callback raised; the error itself if no callback raised it."""
    cause = error.__cause__
    if isinstance(error, CallbackError) and isinstance(cause, Exception):
        return cause
    return error


def _report_exception(nodes: Sequence[BaseNode], error: Exception) -> bool:
    """
    Log and count an exception of a node's callback; return whether it is a programming error.

    An exception without a callback comes from rclpy or from the middleware, and concerns all
    nodes. Nothing is reported after the end of ROS.
    """
    if not rclpy.ok():
        return False
    if not isinstance(error, CallbackError):
        for node in nodes:
            node.count_exception(error)
        return True
    original = _original(error)
    error.node.count_exception(original)
    if error.is_defect:
        error.node.handle_exception(original)
    return error.is_defect


def initialise(args: list[str] | None = None) -> None:
    """Initialise ROS without its signal handlers; raise a ManipulatorError if ROS rejects this."""
    try:
        with ros_errors():
            rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # of a log file that cannot be opened
        raise ManipulatorError(f'{error}; {LOG_STEP}') from error


@contextmanager
def ros_errors() -> Iterator[None]:
    """Convert errors of ROS or of the user's files to a ManipulatorError."""
    try:
        yield
    except OSError as error:
        if error.filename is None:  # not the failure of a file
            raise
        raise ManipulatorError(file_sentence(error)) from error
    except ROSError as error:
        # places in the code of ROS
        message = re.sub(', at [^ ,]+:[0-9]+', '', str(error))
        hint = ''
        if 'logging' in str(error):
            hint = f'; {LOG_STEP}'
        elif os.environ.get('ROS_SECURITY_STRATEGY') == 'Enforce':
            hint = '; next: check whether this enclave is in the keystore'
        raise ManipulatorError(f'{message}{hint}') from error


STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def handle_signals(action: Callable[[int, Any], object] | signal.Handlers) -> None:
    """Set the handler of all signals that end a process, except SIGHUP under nohup."""
    for number in STOP_SIGNALS:
        # nohup has set SIG_IGN
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, action)


def _require_own_names(nodes: Sequence[BaseNode]) -> None:
    """
    Raise a ParameterError if a node is renamed.

    The names of topics, services and sections of parameter files contain the node's own name.
    """
    for node in nodes:
        if node.get_name() != node.own_name:
            raise ParameterError(
                f'node name rejected: {node.get_name()}; topics, services and parameter files '
                f'require the name {node.own_name}; next: replace the remapping of '
                f'__node with a namespace, such as -r __ns:=/{node.get_name()}'
            )


ROS_ARGUMENTS = """\
ROS arguments:
  --ros-args             begin of the ROS arguments
  --params-file FILE     read parameters from a file; a later file overrides an earlier file
  -p NAME:=VALUE         set a parameter
  -r __ns:=/NAME         put the node into the namespace of a machine
  --log-level LEVEL      log from this severity: debug, info, warn or error

Example:
  {name} --ros-args --params-file {file} -r __ns:=/gondola_1

The page docs/reference.md describes the topics, services and parameters. `ros2 node info` and
`ros2 param describe` show those of a running node.
"""


def _reject_other_arguments(
    make_nodes: Callable[[], Sequence[BaseNode]], args: list[str] | None
) -> None:
    """Answer ``--help``; exit if an argument is unknown to ROS."""
    words = remove_ros_args(args=sys.argv if args is None else ['node', *args])
    name = Path(words[0]).stem
    module = sys.modules[make_nodes.__module__]
    argparse.ArgumentParser(
        prog=name,
        description=module.__doc__,
        epilog=ROS_ARGUMENTS.format(name=name, file=config_path('manipulator.yaml')),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    ).parse_args(words[1:])
