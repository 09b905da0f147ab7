"""
How far the head can go: exact limits of y and θ, without a grid; `kinematics.x_intervals` has x.

At fixed y the reachable θ are one interval about zero. Order and gap of the carriages, reach and
the singularity N = 0 bound it. The bounds belong to a limit themselves: stay inside by a margin.
"""

from __future__ import annotations

from math import isfinite, sqrt
from typing import Any

import numpy as np

from facade_manipulator.errors import CarriageGapError, UnreachableError
from facade_manipulator.kinematics import branch_number, Geometry, not_finite, Pose
from facade_manipulator.lab.study.section import Lengths
from facade_manipulator.lab.study.volume import bisect, theta_bounds


def y_range(geometry: Geometry) -> tuple[float, float]:
    """Least and greatest y that is reachable at θ = 0, the stroke apart [m]."""
    length, room = geometry.link_length, geometry.platform_half_length - geometry.carriage_gap
    return sqrt(max(0.0, length * length - room * room)), length


def theta_max(geometry: Geometry, y: float) -> float:
    """
    Greatest ``|θ|`` at the distance y from the rail, the stroke apart [rad].

    Raises a ParameterError for what is not finite, and a CarriageGapError or an UnreachableError
    if y is not reachable at θ = 0.
    """
    if not isfinite(y):
        raise not_finite(Pose(0.0, y, 0.0))
    lower, upper = y_range(geometry)
    if y < lower:
        raise CarriageGapError('y', y, lower, 'm', 'below')
    if y >= upper:
        raise UnreachableError('y', y, upper, 'm', 'not below')
    return float(theta_limits(geometry, np.array([y]))[0])


def theta_limits(of: Lengths, y: np.ndarray) -> np.ndarray:
    """Return `theta_max` of one design or of many; 0 where θ = 0 is not reachable."""
    bound = np.nan_to_num(theta_bounds(of, y))
    regular = number_at(of, y, bound) > 0.0
    if regular.all():
        return bound
    inside = np.minimum(
        bound, np.arcsin(np.minimum(1.0, y / of.platform_half_length)))  # N > 0 up to here
    root = bisect(lambda theta: number_at(of, y, theta), bound, inside)
    return np.where(regular, bound, root)


def number_at(of: Lengths, y: Any, theta: Any) -> Any:
    """Return N [m²] for θ ≥ 0, the far edge included; on floats as on arrays."""
    length, rise = of.link_length, of.platform_half_length * np.sin(theta)
    roots = [np.sqrt(np.maximum(0.0, length * length - height * height))
             for height in (y - rise, y + rise)]
    return branch_number((np.sin(theta), np.cos(theta), y - rise, y + rise, *roots))
