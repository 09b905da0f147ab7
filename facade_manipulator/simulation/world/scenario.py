"""
Scenarios: a YAML file describes the gondola, the wind, the sensors and the mission.

Each section of a file is one of the dataclasses below. A missing value has the default of the
dataclass.
"""

from __future__ import annotations

from dataclasses import dataclass, field
import math
from pathlib import Path
from typing import Any

import yaml

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Pose
from facade_manipulator.resources import config_path


@dataclass(frozen=True)
class Gondola:
    """The gondola and its cables [m, kg, N/m]."""

    mass: float = 500.0  #: with the manipulator
    gyration_radii: tuple[float, ...] = (0.6, 0.6, 0.7)  #: about x, y, z
    cable_length: float = 30.0
    cable_distance: float = 1.2
    rail_below_cables: float = 0.9
    guide_stiffness: float = 600.0  #: towards the wall, both ends together
    guide_lever: float = 0.6  #: of either end from the middle; 0 lets the gondola yaw freely
    drag_area: float = 2.4  #: drag coefficient times area [m²]
    pressure_offset: float = 0.15  #: of the wind's force from the middle, along the wall


@dataclass(frozen=True)
class Wind:
    """Mean wind and turbulence at the gondola."""

    mean_speed: float = 0.0  #: [m/s]; 0 is calm
    turbulence: float = 0.18  #: standard deviation along the mean wind, as a share of its speed
    direction: float = 0.5  #: 0 blows along x, π/2 onto the wall [rad]
    height: float = 40.0  #: above ground [m]


@dataclass(frozen=True)
class Motion:
    """
    Prescribed motion of the rail; without sines the gondola hangs freely.

    Each sine is amplitude, frequency and phase [m or rad, Hz, rad].
    """

    x: tuple[tuple[float, float, float], ...] = ()
    y: tuple[tuple[float, float, float], ...] = ()
    theta: tuple[tuple[float, float, float], ...] = ()


@dataclass(frozen=True)
class Estimator:
    """Noise, delay and faults of the estimates of the disturbance."""

    rate: float = 50.0  #: [Hz]
    latency: float = 0.05  #: mean age of an estimate on arrival [s]
    jitter: float = 0.01  #: maximum deviation of the age from its mean [s]
    position_noise: float = 1e-3  #: standard deviation [m]
    yaw_noise: float = math.radians(0.1)  #: standard deviation [rad]
    loss: float = 0.0  #: share of estimates that never arrive
    silent_from: float = 0.0  #: since the start [s]
    silent_for: float = 0.0  #: [s]
    wrong_every: float = math.inf  #: time from one wrong moment to the next [s]
    wrong_for: tuple[float, ...] = (0.06, 0.1, 0.2)  #: durations, one after the other [s]
    wrong_scale: tuple[float, ...] = (1.0, 1.0, 1.0)  #: factors of x, y, θ while wrong
    wrong_offset: tuple[float, ...] = (0.0, 0.0, 0.0)  #: added to x, y, θ while wrong [m, m, rad]


@dataclass(frozen=True)
class Wall:
    """The wall and the brush between head and wall."""

    is_touched: bool = False  #: whether the mission presses on it and has a force sensor
    distance: float = 0.45  #: of the wall from the rail in still air [m]
    brush_stiffness: float = 600.0  #: [N/m]
    brush_damping: float = 25.0  #: [N s/m]
    brush_width: float = 0.3  #: between the two rows of bristles [m]
    friction: float = 0.3  #: coefficient


@dataclass(frozen=True)
class Mission:
    """Goals of the head on the wall, and the requirements of a demo."""

    duration: float = 60.0  #: [s]
    #: of x, y, θ that a demo must reach [dB]; -inf: of an axis that yields to the contact force
    attenuation: tuple[float, ...] = (20.0, 12.0, 12.0)
    shown_after: float = 10.0  #: duration from which a demo must reach the attenuation [s]
    goal_period: float = 6.0  #: time from one goal to the next [s]
    goals: tuple[tuple[float, float, float], ...] = (
        (0.0, 0.25, 0.0), (0.06, 0.25, 0.0), (-0.06, 0.255, 0.0))  #: x, y, θ [m, m, rad]

    def goal(self, elapsed: float) -> Pose:
        """Return the goal [m, m, rad] at a time since the start of the mission [s]."""
        return Pose(*self.goals[int(elapsed / self.goal_period) % len(self.goals)])


@dataclass(frozen=True)
class Scenario:
    """All settings of a scenario."""

    description: str = ''
    seed: int = 1  #: of wind, noise, jitter and losses
    raw_sensors: bool = False  #: whether raw sensors replace the estimates
    gondola: Gondola = Gondola()
    wind: Wind = Wind()
    motion: Motion = Motion()
    estimator: Estimator = Estimator()
    wall: Wall = Wall()
    mission: Mission = Mission()
    compensator: dict[str, Any] = field(default_factory=dict)  #: parameters by their full names


SECTIONS: dict[str, Any] = {kind.__name__.lower(): kind for kind in (
    Gondola, Wind, Motion, Estimator, Wall, Mission)}


def scenario_names() -> list[str]:
    """Return the names of the scenarios of the package."""
    return sorted(path.stem for path in config_path('scenarios').glob('*.yaml'))


def load_scenario(name: str) -> Scenario:
    """
    Return a scenario by its name in config/scenarios, or by the path of a YAML file.

    Raises
    ------
    ParameterError
        If the file cannot be read, or has an unknown section or value, or a value of a wrong type.

    """
    try:
        path = Path(name) if name.endswith('.yaml') else config_path(f'scenarios/{name}.yaml')
        content = yaml.safe_load(path.read_text(encoding='utf-8')) or {}
        return _made(Scenario, {
            key: _made(SECTIONS[key], value) if key in SECTIONS else value
            for key, value in content.items()})
    except (OSError, UnicodeDecodeError, yaml.YAMLError, TypeError, AttributeError) as error:
        raise ParameterError(
            f'scenario {name} rejected: {error}; next: correct the file, or use one of '
            f'{", ".join(scenario_names())}') from error


def _made(kind: Any, values: dict[str, Any]) -> Any:
    """Return a section with some values; raise a TypeError for an unknown name or a wrong type."""
    made = kind(**values)
    for name, default in vars(kind()).items():
        _require_type(name, vars(made)[name], default)
    return made


def _require_type(name: str, value: Any, default: Any) -> None:
    """Raise a TypeError for a value of another type than the default; an int is also a float."""
    allowed = {float: (float, int), tuple: (tuple, list)}.get(type(default), (type(default),))
    if type(value) not in allowed:
        raise TypeError(f'{name} = {value!r}, expected a value such as {default!r}')
    if isinstance(default, tuple) and default:
        for element in value:
            _require_type(name, element, default[0])
