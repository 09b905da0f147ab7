"""
Maps over (y, θ): the workspace of the head and its conditioning.

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
from facade_manipulator.kinematics.inverse import branch_number, squared_index
from facade_manipulator.kinematics.jacobian import check_characteristic_length

#: `kinematics.inverse.Links` for arrays of poses
Arrays = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


class PoseMap(NamedTuple):
    """
    Workspace over (y, θ); each field has the broadcast shape.

    ``lower`` and ``upper`` are the ends of the reachable x [m], NaN if reach, order, gap or stroke
    leave none. ``conditioning`` is the local conditioning index and ``number`` the N of the
    parallel singularity [m²]; both are NaN only beyond reach.
    """

    lower: np.ndarray
    upper: np.ndarray
    conditioning: np.ndarray
    number: np.ndarray

    @property
    def width(self) -> np.ndarray:
        """Return the length of the interval of reachable x [m], 0 if it is empty."""
        return np.nan_to_num(self.upper - self.lower)


def link_arrays(geometry: Geometry, y: ArrayLike, theta: ArrayLike) -> Arrays:
    """Return the terms of `kinematics.inverse.links` as arrays, NaN beyond reach [m]."""
    y, theta = np.atleast_1d(y, theta)  # arrays that may be written to
    square = geometry.link_length * geometry.link_length
    sine = np.sin(theta)
    rise = geometry.platform_half_length * sine
    u1, u2 = y - rise, y + rise
    root1, root2 = square - u1 * u1, square - u2 * u2
    outside = np.minimum(root1, root2) <= 0.0
    root1[outside] = np.nan
    root2[outside] = np.nan
    return sine, np.cos(theta), u1, u2, np.sqrt(root1), np.sqrt(root2)


def x_intervals(
    geometry: Geometry, y: ArrayLike, theta: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the ends (lower, upper) of the reachable x [m] by reach, order, gap and stroke.

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
    Return the intervals, conditioning index and N of every (y, θ) in one `PoseMap`.

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
    """Return the ends of the reachable x [m] from the links of every pose, as in `x_intervals`."""
    _, cosine, _, _, projection1, projection2 = at
    span = geometry.platform_half_length * cosine
    least, greatest = geometry.stroke
    lower = least + span - projection1
    upper = greatest - span + projection2
    distance = span - np.maximum(projection1, projection2)
    with np.errstate(invalid='ignore'):
        outside = (
            (distance < geometry.carriage_gap) | (distance <= 0.0) | (lower > upper)
        )
    lower[outside] = np.nan
    upper[outside] = np.nan
    return lower, upper


def index_of(
    geometry: Geometry, at: Arrays, characteristic_length: float
) -> np.ndarray:
    """Return the local conditioning index of every pose for a characteristic length [m]."""
    ratio = geometry.platform_half_length / characteristic_length
    return np.sqrt(squared_index(at, ratio, ratio))
