"""
Ball screws: critical speed, buckling, mean load and life.

References
----------
ISO 3408-5:2006, static and dynamic axial load ratings and operational life. HIWIN, "Ballscrews &
Accessories", BS-08-2-EN-1704-K, section 3.7: formulas, the shares of critical speed and buckling
load that are permitted, and what the load is multiplied by in operation.

"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.parameters import parameter, settings

YOUNG = 2.06e11  # Pa, of steel
DENSITY = 7850.0  # kg/m³
SPEED_SHARE, BUCKLING_SHARE = 0.8, 0.5  # permitted of critical speed and buckling load


class Mounting(NamedTuple):
    """How the ends of a screw are held."""

    wave_number: float  #: λ of the first bending mode, times the length
    buckling: float  #: Euler's load by that with both ends supported


MOUNTINGS = {
    'fixed-fixed': Mounting(4.730, 4.0), 'fixed-supported': Mounting(3.927, 2.0),
    'supported-supported': Mounting(math.pi, 1.0), 'fixed-free': Mounting(1.875, 0.25)}


@settings
class BallScrew:
    """A ball screw with its nut."""

    name: str = parameter('Name', default='')
    diameter: float = parameter(
        'Diameter', default=0.016, unit='m', minimum=1e-3, maximum=0.5)
    core: float = parameter(
        'Diameter of the core', default=0.013, unit='m', minimum=1e-3, maximum=0.5)
    lead: float = parameter(
        'Way of the nut in a revolution', default=0.016, unit='m', minimum=1e-4, maximum=0.5)
    rating: float = parameter(
        'Dynamic load rating', default=7900.0, unit='N', minimum=1.0, maximum=1e7)
    speed_factor: float = parameter(
        'Diameter times greatest speed of rotation', default=7.0 / 6.0, unit='m/s', minimum=1e-3,
        maximum=100.0)
    source: str = parameter('Where this stands', default='')

    def __post_init__(self) -> None:
        if self.core > self.diameter:
            raise ParameterError(
                f'core = {self.core:g} m is above diameter = {self.diameter:g} m')

    def inertia(self, length: float) -> float:
        """Moment of inertia of a shaft of a length [m], in kg m²."""
        return math.pi / 32.0 * DENSITY * length * self.diameter ** 4


def critical_speed(core: float, length: float, mounting: str) -> float:
    """Return the speed of the first bending mode of a shaft [rev/s]."""
    wave = MOUNTINGS[mounting].wave_number / length
    return wave * wave / math.tau * 0.25 * core * math.sqrt(YOUNG / DENSITY)


def buckling_load(core: float, length: float, mounting: str) -> float:
    """Return Euler's load of a shaft [N]."""
    moment = math.pi / 64.0 * core ** 4
    return MOUNTINGS[mounting].buckling * math.pi ** 2 * YOUNG * moment / length ** 2


def mean_loads(force: np.ndarray, speed: np.ndarray) -> tuple[float, float]:
    """
    Return the equivalent loads of both flanks of the thread [N], of all revolutions.

    The cube root of the mean cube, each sample weighted by how far the nut moves in it.
    """
    way = np.abs(speed)
    total = max(float(way.sum()), np.finfo(float).tiny)
    push, pull = (float(np.sum(np.clip(sign * force, 0.0, None) ** 3 * way) / total) ** (1.0 / 3.0)
                  for sign in (1.0, -1.0))
    return push, pull


def life(rating: float, loads: tuple[float, float]) -> float:
    """Return L10 of a screw with loads on both flanks [revolutions]; infinite without any."""
    failures = sum((load / rating) ** (10.0 / 3.0) for load in loads)
    return 1e6 * failures ** -0.9 if failures > 0.0 else math.inf
