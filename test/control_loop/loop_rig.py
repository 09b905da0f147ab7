"""Setup of a control loop with simulated drives, and requests to it."""

from replies import future_of

from facade_manipulator.control_loop.loop_channel import (
    Channel,
    channel_ends,
    LoopSetup,
)
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.kinematics import Geometry

# simulated drives are on a virtual bus in the process of the loop; a busy computer must fail no
# test of something else
PATIENT = ControllerSettings(
    boot_timeout=0.5, hold_cycles=3, max_missed_cycles=10, heartbeat_timeout=0.5
)
SETUP = LoopSetup(
    Geometry(),
    PATIENT,
    DEFAULT_AXES,
    simulate='facade_manipulator.simulation.drives.simulator:start_simulator',
)


def ask(client, name):
    """Send a request to a loop; return a future of its reply or its error."""
    answer = future_of(client.request, name)
    client.read()  # a lost loop replies at once
    return answer


def loop_arguments(ends):
    """Return the command-line arguments of a loop for its sockets."""
    return [str(end.fileno()) for end in ends]


def channel_pair():
    """Return both ends of a channel."""
    return tuple(Channel(*ends) for ends in channel_ends())


def waiting_messages(channel):
    """Yield the messages that wait in a channel, of a stream after the commands."""
    yield from channel.commands()
    yield from channel.stream(1000)
