"""Parameters of the driver and of its control loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from rclpy.node import Node

from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.control_loop.channel import LoopSetup
from facade_manipulator.drives.axis_settings import read_axes
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.stopping_distances import StoppingAnalysis
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.follower import StreamSettings
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.nodes.parameters import declare

# a name, because the simulator imports the CAN libraries, which only the loop needs
SIMULATOR = 'facade_manipulator.simulation.drives.simulator:start_simulator'


def declare_setup(
    node: Node, is_simulated: bool, on_limits: Callable[[MotionLimits], None]
) -> LoopSetup:
    """Return the settings of the control loop; `on_limits` receives live changes of the limits."""
    geometry = declare(node, Geometry, 'geometry')
    controller = declare(node, ControllerSettings, 'controller')
    axes = read_axes(partial(declare, node), geometry.stroke)
    bus = declare(node, BusSettings, 'bus')
    stream = declare(node, StreamSettings, 'stream')
    limits = declare(
        node,
        MotionLimits,
        'limits',
        on_limits,
        lambda limits: StoppingAnalysis(geometry, limits, axes, controller).check(),
    )
    log_level = int(node.get_logger().get_effective_level())  # the numbers of logging
    setup = LoopSetup(
        geometry, controller, axes, bus, stream, limits, log_level=log_level
    )
    return (
        setup
        if not is_simulated
        else replace(setup, bus=replace(bus, interface='virtual'), simulate=SIMULATOR)
    )
