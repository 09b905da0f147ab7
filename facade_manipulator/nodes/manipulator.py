"""Compensator and ik_service in one process: the default deployment, the driver keeps its own."""

from __future__ import annotations

from functools import partial
from typing import Any

from rclpy.node import Node

from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.ik_service import IkServiceNode
from facade_manipulator.ros.runtime import run


def make_nodes(**kwargs: Any) -> list[Node]:
    """Make both nodes, their poses going straight from one to the other."""
    ik_service = IkServiceNode(**kwargs)
    compensator = CompensatorNode(ik_service.heads, **kwargs)
    compensator.corrected.connect(ik_service.follow, subscribes=True)
    return [compensator, ik_service]


main = partial(run, make_nodes)

if __name__ == '__main__':
    raise SystemExit(main())
