"""Driver of the bench with the loop of `loop.py`; it imports only what the node imports."""

import subprocess
import sys
import time

from facade_manipulator.control_loop.loop_client import LoopClient
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.nodes import driver
from facade_manipulator.nodes.run import run


class ObservedClient(LoopClient):
    """Client that adds to each setpoint the time at which it is passed to the loop [s]."""

    def send_setpoint(self, setpoint: Setpoint) -> None:
        self._channel.send('setpoint', *setpoint, time.time())


def launch(*ends):
    """Start the observed loop."""
    numbers = [end.fileno() for end in ends]
    command = [sys.executable, '-m', 'loop', *map(str, numbers)]
    return subprocess.Popen(command, pass_fds=numbers)


if __name__ == '__main__':
    driver.LoopClient = ObservedClient
    sys.exit(run(lambda: [driver.DriverNode(launch=launch)]))
