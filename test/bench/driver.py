"""Driver of the bench with the loop of `loop.py`; it imports only what the node imports."""

import subprocess
import sys

from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.nodes.run import run


def launch(*ends):
    """Start the observed loop."""
    numbers = [end.fileno() for end in ends]
    return subprocess.Popen(
        [sys.executable, '-m', 'loop', *map(str, numbers)], pass_fds=numbers
    )


if __name__ == '__main__':
    sys.exit(run(lambda: [DriverNode(launch=launch)]))
