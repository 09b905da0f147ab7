"""Driver of the bench with the loop of `loop.py`; it imports only what the node imports."""

from pathlib import Path
import subprocess
import sys

from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.nodes.run import run


def launch(end):
    """Start the observed loop."""
    number, program = end.fileno(), Path(__file__).with_name('loop.py')
    return subprocess.Popen([sys.executable, program, str(number)], pass_fds=[number])


if __name__ == '__main__':
    sys.exit(run(lambda: [DriverNode(launch=launch)]))
