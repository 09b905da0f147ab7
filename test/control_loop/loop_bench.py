"""Setup of a control loop with simulated drives."""

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
