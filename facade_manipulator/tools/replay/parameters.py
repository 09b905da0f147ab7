"""Recorded parameters as the settings of today: what differs is named, and some may be changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import yaml

from facade_manipulator.blackbox import RecordedRun
from facade_manipulator.compensation import DEFAULTS
from facade_manipulator.drives.cia402 import axis_defaults, AxisSettings
from facade_manipulator.drives.controller import ControllerSettings
from facade_manipulator.errors import ParameterError, RecordError
from facade_manipulator.estimation import EstimatorSetup, SensorNames
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion import GoalSettings, MotionLimits, StreamSettings
from facade_manipulator.parameters import as_fields, nearest, parameter_fields, settings_from

NODES = ('compensator', 'ik_service', 'driver')
ESTIMATOR = 'disturbance_estimator'


class Section(NamedTuple):
    """Parameters of a node that the replay uses: their prefix, and settings with the defaults."""

    node: str
    prefix: str
    defaults: Any

    def names(self) -> dict[str, str]:
        """Return full names of the parameters by those of the fields."""
        return {field: f'{self.prefix}.{field}'.lstrip('.')
                for field in parameter_fields(type(self.defaults))}


def _default(kind: type[Any], prefix: str = '') -> Any:
    return kind()


SENSORS = EstimatorSetup.read(SensorNames(), _default)
SECTIONS = (
    *(Section(node, 'geometry', Geometry()) for node in NODES),
    *(Section('compensator', '' if part == 'compensation' else part, default)
      for part, default in DEFAULTS._asdict().items()),
    *(Section(ESTIMATOR, name, default) for name, default in (
        ('imu', SENSORS.imu), ('wall', SENSORS.wall), *SENSORS.distances.items(),
        *SENSORS.fixes.items(), *SENSORS.poses.items())),
    Section('ik_service', '', GoalSettings()),
    Section('driver', 'controller', ControllerSettings()),
    Section('driver', 'stream', StreamSettings()),
    Section('driver', 'limits', MotionLimits()),
    *(Section('driver', name, AxisSettings(**own))
      for name, own in axis_defaults(Geometry().stroke).items()),
)


def geometry_of(run: RecordedRun, node: str) -> Geometry:
    """Return the mechanism of a node's parameters; raises a RecordError if they are missing."""
    if node not in run.parameters:
        raise RecordError(f'the parameters of {node} are not in the recording: it had not '
                          'answered the recorder yet')
    return settings_from(Geometry, run.parameters[node], 'geometry')


def changed(run: RecordedRun, changes: Sequence[str]) -> RecordedRun:
    """
    Return a recording whose nodes had other parameters, each given as ``name=value``.

    Raises a ParameterError for a name that no node has.
    """
    parameters = {node: dict(values) for node, values in run.parameters.items()}
    known = {name for section in SECTIONS for name in section.names().values()}
    for change in changes:
        name, is_given, value = change.partition('=')
        if name not in known or not is_given:
            raise ParameterError(f"'{change}' is no NAME=VALUE of a parameter that is replayed"
                                 f'{nearest(name, known)}')
        for section in SECTIONS:
            if name in section.names().values() and section.node in parameters:
                parameters[section.node][name] = yaml.safe_load(value)
    return replace(run, parameters=parameters)


def off_default(run: RecordedRun) -> Iterator[str]:
    """Yield each parameter whose recorded value is not the default of today."""
    for section, values in _recorded(run):
        for field, name in section.names().items():
            default = getattr(section.defaults, field)
            value = as_fields(values).get(name, default)
            if value != default:
                yield f'{section.node} {name} = {value} (default {default})'


def unmatched(run: RecordedRun) -> Iterator[str]:
    """Yield each name that only the recording or only this version has."""
    for section, values in _recorded(run):
        names = set(section.names().values())
        if section.prefix:
            yield from (f'{section.node} has no {name} any more{nearest(name, names)}'
                        for name in values if name.startswith(f'{section.prefix}.')
                        and name not in names)
        yield from (f'{section.node} had no {name} then: the default '
                    f'{getattr(section.defaults, field)} is used; --set {name}=… changes it'
                    for field, name in section.names().items() if name not in values)


def _recorded(run: RecordedRun) -> Iterator[tuple[Section, Mapping[str, Any]]]:
    return ((section, run.parameters[section.node]) for section in SECTIONS
            if section.node in run.parameters)
