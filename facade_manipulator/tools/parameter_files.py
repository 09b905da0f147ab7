"""
Parameter files of a machine, which every tool finds, checks and names in the same way.

The tools read a file without ROS and reject it as the nodes do. For each node a function reads the
settings that this node declares as ROS parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
import sys
from typing import Any

from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.compensation.compensator import DEFAULTS
from facade_manipulator.compensation.goal import ArrivalSettings
from facade_manipulator.drives.axis_settings import read_axes
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.errors import ParameterError
from facade_manipulator.estimation.settings import EstimatorSetup, SensorNames
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.follower import StreamSettings
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.reference import ReferenceSettings
from facade_manipulator.motion.setpoints import GoalSettings
from facade_manipulator.nodes.settings import DriverSettings, OF_ROS, SimulatorSettings
from facade_manipulator.parameters import (
    nearest,
    NODES,
    ParameterSource,
    read_parameters,
    read_sections,
    require_known_node,
)

Read = Callable[..., Any]  # method of a `ParameterSource`


def announce(tool: str, files: Sequence[Path]) -> None:
    """Print the parameter files that a tool reads, on standard error."""
    names = ', then '.join(map(str, files))
    print(f'{tool}: parameters of {names}', file=sys.stderr)


def read_machine(files: Sequence[Path], node: str) -> dict[str, Any]:
    """
    Return the parameters that files give a node, by full name.

    Raises a ParameterError for a file or a value that the node rejects, and for a name that the
    node does not have. In a section for all nodes, another node may have the name.
    """
    values = read_parameters(files, node)
    own = parameter_names(node, values)
    if all(_is_known(name, own) for name in values):
        return values
    of_any_node = own.union(
        *(parameter_names(other, read_parameters(files, other)) for other in NODES)
    )
    for file in files:
        for section, given in read_sections([file]).items():
            target = require_known_node(section, NODES)
            known = own if target else of_any_node
            for name in given if target in (node, '') else ():
                if not _is_known(name, known):
                    owner = f'{target} has no' if target else 'no node has the'
                    raise ParameterError(
                        f"{file} rejected: {owner} parameter '{name}'"
                        f'{nearest(name, known)}; next: correct or remove it'
                    )
    return values


def _is_known(name: str, known: Collection[str]) -> bool:
    return name in known or name.partition('.')[0] in OF_ROS


def _read_driver(read: Read) -> None:
    """Read all settings of the driver."""
    read(DriverSettings)
    geometry = read(Geometry, 'geometry')
    read(ControllerSettings, 'controller')
    read_axes(read, geometry.stroke)
    read(BusSettings, 'bus')
    read(StreamSettings, 'stream')
    read(MotionLimits, 'limits')


def _read_ik_service(read: Read) -> None:
    """Read all settings of the ik_service."""
    read(Geometry, 'geometry')
    read(GoalSettings)
    read(ReferenceSettings, 'approach')


def _read_compensator(read: Read) -> None:
    """Read all settings of the compensator."""
    read(Geometry, 'geometry')
    for part, default in DEFAULTS._asdict().items():
        read(type(default), '' if part == 'compensation' else part)
    read(ArrivalSettings, 'arrival')


def _read_disturbance_estimator(read: Read) -> None:
    """Read all settings of the estimator; it has a group for each of its sensors."""
    EstimatorSetup.read(read(SensorNames), read)


def _read_gondola_simulator(read: Read) -> None:
    """Read all settings of the simulator."""
    read(Geometry, 'geometry')
    read(SimulatorSettings)


_READERS: dict[str, Callable[[Read], None]] = {
    'driver': _read_driver,
    'ik_service': _read_ik_service,
    'compensator': _read_compensator,
    'disturbance_estimator': _read_disturbance_estimator,
    'gondola_simulator': _read_gondola_simulator,
}


def parameter_names(node: str, values: Mapping[str, Any]) -> set[str]:
    """
    Return the full names of the parameters of a node with values by full name.

    Raises a ParameterError for a value that the node rejects.
    """
    source = ParameterSource(values)
    _READERS[node](source.read)
    return source.names
