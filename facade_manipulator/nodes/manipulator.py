"""compensator and ik_service in one process: the default deployment beside the driver."""

from __future__ import annotations

from functools import partial
from typing import Any

from rclpy.node import Node

from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.ik_service import IkServiceNode
from facade_manipulator.nodes.run import run


def make_nodes(**kwargs: Any) -> list[Node]:
    """Return both nodes."""
    return [CompensatorNode(**kwargs), IkServiceNode(**kwargs)]


main = partial(run, make_nodes)

if __name__ == '__main__':
    raise SystemExit(main())
