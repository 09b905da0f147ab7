"""Setups of a control loop for its node."""

import itertools
import os

from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.control_loop.control_loop import LoopSetup
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.kinematics import Geometry

# a busy computer must fail no test of something else
CONTROLLER = ControllerSettings(
    boot_timeout=0.5, hold_cycles=3, max_missed_cycles=10, heartbeat_timeout=0.5)
_channels = itertools.count()


def loop_setup() -> LoopSetup:
    """Return a setup with simulated drives on a separate virtual bus."""
    return LoopSetup(
        Geometry(), CONTROLLER, DEFAULT_AXES,
        BusSettings(channel=f'loop {os.getpid()} {next(_channels)}'),
        simulate='facade_manipulator.simulation.drives.simulator:start_simulator')
