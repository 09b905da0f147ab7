"""Timers that a system clock that is set does not stop, and a node that lets nobody stop time."""

from __future__ import annotations

from collections.abc import Callable
import math
import time
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer

from facade_manipulator.errors import ParameterError

SIMULATED_TIME = 'use_sim_time'
_REASON = ('use_sim_time = true is not possible: whoever publishes /clock could stop the '
           'supervision of the drives, and stamps of another time are rejected; start without it')


def steady_timer(node: Node, period: float, callback: Callable[[], Any], **options: Any) -> Timer:
    """
    Create a timer on a clock that nobody sets.

    A node's own timers stand still for as long as the system clock is set back.
    """
    return node.create_timer(
        period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME), **options)


def steady_timers(
    node: Node, period: float, often: Callable[[], Any], longer: float, seldom: Callable[[], Any]
) -> None:
    """
    Call a function in each period [s], and after it another one about once in a longer period.

    One timer does both: to wake a node once more costs more than most callbacks take. On a
    computer so busy that the timer comes late both are called each time it comes.
    """
    due = -math.inf

    def call() -> None:
        nonlocal due
        often()
        now = time.monotonic()
        if now >= due:
            due = now + longer - 0.5 * period
            seldom()

    steady_timer(node, period, call)


def reject_simulated_time(node: Node) -> None:
    """
    Let a node live in the time of its computer, now and later.

    Raises
    ------
    ParameterError
        Time is simulated.

    """
    if node.get_parameter(SIMULATED_TIME).value:
        raise ParameterError(_REASON)

    def check(parameters: list[Any]) -> SetParametersResult:
        simulates = any(one.name == SIMULATED_TIME and one.value for one in parameters)
        return SetParametersResult(successful=not simulates, reason=_REASON if simulates else '')

    node.add_on_set_parameters_callback(check)
