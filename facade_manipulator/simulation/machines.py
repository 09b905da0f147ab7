"""Made-up machines: geometries with errors as a shop leaves them, and measurements of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Carriages, Geometry, mechanism_of
from facade_manipulator.parameters import parameter, settings


@settings
class ShopSettings:
    """Standard deviations of a machine's errors and of the measurements of its head."""

    length: float = parameter(
        5e-4, 'Error of a link and of half a platform', unit='m', minimum=0.0, maximum=0.01)
    offset: float = parameter(
        1e-3, 'Offset of a carriage, and of the head on the platform', unit='m', minimum=0.0,
        maximum=0.01)
    angle: float = parameter(
        3.5e-3, 'Angle of the rail, and of the head on the platform', unit='rad', minimum=0.0,
        maximum=0.05)
    position_noise: float = parameter(
        1e-4, 'Noise of a measured x or y', unit='m', minimum=0.0, maximum=0.1)
    angle_noise: float = parameter(
        3.5e-4, 'Noise of a measured angle', unit='rad', minimum=0.0, maximum=0.1)


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

    Raises
    ------
    ParameterError
        If the positions do not have three columns.
    LimitError
        If the links cannot be joined.

    """
    carriages = np.asarray(carriages, float)
    if carriages.ndim != 2 or carriages.shape[1] != 3:
        raise ParameterError(f'carriages has the shape {carriages.shape}, not (n, 3)')
    mechanism = mechanism_of(machine)
    heads = [mechanism.forward_kinematics(Carriages(*row)) for row in carriages.tolist()]
    noise = [settings.position_noise, settings.position_noise, settings.angle_noise]
    return np.array(heads) + noise * random.standard_normal((len(heads), 3))
