"""Made-up machines: geometries with errors as a shop leaves them, and measurements of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from facade_manipulator.kinematics import Carriages, Geometry, mechanism_of


@dataclass(frozen=True)
class ShopSettings:
    """Standard deviations of a machine's errors and of the measurements of its head [m, rad]."""

    length: float = 5e-4  # of a link and of half a platform
    offset: float = 1e-3  # of a carriage, and of the head on the platform
    angle: float = 3.5e-3  # of the rail, and of the head on the platform
    position_noise: float = 1e-4
    angle_noise: float = 3.5e-4


def make_machine(
    drawing: Geometry, settings: ShopSettings, random: np.random.Generator
) -> Geometry:
    """Return a machine made after a drawing."""
    def errors(deviation: float, count: int) -> tuple[float, ...]:
        return tuple(random.normal(0.0, deviation, count).tolist())

    return replace(
        drawing, link_errors=errors(settings.length, 2),
        platform_errors=errors(settings.length, 2),
        carriage_offsets=errors(settings.offset, 3), rail_angle=errors(settings.angle, 1)[0],
        tool=(*errors(settings.offset, 2), *errors(settings.angle, 1)))


def measure_heads(
    machine: Geometry, carriages: np.ndarray, settings: ShopSettings, random: np.random.Generator
) -> np.ndarray:
    """
    Measure a machine's head at carriage positions [m].

    Returns
    -------
    ndarray, shape (n, 3)
        x, y, θ with noise [m, m, rad].

    """
    mechanism = mechanism_of(machine)
    heads = [mechanism.forward_kinematics(Carriages(*row)) for row in carriages.tolist()]
    noise = [settings.position_noise, settings.position_noise, settings.angle_noise]
    return np.array(heads) + noise * random.standard_normal((len(heads), 3))
