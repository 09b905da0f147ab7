"""compensator and ik_service in one process: the default deployment beside the driver."""

from functools import partial

from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.ik_service import IkServiceNode
from facade_manipulator.nodes.run import run

main = partial(run, lambda: [CompensatorNode(), IkServiceNode()])

if __name__ == '__main__':
    raise SystemExit(main())
