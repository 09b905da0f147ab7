"""
Scenarios: one YAML file says what the gondola does and what is asked of the manipulator.

Each section of the file holds values of one settings dataclass; what is not named has its
default. The section ``compensator`` holds sections of the compensator's own settings.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from facade_manipulator.compensation.compensator import CompensatorSettings, DEFAULTS
from facade_manipulator.compensation.suspension import SuspensionSettings
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Pose
from facade_manipulator.lab.gondola.facade import FacadeSettings
from facade_manipulator.lab.gondola.gondola import Gondola, GondolaSettings
from facade_manipulator.lab.gondola.motion import (
    load_recording,
    load_spectrum,
    Motion,
    Sway,
    SwaySettings,
)
from facade_manipulator.lab.gondola.rail_sensors import SensorSettings
from facade_manipulator.lab.gondola.sensors import EstimatorSettings, ForceSensorSettings
from facade_manipulator.lab.gondola.wall import WallSettings
from facade_manipulator.lab.gondola.wind import WindSettings
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.resources import config_path

FOLDER = 'scenarios'
WITHOUT_REACTION = 'without_reaction'
Sections = Mapping[str, Any]


@settings
class MissionSettings:
    """What moves the gondola and what the head is to do meanwhile."""

    description: str = parameter('What happens', default='')
    motion: str = parameter(
        'What moves the gondola', default='sway',
        choices=('sway', 'wind', 'recording', 'spectrum'))
    recording: str = parameter(
        "CSV file of a recorded disturbance or of its spectrum, in the scenario's file relative "
        'to that', default='')
    duration: float = parameter(
        'How long the scenario lasts', default=60.0, unit='s', minimum=1.0, maximum=3600.0)
    shows: str = parameter(
        'Event that a demo shows last', default='the head at rest at its first goal')
    shown_after: float = parameter(
        'Shortest duration of a demo that shows the event', default=5.0, unit='s', minimum=1.0,
        maximum=3600.0)
    goal_period: float = parameter(
        'Time from one goal to the next', default=6.0, unit='s', minimum=0.5, maximum=600.0)
    goals: tuple[float, ...] = parameter(
        'Goals on the wall, one after the other: x, y, theta of each',
        default=(0.0, 0.25, 0.0, 0.12, 0.25, 0.0, -0.12, 0.25, 0.0, -0.12, 0.265, 0.0524,
                 0.12, 0.265, 0.0524, 0.12, 0.24, -0.0524),
        unit='m, rad', minimum=-10.0, maximum=10.0)
    waits: bool = parameter(
        'Whether the demo sends a goal as soon as the one before is reached, by go_to',
        default=False)

    def __post_init__(self) -> None:
        if not self.goals or len(self.goals) % len(Pose._fields):
            raise ParameterError(
                f'goals has {len(self.goals)} elements, expected x, y and theta of each goal')

    def goal(self, elapsed: float) -> Pose:
        """Return the goal of a time [s] since the start."""
        return self.plan[int(elapsed / self.goal_period) % len(self.plan)]

    @property
    def plan(self) -> list[Pose]:
        """Return the goals in their order."""
        return list(map(Pose, *(self.goals[axis::len(Pose._fields)]
                                for axis in range(len(Pose._fields)))))


class Scenario(NamedTuple):
    """Settings of everything that a scenario decides."""

    mission: MissionSettings = MissionSettings()
    sway: SwaySettings = SwaySettings()
    gondola: GondolaSettings = GondolaSettings()
    wind: WindSettings = WindSettings()
    estimator: EstimatorSettings = EstimatorSettings()
    sensors: SensorSettings = SensorSettings()
    facade: FacadeSettings = FacadeSettings()
    force_sensor: ForceSensorSettings = ForceSensorSettings()
    wall: WallSettings = WallSettings()
    compensator: CompensatorSettings = DEFAULTS

    def motion(self) -> Motion:
        """
        Return the disturbance as a function of the time since the start [s].

        Raises a ManipulatorError if a recording moves the gondola and cannot be read.
        """
        return MOTIONS[self.mission.motion](self)


MOTIONS: dict[str, Callable[[Scenario], Motion]] = {
    'sway': lambda scenario: Sway(scenario.sway).at,
    'wind': lambda scenario: Gondola(scenario.gondola, scenario.wind).at,
    'recording': lambda scenario: load_recording(Path(scenario.mission.recording)),
    'spectrum': lambda scenario: load_spectrum(
        Path(scenario.mission.recording), scenario.wind.seed),
}


def scenario_names() -> list[str]:
    """Return the names of the scenarios that come with the package."""
    return sorted(path.stem for path in config_path(FOLDER).glob('*.yaml'))


def scenario_file(name: str) -> Path:
    """
    Return the file of a scenario: a name in config/scenarios, or a path.

    Raises a ParameterError if there is none.
    """
    path = Path(name) if name.endswith('.yaml') else config_path(FOLDER) / f'{name}.yaml'
    if not path.is_file():
        raise ParameterError(
            f"there is no scenario '{name}'; known are {', '.join(scenario_names())}")
    return path


def read_sections(path: Path) -> dict[str, Any]:
    """
    Return the sections of a scenario's file.

    Raises a ParameterError if it cannot be read or has unknown sections.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8')) or {}
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ParameterError(f'scenario {path} cannot be read: {error}') from error
    if not isinstance(content, dict):
        raise ParameterError(f'scenario {path} is not a mapping of sections')
    unknown = sorted(set(content) - set(Scenario._fields))
    if unknown:
        raise ParameterError(f'scenario {path} has unknown sections: {", ".join(unknown)}')
    return {name: section or {} for name, section in content.items()}


def make_scenario(sections: Sections) -> Scenario:
    """
    Return the scenario of its sections; where there is a wall, the compensator knows the gondola.

    Raises a ParameterError if a section has an unknown name or a value out of range.
    """
    scenario = _fill(Scenario(), sections, '')
    if not scenario.facade.present or 'suspension' in sections.get('compensator', {}):
        return scenario
    suspension = SuspensionSettings(**{
        item.name: getattr(scenario.gondola, item.name) for item in fields(SuspensionSettings)})
    return scenario._replace(compensator=scenario.compensator._replace(suspension=suspension))


def load_scenario(name: str) -> Scenario:
    """
    Return a scenario by its name or file; see also `scenario_file` and `read_sections`.

    Raises a ParameterError if its gondola does not feel the head and its name does not say so.
    """
    path = scenario_file(name).resolve()
    scenario = make_scenario(read_sections(path))
    _require_reaction(name, scenario)
    mission = scenario.mission
    if not mission.recording:
        return scenario
    return scenario._replace(
        mission=replace(mission, recording=str(path.parent / mission.recording)))


def _require_reaction(name: str, scenario: Scenario) -> None:
    if not scenario.gondola.reaction and WITHOUT_REACTION not in Path(name).stem:
        raise ParameterError(
            f"scenario '{name}' has gondola.reaction = false: a gondola that does not feel the "
            f"head needs a scenario with '{WITHOUT_REACTION}' in its name")


def compensator_parameters(scenario: Scenario) -> dict[str, Any]:
    """Return where the scenario's compensator leaves the defaults, by the node's parameters."""
    return {
        f'{part}.{item.name}' if part != 'compensation' else item.name: getattr(asked, item.name)
        for part, asked in scenario.compensator._asdict().items() for item in fields(asked)
        if getattr(asked, item.name) != getattr(getattr(DEFAULTS, part), item.name)}


def _fill(defaults: Any, sections: Sections, where: str) -> Any:
    """Replace parts of a tuple of settings by what the sections say."""
    parts = {}
    for name, values in sections.items():
        default = getattr(defaults, name, None)
        if default is None or not isinstance(values, Mapping):
            raise ParameterError(f'{where}{name} is not a section of settings')
        parts[name] = _part(default, values, f'{where}{name}.')
    return defaults._replace(**parts)


def _part(default: Any, values: Sections, where: str) -> Any:
    if isinstance(default, tuple):
        return _fill(default, values, where)
    unknown = sorted(set(values) - {item.name for item in fields(default)})
    if unknown:
        raise ParameterError(f'{where[:-1]} has no setting {", ".join(unknown)}')
    return type(default)(**{
        name: _of_type(getattr(default, name), value, f'{where}{name}')
        for name, value in values.items()})


def _of_type(default: Any, value: Any, where: str) -> Any:
    """Return a value of the default's type; a whole number may stand for a float."""
    if isinstance(default, tuple):
        if not isinstance(value, list):
            raise ParameterError(f'{where} = {value!r} is not a list')
        return tuple(_of_type(0.0, item, where) for item in value)
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not type(default):
        raise ParameterError(
            f'{where} = {value!r} is of type {type(value).__name__}, expected '
            f'{type(default).__name__}')
    return value
