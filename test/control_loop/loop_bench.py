"""Setup of a control loop with simulated drives, and requests to it."""

from concurrent.futures import Future

from facade_manipulator.control_loop.channel import LoopSetup
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.kinematics import Geometry

# simulated drives are on a virtual bus in the process of the loop; a busy computer must fail no
# test of something else
SETUP = LoopSetup(
    Geometry(),
    ControllerSettings(
        boot_timeout=0.5, hold_cycles=3, max_missed_cycles=10, heartbeat_timeout=0.5
    ),
    DEFAULT_AXES,
    simulate='facade_manipulator.simulation.drives.simulator:start_simulator',
)


def ask(client, name):
    """Send a request to a loop; return a future of its reply or its error."""
    answer = Future()

    def receive(reply):
        if isinstance(reply, Exception):
            answer.set_exception(reply)
        else:
            answer.set_result(reply)

    client.request(name, receive)
    client.read()  # a lost loop replies at once
    return answer
