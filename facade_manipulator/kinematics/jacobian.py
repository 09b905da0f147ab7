"""
Jacobian at a pose (section II-B of the paper): rates, forces, singularity, conditioning.

With u1, u2, s1, s2, s and c of `links`, and e1 = u1 c + s1 s, e2 = u2 c − s2 s::

    q1' = x' − u1/s1 y' + b e1/s1 θ'
    q2' = x' + u2/s2 y' + b e2/s2 θ'        det J = −b N/(s1 s2),  N = u1 e2 + u2 e1
    q3' = x'

This is J = A⁻¹B of eqs 10-17 with the first term of eq. 11 corrected to q2'. N = 0 is a parallel
singularity that the paper does not mention: the platform can move with all carriages locked.

J mixes metres and radians, so the conditioning index depends on the unit of length. In
millimetres, as in the paper, the index is low only at the far edge of the workspace. With a
characteristic length near the machine's size it is also low near the rail, where authority is
weak.
"""

from __future__ import annotations

from collections.abc import Callable
import math
import struct
from typing import TYPE_CHECKING

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import inverse
from facade_manipulator.kinematics.geometry import Geometry, Pose

if TYPE_CHECKING:
    import numpy as np

# writes into any buffer, also an array
_pack_matrix: Callable[..., None] = struct.Struct('9d').pack_into


def _empty(shape: tuple[int, int]) -> np.ndarray:
    """Return an array; the first call replaces this function by that of numpy."""
    global _empty
    from numpy import empty as _empty

    return _empty(shape)


def jacobian(geometry: Geometry, pose: Pose) -> np.ndarray:
    """
    Return the Jacobian J from platform rates to carriage rates, q' = J (x', y', θ').

    Parameters
    ----------
    geometry : Geometry
    pose : Pose
        [m, m, rad].

    Returns
    -------
    ndarray, shape (3, 3)
        The columns of x' and y' are dimensionless; the column of θ' is in m/rad.

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    References
    ----------
    Eqs 10-17 of the paper.

    """
    y1, t1, y2, t2 = _entries(geometry, pose)
    matrix = _empty((3, 3))
    # a third of the time of np.array() on nested tuples
    _pack_matrix(matrix, 0, 1.0, y1, t1, 1.0, y2, t2, 1.0, 0.0, 0.0)
    return matrix


def parallel_singularity(geometry: Geometry, pose: Pose) -> float:
    """
    Return N = b s²(q1 − q2) + (q1 + q2 − 2 q3) y s + 2 y² c at a pose [m²].

    N is 0 at a parallel (type 2) singularity, as det B = −4 b N and det J = −b N/(s1 s2). A pose
    with N ≤ 0 is on another assembly branch than the machine's and must not be commanded.

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    """
    return inverse.branch_number(inverse.links(geometry, pose))


def local_conditioning_index(
    geometry: Geometry, pose: Pose, characteristic_length: float = 1.0
) -> float:
    """
    Return the local conditioning index 1/(‖J‖ ‖J⁻¹‖), with ‖J‖² = tr(JᵀJ)/3 [1].

    The index is in [0, 1], depends only on (y, θ), and is 0 at every singularity.

    Parameters
    ----------
    geometry : Geometry
    pose : Pose
        [m, m, rad].
    characteristic_length : float
        Unit of length of J [m]; 0.001 gives the paper's index in mm.

    Raises
    ------
    ParameterError
        If the pose is not finite or the characteristic length not positive.
    UnreachableError
        As `inverse_kinematics`.

    References
    ----------
    Eqs 24-25 of the paper. The closed form of its appendix is misprinted.

    """
    check_characteristic_length(characteristic_length)
    at = inverse.links(geometry, pose)
    ratio = geometry.platform_half_length / characteristic_length
    return math.sqrt(inverse.squared_index(at, ratio, ratio))


def check_characteristic_length(length: float) -> None:
    """
    Require a positive characteristic length of the index [m].

    Raises a ParameterError for any other value.
    """
    if not (math.isfinite(length) and length > 0.0):
        raise ParameterError(
            f'characteristic_length = {length} m is not a positive length; '
            'next: set a length above 0 m'
        )


def _entries(geometry: Geometry, pose: Pose) -> tuple[float, float, float, float]:
    half = geometry.platform_half_length
    return inverse.jacobian_entries(inverse.links(geometry, pose), half, half)
