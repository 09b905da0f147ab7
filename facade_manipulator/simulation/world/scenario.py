"""
Scenarios: YAML files that describe gondola, wind, sensors and mission.

Each section of a file is one of the dataclasses below. A missing value keeps the default of the
dataclass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
import math
from pathlib import Path
from typing import Any

import numpy as np

from facade_manipulator.errors import file_reason, ParameterError
from facade_manipulator.kinematics import Pose
from facade_manipulator.package_files import config_path
from facade_manipulator.parameters import from_mapping, read_value


@dataclass(frozen=True)
class Gondola:
    """Gondola on its cables; config/gondola.xml contains all other values."""

    cable_length: float = 30.0  #: [m]
    #: of either end from the middle; 0 lets the gondola yaw freely [m]
    guide_lever: float = 0.6
    drag_area: float = 2.4  #: drag coefficient times area [m²]
    #: of the wind's force from the middle, along the wall [m]
    pressure_offset: float = 0.15


@dataclass(frozen=True)
class Wind:
    """Mean wind and turbulence at the gondola."""

    mean_speed: float = 0.0  #: [m/s]; 0 is calm
    #: standard deviation along the mean wind, as a share of its speed
    turbulence: float = 0.18
    direction: float = 0.5  #: 0 blows along x, π/2 onto the wall [rad]


def _require_triples(name: str, rows: Sequence[Any], meaning: str) -> None:
    """
    Raise a ParameterError if a row is not a sequence of three numbers.

    The reader of the file checks neither the length nor the elements of a row. `name` is the name
    of the setting, and `meaning` the meaning of the three numbers.
    """
    for row in rows:
        is_triple = isinstance(row, Sequence) and len(row) == 3
        if not is_triple or not all(isinstance(one, (int, float)) for one in row):
            raise ParameterError(
                f'{name} = {row!r}, expected three numbers: {meaning}; '
                'next: write each row as [a, b, c]'
            )


@dataclass(frozen=True)
class Motion:
    """
    Prescribed motion of the rail; without sines, the gondola hangs freely.

    Each sine is amplitude, frequency and phase [m or rad, Hz, rad].
    """

    x: tuple[tuple[float, float, float], ...] = ()
    y: tuple[tuple[float, float, float], ...] = ()
    theta: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self) -> None:
        for name in ('x', 'y', 'theta'):
            _require_triples(name, getattr(self, name), 'amplitude, frequency, phase')

    def poses(self, times: np.ndarray) -> np.ndarray:
        """
        Return the prescribed rail poses in frame facade, shape (n, 3).

        The times are since the start [s]. Without sines the poses are 0 and prescribe nothing.
        """
        axes = []
        for sines in (self.x, self.y, self.theta):
            values = np.zeros(np.shape(times))
            for amplitude, frequency, phase in sines:
                values += amplitude * np.sin(math.tau * frequency * times + phase)
            axes.append(values)
        return np.stack(axes, axis=-1)


@dataclass(frozen=True)
class Estimator:
    """Noise, delay and faults of the simulated disturbance estimates."""

    rate: float = 50.0  #: [Hz]
    latency: float = 0.05  #: mean age of an estimate on arrival [s]
    jitter: float = 0.01  #: maximum deviation of the age from its mean [s]
    position_noise: float = 1e-3  #: standard deviation [m]
    yaw_noise: float = math.radians(0.1)  #: standard deviation [rad]
    loss: float = 0.0  #: share of estimates that never arrive
    silent_from: float = 0.0  #: since the start [s]
    silent_for: float = 0.0  #: [s]
    wrong_every: float = math.inf  #: time from one wrong moment to the next [s]
    #: durations, one after the other [s]
    wrong_for: tuple[float, ...] = (0.06, 0.1, 0.2)
    wrong_scale: tuple[float, ...] = (1.0, 1.0, 1.0)  #: factors of x, y, θ while wrong
    #: added to x, y, θ while wrong [m, m, rad]
    wrong_offset: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Wall:
    """Wall, and brush between head and wall; config/gondola.xml contains all other values."""

    #: whether the mission presses on the wall and has a force sensor
    is_touched: bool = False
    distance: float = 0.45  #: of the wall from the rail in still air [m]
    brush_stiffness: float = 600.0  #: [N/m]


@dataclass(frozen=True)
class Mission:
    """Goals of the head on the wall, and requirements for a demo."""

    duration: float = 60.0  #: [s]
    #: of x, y, θ that a demo must reach [dB]; -inf: of an axis that yields to the contact force
    attenuation: tuple[float, ...] = (20.0, 12.0, 12.0)
    #: duration from which a demo must reach the attenuation [s]
    shown_after: float = 10.0
    goal_period: float = 6.0  #: time from one goal to the next [s]
    #: x, y, θ [m, m, rad]
    goals: tuple[tuple[float, float, float], ...] = (
        (0.0, 0.25, 0.0),
        (0.06, 0.25, 0.0),
        (-0.06, 0.255, 0.0),
    )

    def __post_init__(self) -> None:
        if not self.goals:
            raise ParameterError('goals is empty; next: write at least one goal')
        _require_triples('goals', self.goals, 'x, y, theta')

    def goal(self, elapsed: float) -> Pose:
        """Return the goal [m, m, rad] at a time since the mission started [s]."""
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
    #: parameters by their full names
    compensator: dict[str, Any] = field(default_factory=dict)


def simulation_parameters(
    scenario: str = '', *, viewer: bool = False
) -> dict[str, Any]:
    """
    Return the content of a parameter file that selects the scenario and MuJoCo's viewer.

    Load it after the other files. The option ``-p`` of ROS would not override manipulator.yaml.
    Without a name the scenario of the other files remains. Raises the errors of `load_scenario`.
    """
    simulator: dict[str, Any] = {}
    compensator: dict[str, Any] = {}
    if viewer:
        simulator['viewer'] = True
    if scenario:
        simulator['scenario'] = scenario
        compensator = load_scenario(scenario).compensator
    return {
        '/**/compensator': {'ros__parameters': compensator},
        '/**/gondola_simulator': {'ros__parameters': simulator},
    }


def scenario_names() -> list[str]:
    """Return the names of all scenarios in the package."""
    return sorted(path.stem for path in config_path('scenarios').glob('*.yaml'))


def load_scenario(name: str) -> Scenario:
    """
    Load a scenario by name from config/scenarios, or from the path of a YAML file.

    Raises
    ------
    ParameterError
        If the file cannot be read, or contains an unknown section or value, or a value of a wrong
        type.

    """
    names = scenario_names()
    path = Path(name)
    if not name.endswith('.yaml'):
        if name not in names:
            raise ParameterError(
                f'scenario {name} rejected: there is no scenario of this name; next: use one of '
                f'{", ".join(names)}, or the path of a YAML file'
            )
        path = config_path(f'scenarios/{name}.yaml')
    try:
        content = read_value(path.read_text(encoding='utf-8')) or {}
        return from_mapping(Scenario, content)
    except ParameterError as error:
        raise ParameterError(f'scenario {name} rejected: {error}') from error
    except (OSError, UnicodeDecodeError) as error:
        reason = file_reason(error) if isinstance(error, OSError) else str(error)
        raise ParameterError(
            f'scenario {name} rejected: {reason}; next: correct the file, or use one of '
            f'{", ".join(names)}'
        ) from error
