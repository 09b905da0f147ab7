"""
Maps over (y, θ): workspace of the head and conditioning.

At fixed (y, θ) the reachable x form exactly one interval, and the conditioning index does not
depend on x. A map over (y, θ) with the ends of the intervals therefore describes the whole
three-dimensional workspace. Every function takes arrays that broadcast against each other, such as
a column of y and a row of θ.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from facade_manipulator.kinematics.geometry import Geometry
from facade_manipulator.kinematics.links import (
    branch_number,
    links,
    squared_index,
    x_interval,
)
from facade_manipulator.kinematics.nominal import check_characteristic_length

#: `kinematics.links.Links` for arrays of poses
Arrays = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


class PoseMap(NamedTuple):
    """
    Map of the workspace over (y, θ); each field has the broadcast shape.

    ``lower`` and ``upper`` are the ends of the reachable x [m], NaN if reach, order, gap or stroke
    leave no reachable x. ``conditioning`` is the local conditioning index and ``number`` the N of
    the parallel singularity [m²]; both are NaN only beyond reach.
    """

    lower: np.ndarray
    upper: np.ndarray
    conditioning: np.ndarray
    number: np.ndarray

    @property
    def width(self) -> np.ndarray:
        """Return the length of the reachable x-interval [m]; 0 if it is empty."""
        return np.nan_to_num(self.upper - self.lower)


def link_arrays(geometry: Geometry, y: ArrayLike, theta: ArrayLike) -> Arrays:
    """Return the terms of `kinematics.links` as arrays [m]; NaN if out of reach."""
    y, theta = np.atleast_1d(y, theta)  # arrays that may be written to
    return links(geometry.drawn.sides, y, theta, np.sin, np.cos, _root_or_nan)


def _root_or_nan(square: np.ndarray) -> np.ndarray:
    return np.sqrt(np.where(square > 0.0, square, np.nan))


def x_intervals(
    geometry: Geometry, y: ArrayLike, theta: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the ends (lower, upper) of reachable x [m] from reach, order, gap and stroke.

    The ends are NaN if the interval is empty. Poses beyond N = 0 are included; `pose_map` returns
    N.
    """
    return intervals_of(geometry, link_arrays(geometry, y, theta))


def pose_map(
    geometry: Geometry,
    y: ArrayLike,
    theta: ArrayLike,
    characteristic_length: float = 1.0,
) -> PoseMap:
    """
    Return the `PoseMap` with intervals, conditioning index and N for every (y, θ).

    Parameters
    ----------
    geometry : Geometry
    y, theta : array_like
        Distances from the rail [m] and angles [rad] that broadcast against each other.
    characteristic_length : float
        Unit of length of the conditioning index [m]; 0.001 gives the paper's.

    Raises
    ------
    ParameterError
        If the characteristic length is not positive.

    """
    check_characteristic_length(characteristic_length)
    at = link_arrays(geometry, y, theta)
    return PoseMap(
        *intervals_of(geometry, at),
        index_of(geometry, at, characteristic_length),
        branch_number(at),
    )


def intervals_of(geometry: Geometry, at: Arrays) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of the reachable x-interval [m], as `x_intervals`, from given link terms."""
    _, cosine, _, _, s1, s2 = at
    lower, upper = x_interval(geometry.drawn.sides, geometry.stroke, cosine, s1, s2)
    distance = geometry.platform_half_length * cosine - np.maximum(s1, s2)
    is_reached = (distance >= geometry.carriage_gap) & (distance > 0.0)
    is_empty = ~(is_reached & (lower <= upper))  # also where a number is NaN
    lower[is_empty] = np.nan
    upper[is_empty] = np.nan
    return lower, upper


def number_at(geometry: Geometry, y: ArrayLike, theta: ArrayLike) -> np.ndarray:
    """Return N [m²] for every y and θ ≥ 0, including the far edge."""
    sides = geometry.drawn.sides
    y = np.asarray(y)
    theta = np.asarray(theta)
    return branch_number(links(sides, y, theta, np.sin, np.cos, _root_or_zero))


def _root_or_zero(square: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(0.0, square))


def index_of(
    geometry: Geometry, at: Arrays, characteristic_length: float
) -> np.ndarray:
    """Return the local conditioning index of every pose, for a characteristic length [m]."""
    ratio = geometry.platform_half_length / characteristic_length
    return np.sqrt(squared_index(at, ratio, ratio))
