"""ROS time for stamps, and timers on the monotonic clock."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer


def ros_time() -> float:
    """Return the present ROS time [s], the system clock: nodes reject `use_sim_time`."""
    return time.time()


def steady_timer(node: Node, period: float, callback: Callable[[], Any], **options: Any) -> Timer:
    """
    Create a timer with a period [s] on the monotonic clock.

    A timer on the node's own clock stands still while the system clock is set back.
    """
    return node.create_timer(
        period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME), **options)
