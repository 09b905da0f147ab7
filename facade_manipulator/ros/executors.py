"""
The executor that every node's process runs in.

rclpy's EventsExecutor hands a message on in a third of the processor time of the
SingleThreadedExecutor, which builds a wait set for every event. It is experimental: in rclpy 7.1.6
`spin()` without a time-out delivers nothing, and guard conditions are not supported. So it is
spun with a time-out, and only after it has shown that messages arrive.
"""

from __future__ import annotations

import time

import rclpy
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.task import Future
from std_msgs.msg import Empty

PATIENCE = 1.0  # s, for a message that takes some 20 ms
REPEAT = 0.02
LAST_EVENTS = 8
LONGEST_SPIN = 600.0  # s


def choose_executor() -> Executor:
    """Return an EventsExecutor if messages arrive in it, else a SingleThreadedExecutor."""
    try:
        from rclpy.experimental import EventsExecutor

        executor = EventsExecutor()
        _require_messages(executor)
    except Exception as error:  # experimental code may fail in ways nobody has seen yet
        get_logger('facade_manipulator').warning(
            f'the EventsExecutor does not work here ({error}): using the slower '
            'SingleThreadedExecutor')
        return SingleThreadedExecutor()
    return executor


def spin(executor: Executor, end: Future) -> None:
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


def _require_messages(executor: Executor) -> None:
    """Raise unless a node receives its own message, published by its own timer."""
    node = rclpy.create_node(
        'executor_check', use_global_arguments=False, enable_rosout=False,
        start_parameter_services=False)
    received = []
    node.create_subscription(Empty, '~/message', received.append, 1)
    publisher = node.create_publisher(Empty, '~/message', 1)
    node.create_timer(REPEAT, lambda: publisher.publish(Empty()))
    executor.add_node(node)
    try:
        deadline = time.monotonic() + PATIENCE
        while not received:
            if time.monotonic() > deadline:
                raise TimeoutError(f'no message within {PATIENCE:g} s')
            executor.spin_once(timeout_sec=REPEAT)
    finally:
        executor.remove_node(node)
        for _ in range(LAST_EVENTS):  # it lets go of the node in an event of its own
            executor.spin_once(timeout_sec=0.0)
        node.destroy_node()
