"""Compensator and ik_service in one process: the default deployment, the driver keeps its own."""

from __future__ import annotations

from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.ik_service import IkServiceNode
from facade_manipulator.nodes.runtime import run


def main(args: list[str] | None = None) -> int:
    """Run both nodes in one executor."""
    return run(lambda: [CompensatorNode(), IkServiceNode()], args)


if __name__ == '__main__':
    raise SystemExit(main())
