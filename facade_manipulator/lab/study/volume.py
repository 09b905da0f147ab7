"""
Integrals over the workspace: volume over (x, y, θ), its good and its singular share, xy union.

At fixed θ the reachable y are at most two pieces with ends in closed form, and so is the integral
of the x-interval's width over any part of them. Cells of y carry that exact area; an index that
passes its bound inside a cell divides it in proportion. Only the integral over θ is a quadrature.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from facade_manipulator import kinematics
from facade_manipulator.kinematics import Geometry
from facade_manipulator.lab.study.section import Lengths, segment

_BISECTIONS = 60
THETA_NODES = 128
Y_CELLS = 128


class Workspace(NamedTuple):
    """Volumes over (x, y, θ), both signs of θ [m² rad]: all, good, and beyond N = 0."""

    volume: float
    good: float
    beyond: float

    @property
    def ratio(self) -> float:
        """Share of the good volume; NaN if the workspace is empty."""
        return self.good / self.volume if self.volume > 0.0 else float('nan')

    @property
    def beyond_share(self) -> float:
        """Share of the volume beyond N = 0; NaN if the workspace is empty."""
        return self.beyond / self.volume if self.volume > 0.0 else float('nan')


def measure(
    geometry: Geometry, threshold: float, characteristic_length: float = 1.0,
    theta_nodes: int = THETA_NODES, y_cells: int = Y_CELLS,
) -> Workspace:
    """
    Measure the workspace by reach, order, gap and stroke.

    A pose is good from an index of `threshold` on, of which the characteristic length [m] is the
    unit of length. The error falls with the square of the nodes of θ and of the cells of y.
    """
    kinematics.check_characteristic_length(characteristic_length)
    theta, weight = theta_quadrature(geometry, theta_nodes)
    sums = np.zeros(3)
    for lower, upper in y_pieces(geometry, theta):
        if not (upper > lower).any():
            continue  # the second piece, unless links are shorter than b
        y = _edges(lower, upper, y_cells)
        at = kinematics.link_arrays(
            geometry, np.minimum(y, y[:, -1:] * (1.0 - 1e-12)), theta[:, None])
        cells = np.diff(_width_integral(geometry, y, theta[:, None]), axis=1)
        number = kinematics.branch_number(at)
        # With N's sign the index is smooth where it vanishes, so cells there divide rightly.
        index = np.copysign(kinematics.index_of(geometry, at, characteristic_length), number)
        good = _share_above(index - threshold) + _share_above(-threshold - index)
        beyond = _share_above(-number)
        areas = [cells.sum(axis=1), (cells * good).sum(axis=1), (cells * beyond).sum(axis=1)]
        sums += 2.0 * (np.array(areas) @ weight)
    return Workspace(*sums.tolist())


def union_area(geometry: Geometry) -> float:
    """
    Area of the (x, y) that the head reaches at one θ or another [m²].

    At fixed y the intervals of neighbouring θ overlap, so that those of either sign of θ make up
    one interval; only its ends are sought among some angles.
    """
    y, weight = _quadrature(0.0, geometry.link_length, 400)
    theta = theta_bounds(geometry, y)[:, None] * np.linspace(0.0, 1.0, 257)
    lower, upper = union_ends(geometry, y[:, None], theta)
    mirrored_lower, mirrored_upper = union_ends(geometry, y[:, None], -theta)
    overlap = np.minimum(upper, mirrored_upper) - np.maximum(lower, mirrored_lower)
    length = (upper - lower) + (mirrored_upper - mirrored_lower) - np.maximum(0.0, overlap)
    return float(np.nan_to_num(length) @ weight)


def theta_bounds(of: Lengths, y: np.ndarray) -> np.ndarray:
    """
    Greatest |θ| by order, gap and reach at every y > 0 [rad]; NaN where θ = 0 is not reachable.

    `reach.theta_limits` heeds N = 0 as well, which matters for links shorter than b.
    """
    length, half, gap = of.link_length, of.platform_half_length, of.carriage_gap
    radius, phase = np.hypot(y, gap), np.arctan2(gap, y)
    height = (y * y + half * half + gap * gap - length * length) / (2.0 * half)
    with np.errstate(invalid='ignore'):
        order = np.where(height < radius, np.arcsin(height / radius) - phase, np.pi)
        reach = np.arcsin(np.minimum(1.0, (length - y) / half))
    bound = np.minimum(np.minimum(order, reach), np.arccos(gap / half))
    return np.where(bound >= 0.0, bound, np.nan)


def y_pieces(
    geometry: Geometry, theta: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """
    Return the ends (lower, upper) of both pieces of y that are reachable at every θ ≥ 0 [m].

    The first is the piece towards the façade. The second exists for links shorter than b alone;
    an empty piece has equal ends.
    """
    length, half = geometry.link_length, geometry.platform_half_length
    rise = half * np.sin(theta)
    room = half * np.cos(theta) - geometry.carriage_gap
    end = np.minimum(length - rise, _stroke_cap(geometry, theta))
    end = np.where(room >= 0.0, np.maximum(0.0, end), 0.0)
    crossing = np.sqrt(np.maximum(0.0, length * length - room * room))
    bound = room < length
    lower = np.where(bound, rise + crossing, 0.0)
    second = np.where(bound, np.clip(rise - crossing, 0.0, end), 0.0)
    return (lower, np.maximum(lower, end)), (np.zeros_like(second), second)


def theta_quadrature(geometry: Geometry, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return angles θ > 0 and weights [rad] for integrals over all θ with reachable y."""
    end = theta_end(geometry)
    ratio = (geometry.link_length + geometry.carriage_gap) / geometry.platform_half_length
    breaks = [0.0, end]
    if ratio < 1.0 and np.arccos(ratio) < end:
        breaks.insert(1, float(np.arccos(ratio)))  # the order of the carriages begins to matter
    parts = [_quadrature(lower, upper, nodes // (len(breaks) - 1))
             for lower, upper in zip(breaks[:-1], breaks[1:], strict=True)]
    return tuple(np.concatenate(parts, axis=1))


def theta_end(geometry: Geometry) -> float:
    """Return the least angle beyond which no y is reachable; for l < b one not below it."""
    length, half = geometry.link_length, geometry.platform_half_length
    upper = min(np.arcsin(min(1.0, length / half)), np.arccos(geometry.carriage_gap / half))
    if length < half:
        return float(upper)

    def is_empty(theta: float) -> np.ndarray:
        (first, last), _ = y_pieces(geometry, np.array([theta]))
        return last[0] <= first[0]

    return float(bisect(is_empty, 0.0, upper))


def bisect(function: Callable[[Any], Any], negative: Any, positive: Any) -> Any:
    """Return the roots between two arguments, on their positive side; on floats as on arrays."""
    for _ in range(_BISECTIONS):
        middle = 0.5 * (negative + positive)
        above = function(middle) > 0.0
        positive = np.where(above, middle, positive)
        negative = np.where(above, negative, middle)
    return positive


def _stroke_cap(geometry: Geometry, theta: np.ndarray) -> np.ndarray:
    """
    Return the y above which the stroke leaves no x [m].

    There s1 + s2 = h with h = 2 b c − Q; s1² − s2² = 4 y b s makes y a closed form.
    """
    length, half = geometry.link_length, geometry.platform_half_length
    rise = half * np.sin(theta)
    h = 2.0 * half * np.cos(theta) - geometry.stroke_length
    with np.errstate(invalid='ignore', divide='ignore'):
        square = length * length - rise * rise - 0.25 * h * h
        y = np.sqrt(np.maximum(0.0, square) / (1.0 + (2.0 * rise / h) ** 2))
        bound = (h > 0.0) & (4.0 * rise * y <= h * h)  # else one link is upright before
    return np.where(bound, y, length)


def _edges(lower: np.ndarray, upper: np.ndarray, cells: int) -> np.ndarray:
    """Edges of cells of y, one row for every θ, closer at the ends: there the index bends most."""
    share = np.sin(np.linspace(0.0, 0.5 * np.pi, cells + 1)) ** 2
    return lower[:, None] + (upper - lower)[:, None] * share


def _width_integral(geometry: Geometry, y: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """∫ (Q − 2 b c + s1 + s2) dy at fixed θ [m²]."""
    length, half = geometry.link_length, geometry.platform_half_length
    rise = half * np.sin(theta)
    total = (geometry.stroke_length - 2.0 * half * np.cos(theta)) * y
    return total + 0.5 * segment(length, y - rise) + 0.5 * segment(length, y + rise)


def _share_above(values: np.ndarray) -> np.ndarray:
    """Share of every cell in which a value given at its edges is positive, by interpolation."""
    high = np.maximum(values[:, :-1], values[:, 1:])
    low = np.minimum(values[:, :-1], values[:, 1:])
    with np.errstate(invalid='ignore', divide='ignore'):
        share = np.where(high > low, high / (high - low), high > 0.0)
    return np.clip(share, 0.0, 1.0)


def _quadrature(lower: float, upper: float, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights, bent so that roots at the ends do no harm."""
    position, weight = _legendre(nodes)
    angle = 0.25 * np.pi * (position + 1.0)
    size = upper - lower
    return (lower + size * np.sin(angle) ** 2,
            0.25 * np.pi * size * np.sin(2.0 * angle) * weight)


@lru_cache
def _legendre(nodes: int) -> tuple[np.ndarray, np.ndarray]:
    return np.polynomial.legendre.leggauss(nodes)  # takes longer than the integral it serves


def union_ends(
    geometry: Geometry, y: np.ndarray, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of the union of x-intervals over every row's angles; NaN where empty."""
    lower, upper = kinematics.x_intervals(geometry, y, theta)
    return np.fmin.reduce(lower, axis=1), np.fmax.reduce(upper, axis=1)
