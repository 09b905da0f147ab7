"""
A gondola on two cables in the wind: pendulum in two modes, stretching cables, yaw.

Along the wall and towards it the gondola is a double pendulum: cables of length L, and below
their lower ends a stiff body of mass m whose centre of gravity hangs h lower. For small angles,
with u the displacement of the suspension and φ the tilt of the body,

    m (ü + h φ̈) = −(m g / L + k) u + F,   (I + m h²) φ̈ + m h ü = −m g h φ + F h,

where k is the stiffness of the guide that keeps the gondola at the wall (0 along it). In yaw two
cables a distance 2a apart turn back with m g a² / L, and a guide that acts at both ends, a lever b
from the middle, with k b². In the vertical the cables stretch with EA / L, and what they pull more
or less than the weight makes the pendulums stiffer or softer.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import NamedTuple

import numpy as np

from facade_manipulator.compensation.suspension import SuspensionSettings
from facade_manipulator.kinematics import GRAVITY, Pose
from facade_manipulator.lab.gondola.motion import catmull_rom
from facade_manipulator.lab.gondola.wind import Wind, WindSettings
from facade_manipulator.parameters import inherited, parameter, settings

AIR_DENSITY = 1.2
STEP = 0.01
BLOCK = 100
WARM_UP = 60.0
YAW, VERTICAL = 4, 5


@settings
class GondolaSettings(SuspensionSettings):
    """The gondola and its cables."""

    mass: float = parameter('Mass', default=500.0, unit='kg', minimum=10.0, maximum=1e4)
    body_height: float = parameter(
        'Centre of gravity below the lower end of the cables', default=0.9, unit='m', minimum=0.05,
        maximum=10.0)
    rail_height: float = parameter(
        'Rail below the lower end of the cables', default=0.9, unit='m', minimum=0.0, maximum=10.0)
    gyration_radius: float = parameter(
        'Radius of gyration about horizontal axes', default=0.6, unit='m', minimum=0.05,
        maximum=10.0)
    cable_stiffness: float = parameter(
        'EA of both cables together', default=4e6, unit='N', minimum=1e4, maximum=1e9)
    guide_stiffness: float = inherited(SuspensionSettings, 'guide_stiffness', default=600.0)
    guide_lever: float = inherited(SuspensionSettings, 'guide_lever', default=0.6)
    rail_offset: float = parameter(
        'Distance of the rail from the plane of the cables, towards the wall', default=0.0,
        unit='m', minimum=-2.0, maximum=2.0)
    reaction: bool = parameter(
        'Whether the gondola feels the head; false only in a scenario that is named so',
        default=True)
    damping_ratio: float = parameter(
        'Damping of every mode', default=0.02, minimum=0.0, maximum=0.9)
    area: float = parameter(
        'Area in the wind', default=2.0, unit='m^2', minimum=0.0, maximum=100.0)
    drag_coefficient: float = parameter('Drag coefficient', default=1.2, minimum=0.0, maximum=5.0)
    pressure_offset: float = parameter(
        'Offset of the wind force from the centre, which makes yaw', default=0.15, unit='m',
        minimum=-5.0, maximum=5.0)


class Gondola:
    """
    The disturbance of a gondola in the wind as a function of time.

    The origin is where the gondola hangs in the mean wind. It is computed block by block as far
    as it is asked for, and kept.
    """

    def __init__(self, settings: GondolaSettings, wind: WindSettings) -> None:
        self._settings = settings
        self._wind, self._wind_settings = Wind(wind), wind
        self._modes = modes(settings)
        self.frequencies = self._modes.frequencies
        self._advance = self._modes.discrete(STEP)
        self._positions = np.zeros(len(self.frequencies))
        self._velocity = np.zeros(len(self.frequencies))
        self._vertical_acceleration = 0.0
        self._poses: list[np.ndarray] = []
        self._time = -WARM_UP
        while self._time < 0.0:
            self._poses = self._run_block()
        self._poses = self._poses[-1:]

    def at(self, time: float) -> Pose:
        """Return the pose of the rail in the façade's frame at a time [s] from 0 on."""
        position = max(time, 0.0) / STEP
        index = int(position)
        while len(self._poses) < index + 4:
            self._poses.extend(self._run_block())
        neighbours = self._poses[index:index + 4]
        return Pose(*catmull_rom(neighbours, position - index).tolist())

    def _run_block(self) -> list[np.ndarray]:
        times = self._time + STEP * np.arange(BLOCK)
        self._time += STEP * BLOCK
        forces = wind_forces(self._settings, self._wind_settings, self._wind.gusts(times))
        return [self._step(drive) for drive in forces @ self._modes.participation]

    def _step(self, acceleration: np.ndarray) -> np.ndarray:
        """Step all modes; the cables' pull changes the stiffness of all but the vertical one."""
        pull = self._vertical_acceleration / GRAVITY
        stiffening = self.frequencies ** 2 * self._positions * pull
        stiffening[VERTICAL] = 0.0
        drive = acceleration - stiffening
        positions, velocity = self._advance(self._positions, self._velocity, drive)
        self._vertical_acceleration = (velocity[VERTICAL] - self._velocity[VERTICAL]) / STEP
        self._positions, self._velocity = positions, velocity
        return self._modes.output @ positions


def wind_forces(settings: GondolaSettings, wind: WindSettings, gusts: np.ndarray) -> np.ndarray:
    """
    Return what gusts add to the force of the mean wind: x, y, yaw moment, up [N, N m], (n, 4).

    Gusts are along the mean wind, across it, upwards [m/s], shape (n, 3).
    """
    direction = np.array([math.cos(wind.direction), math.sin(wind.direction)])
    across = np.array([-direction[1], direction[0]])
    velocity = (wind.mean_speed + gusts[:, :1]) * direction + gusts[:, 1:2] * across
    speed = np.hypot(np.hypot(*velocity.T), gusts[:, 2])
    factor = 0.5 * AIR_DENSITY * settings.drag_coefficient * settings.area
    horizontal = factor * (velocity * speed[:, None] - wind.mean_speed ** 2 * direction)
    yaw = settings.pressure_offset * horizontal[:, 1]
    return np.column_stack([horizontal, yaw, factor * speed * gusts[:, 2]])


# positions, velocities and held acceleration of the modes to positions and velocities
Advance = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


class Modes(NamedTuple):
    """
    Six modes: two along the wall, two towards it, yaw, vertical.

    `participation` takes the wind (forces x and y, yaw moment, force upwards) to modal
    accelerations. `output` takes modal positions to the rail's (x, y, yaw); transposed, a wrench
    on the rail to modal accelerations, since what the modes move is what works on them.
    """

    frequencies: np.ndarray  #: angular [rad/s], shape (6,)
    damping: float  #: of each, as a share of the critical
    participation: np.ndarray  #: shape (4, 6)
    output: np.ndarray  #: shape (3, 6)

    def discrete(self, step: float) -> Advance:
        """Return the exact step [s] of (positions, velocities) under a held acceleration."""
        damped = self.frequencies * math.sqrt(1.0 - self.damping ** 2)
        decay = np.exp(-self.damping * self.frequencies * step)
        cosine, sine = decay * np.cos(damped * step), decay * np.sin(damped * step) / damped
        lead, squares = self.damping * self.frequencies * sine, self.frequencies ** 2
        gain = (1.0 - cosine - lead) / squares

        def advance(
            positions: np.ndarray, velocities: np.ndarray, drive: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray]:
            return ((cosine + lead) * positions + sine * velocities + gain * drive,
                    (cosine - lead) * velocities + sine * (drive - squares * positions))

        return advance


def modes(settings: GondolaSettings) -> Modes:
    """Return the modes of a gondola."""
    frequencies = np.zeros(6)
    participation, output = np.zeros((4, 6)), np.zeros((3, 6))
    for axis, stiffness in enumerate(settings.stiffness[:2]):
        pair = slice(2 * axis, 2 * axis + 2)
        frequencies[pair], shapes = _double_pendulum(settings, stiffness)
        participation[axis, pair] = np.array([1.0, settings.body_height]) @ shapes
        output[axis, pair] = np.array([1.0, settings.rail_height]) @ shapes
    inertia = settings.inertia[2]
    frequencies[YAW] = math.sqrt(settings.stiffness[2] / inertia)
    frequencies[VERTICAL] = math.sqrt(
        settings.cable_stiffness / (settings.cable_length * settings.mass))
    shape = 1.0 / math.sqrt(inertia)
    participation[2, YAW] = output[2, YAW] = shape
    output[0, YAW] = -settings.rail_offset * shape
    participation[3, VERTICAL] = 1.0 / settings.mass
    return Modes(frequencies, settings.damping_ratio, participation, output)


def _double_pendulum(
    settings: GondolaSettings, stiffness: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return angular frequencies and mass-normalised shapes (columns) of (u, φ)."""
    m, h = settings.mass, settings.body_height
    mass = np.array([
        [m, m * h], [m * h, m * (settings.gyration_radius ** 2 + h * h)]])
    spring = np.diag([stiffness, m * GRAVITY * h])
    root = np.linalg.cholesky(mass)
    left = np.linalg.solve(root, spring)
    squares, vectors = np.linalg.eigh(np.linalg.solve(root, left.T))
    return np.sqrt(squares), np.linalg.solve(root.T, vectors)

