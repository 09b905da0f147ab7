"""
Settings of each node, without ROS, so that tools read the same groups of parameters.

Each set-up class has one method `read`. A node reads the parameters that it receives from ROS. A
tool reads the parameters in a parameter file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from facade_manipulator.compensation.goal import ArrivalSettings
from facade_manipulator.compensation.pose_compensator import CompensatorSettings
from facade_manipulator.control_loop.loop_channel import LoopSetup
from facade_manipulator.estimation.estimator_settings import EstimatorSetup
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.head_path import ReferenceSettings
from facade_manipulator.parameters import (
    parameter,
    ParameterSource,
    require_topics,
    settings,
)

OF_ROS = ('use_sim_time', 'start_type_description_service', 'qos_overrides')


@settings
class DriverSettings:
    """Settings of the driver node, except the settings of the controller."""

    simulate_drives: bool = parameter(
        'Whether the driver starts simulated drives on a virtual bus', default=False
    )
    configure_at_start: bool = parameter(
        'Whether the driver configures itself at its start, without powering the drives',
        default=False,
    )
    software_stop_timeout: float = parameter(
        'Silence of software_stop, after a first message, that stops the drives and forbids power',
        default=0.5,
        unit='s',
        minimum=0.05,
        maximum=10.0,
    )
    software_stop_topics: tuple[str, ...] = parameter(
        'Topics on which supervisors forbid power, one for each supervisor',
        default=('software_stop',),
    )

    def __post_init__(self) -> None:
        """Raise a ParameterError if a topic has a name that ROS rejects."""
        require_topics('software_stop_topics', self.software_stop_topics)


@settings
class SimulatorSettings:
    """Selection of the simulated world; the scenario file contains all values."""

    scenario: str = parameter(
        'Name of a scenario in config/scenarios, or path of a file', default='breeze'
    )
    viewer: bool = parameter("Whether MuJoCo's viewer shows the world", default=False)


# a name, because the simulator imports the CAN libraries, which only the loop needs
SIMULATOR = 'facade_manipulator.simulation.drives.simulator:start_simulator'


class DriverSetup(NamedTuple):
    """Settings of the driver node and of its control loop."""

    node: DriverSettings
    loop: LoopSetup

    @classmethod
    def read(cls, source: ParameterSource) -> DriverSetup:
        """Read the parameters of the driver; simulated drives use a virtual bus."""
        node = source.read(DriverSettings)
        loop = LoopSetup.read(source)
        if node.simulate_drives:
            bus = replace(loop.bus, interface='virtual')
            loop = replace(loop, bus=bus, simulate=SIMULATOR)
        return cls(node, loop)


class IkServiceSetup(NamedTuple):
    """Settings of the ik_service."""

    geometry: Geometry
    reference: ReferenceSettings

    @classmethod
    def read(cls, source: ParameterSource) -> IkServiceSetup:
        """Read the parameters of the ik_service."""
        return cls(
            geometry=source.read(Geometry, 'geometry'),
            reference=source.read(ReferenceSettings, 'reference'),
        )


class CompensatorSetup(NamedTuple):
    """Settings of the compensator node and of its components."""

    geometry: Geometry
    parts: CompensatorSettings
    arrival: ArrivalSettings

    @classmethod
    def read(cls, source: ParameterSource) -> CompensatorSetup:
        """Read the parameters of the compensator."""
        return cls(
            geometry=source.read(Geometry, 'geometry'),
            parts=CompensatorSettings.read(source),
            arrival=source.read(ArrivalSettings, 'arrival'),
        )


class SimulatorSetup(NamedTuple):
    """Settings of the gondola_simulator."""

    geometry: Geometry
    world: SimulatorSettings

    @classmethod
    def read(cls, source: ParameterSource) -> SimulatorSetup:
        """Read the parameters of the gondola_simulator."""
        return cls(
            geometry=source.read(Geometry, 'geometry'),
            world=source.read(SimulatorSettings),
        )


_READERS: dict[str, Callable[[ParameterSource], object]] = {
    'driver': DriverSetup.read,
    'ik_service': IkServiceSetup.read,
    'compensator': CompensatorSetup.read,
    'disturbance_estimator': EstimatorSetup.read,
    'gondola_simulator': SimulatorSetup.read,
}


def parameter_names(node: str, values: Mapping[str, Any]) -> set[str]:
    """
    Return the full names of a node's parameters; `values` are the given values by full name.

    Raises a ParameterError for a value that the node rejects.
    """
    source = ParameterSource(values)
    _READERS[node](source)
    return source.names
