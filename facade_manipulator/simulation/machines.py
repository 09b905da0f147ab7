"""Made-up machines: geometries with errors as a shop leaves them, and measurements of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from facade_manipulator.calibration import head_at
from facade_manipulator.kinematics import Geometry, mechanism_of
from facade_manipulator.parameters import parameter, settings


@settings
class ShopSettings:
    """Standard deviations of a machine's errors and of the measurements of its head."""

    length: float = parameter(5e-4, 'Of a link and of half a platform', unit='m', minimum=0.0)
    offset: float = parameter(
        1e-3, 'Of a carriage, and of the head on the platform', unit='m', minimum=0.0)
    angle: float = parameter(
        3.5e-3, 'Of the rail, and of the head on the platform', unit='rad', minimum=0.0)
    position_noise: float = parameter(1e-4, 'Of a measured x or y', unit='m', minimum=0.0)
    angle_noise: float = parameter(3.5e-4, 'Of a measured theta', unit='rad', minimum=0.0)


def make_machine(
    drawing: Geometry, shop: ShopSettings, random: np.random.Generator
) -> Geometry:
    """Return a machine made after a drawing."""
    def errors(deviation: float, count: int) -> tuple[float, ...]:
        return tuple(random.normal(0.0, deviation, count).tolist())

    return replace(
        drawing, link_errors=errors(shop.length, 2),
        platform_errors=errors(shop.length, 2),
        carriage_offsets=errors(shop.offset, 3), rail_angle=errors(shop.angle, 1)[0],
        tool=(*errors(shop.offset, 2), *errors(shop.angle, 1)))


def measure_heads(
    machine: Geometry, carriages: np.ndarray, shop: ShopSettings, random: np.random.Generator
) -> np.ndarray:
    """
    Measure a machine's head at carriage positions [m], as `calibration.heads` takes them.

    Returns
    -------
    ndarray, shape (n, 3)
        x, y, θ with noise [m, m, rad].

    Raises
    ------
    LimitError
        If the links do not close at a position.

    """
    mechanism = mechanism_of(machine)
    heads = [head_at(mechanism, *row) for row in carriages.tolist()]
    noise = [shop.position_noise, shop.position_noise, shop.angle_noise]
    return np.array(heads) + noise * random.standard_normal((len(heads), 3))
