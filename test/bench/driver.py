"""Driver of the bench with the loop of `loop.py`; it imports only what the node imports."""

import subprocess
import sys

from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.nodes.run import run


def launch(end):
    """Start the observed loop."""
    number = end.fileno()
    return subprocess.Popen(
        [sys.executable, '-m', 'loop', str(number)], pass_fds=[number]
    )


if __name__ == '__main__':
    sys.exit(run(lambda: [DriverNode(launch=launch)]))
