"""Parameter files as the nodes read them: what is in them, and whether each would start."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from facade_manipulator.blackbox import BlackBoxSettings
from facade_manipulator.compensation import (
    ArrivalSettings,
    DEFAULTS,
    FrictionSettings,
    WorkspaceLimit,
)
from facade_manipulator.drives.canopen import BusSettings
from facade_manipulator.drives.cia402 import axis_defaults, AxisSettings
from facade_manipulator.drives.controller import ControllerSettings
from facade_manipulator.errors import ParameterError
from facade_manipulator.estimation import EstimatorSetup, SensorNames
from facade_manipulator.interfaces import COMPENSATOR, DRIVER, ESTIMATOR, IK, RECORDER
from facade_manipulator.kinematics import Geometry
from facade_manipulator.loop import StoppingAnalysis
from facade_manipulator.maintenance import ServiceSettings
from facade_manipulator.motion import GoalSettings, MotionLimits, ReferenceSettings, StreamSettings
from facade_manipulator.nodes.settings import (
    ContactSettings,
    DriverSettings,
    LinkageSettings,
    RateSettings,
    WorkspaceSettings,
)
from facade_manipulator.parameter_file import (
    check_names,
    given_in,
    given_settings,
    GivenParameter,
    read_parameters,
)
from facade_manipulator.parameters import names_in_full, parameter_names

Settings = TypeVar('Settings')
#: by node, with their prefixes; what depends on others is read by `_CHECKS`
SECTIONS: dict[str, dict[str, type]] = {
    DRIVER: {'': DriverSettings, 'bus': BusSettings, 'stream': StreamSettings,
             'service': ServiceSettings},
    COMPENSATOR: {'': RateSettings, 'arrival': ArrivalSettings},
    IK: {'geometry': Geometry, '': GoalSettings, 'approach': ReferenceSettings,
         'workspace': WorkspaceSettings, 'linkage': LinkageSettings,
         'friction': FrictionSettings, 'contact_wrench': ContactSettings},
    RECORDER: {'': BlackBoxSettings},
    ESTIMATOR: {},
}


class GivenSettings:
    """What files give a node: its settings, all names that it knows, and what is wrong."""

    def __init__(self, paths: Sequence[Path], node: str, namespace: str | None = None) -> None:
        self._values = read_parameters(paths, node, namespace)
        self.known: set[str] = set()
        self.wrong: list[str] = []
        for prefix, cls in SECTIONS[node].items():
            self.read(cls, prefix)

    def read(self, kind: type[Settings], prefix: str = '', **defaults: Any) -> Settings:
        """Return settings below a prefix; any that are right where what is given is wrong."""
        self.known.update(parameter_names(kind, prefix))
        try:
            with names_in_full(kind, prefix):
                return given_settings(kind, self._values, prefix, **defaults)
        except ParameterError as error:
            self.wrong.append(str(error))
            return kind()


def read_driver(paths: Sequence[Path]) -> StoppingAnalysis:
    """Return the analysis of the driver that files make; raises for what it would reject."""
    given = GivenSettings(paths, DRIVER)
    analysis = _analysis(given)
    check_names(_everything(paths), {DRIVER: given.known}, given.wrong.append, lambda _: None)
    if given.wrong:
        raise ParameterError(f'{paths[-1]}: {"; ".join(given.wrong)}')
    return analysis


def examine(paths: Sequence[Path], namespace: str | None = None) -> dict[str, GivenSettings]:
    """Read what files give all nodes but the simulator; raises as `read_parameters`."""
    found = {node: GivenSettings(paths, node, namespace) for node in SECTIONS}
    for node, read in _READ.items():
        check, given = read(found[node]), found[node]
        try:
            if not given.wrong:  # else it would be about values that nobody gave
                check()
        except ParameterError as error:
            given.wrong.append(str(error))
    return found


def complaints(paths: Sequence[Path], found: Mapping[str, GivenSettings]) -> list[str]:
    """Return why the nodes would not start, and what no node knows, each once."""
    nodes: dict[str, list[str]] = {}
    for node, given in found.items():
        for one in given.wrong:
            nodes.setdefault(one, []).append(node)
    wrong = [f'{", ".join(names)}: {one}' for one, names in nodes.items()]
    check_names(_everything(paths), {node: given.known for node, given in found.items()},
                wrong.append, wrong.append)
    return wrong


def _everything(paths: Sequence[Path]) -> Iterator[tuple[GivenParameter, str]]:
    return (one for path in paths for one in given_in(path))


def _analysis(given: GivenSettings) -> StoppingAnalysis:
    geometry = given.read(Geometry, 'geometry')
    axes = tuple(given.read(AxisSettings, name, **defaults)
                 for name, defaults in axis_defaults(geometry.stroke).items())
    return StoppingAnalysis(geometry, given.read(MotionLimits, 'limits'), axes,
                            given.read(ControllerSettings, 'controller'))


def _workspace_limit(given: GivenSettings) -> Callable[[], object]:
    parts = {part: given.read(type(default), '' if part == 'compensation' else part)
             for part, default in DEFAULTS._asdict().items()}
    return partial(WorkspaceLimit, given.read(Geometry, 'geometry'), parts['workspace_limit'])


def _sensors(given: GivenSettings) -> Callable[[], object]:
    setup = EstimatorSetup.read(given.read(SensorNames), given.read)
    return lambda: setup  # nothing more


#: reads what the table above has not, and returns what checks all of it together
_READ: dict[str, Callable[[GivenSettings], Callable[[], object]]] = {
    DRIVER: lambda given: _analysis(given).check,
    COMPENSATOR: _workspace_limit,
    ESTIMATOR: _sensors,
}
