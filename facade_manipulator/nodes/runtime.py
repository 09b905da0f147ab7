"""Start and end of a node's process: the same for every executable."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import sys

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from facade_manipulator.errors import ManipulatorError

LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)

USAGE_ERROR = 2


def run(make_nodes: Callable[[], Sequence[Node]], args: list[str] | None = None) -> int:
    """
    Spin the nodes until SIGINT, SIGTERM or a shutdown; return the process's exit status.

    A `ManipulatorError` while the nodes are made, such as a parameter out of range, is one
    sentence on stderr and exit status 2. A node with a method ``close`` is closed first, so that
    it can stop what it moves whatever ended the process.
    """
    nodes: Sequence[Node] = ()
    try:
        rclpy.init(args=args)
        nodes = make_nodes()
        _spin(nodes)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except ManipulatorError as error:
        print(f'refused to start: {error}', file=sys.stderr)
        return USAGE_ERROR
    finally:
        _close(nodes)
        rclpy.try_shutdown()
    return 0


def _spin(nodes: Sequence[Node]) -> None:
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    executor.spin()


def _close(nodes: Sequence[Node]) -> None:
    for node in nodes:
        if hasattr(node, 'close'):
            node.close()
        node.destroy_node()
