"""
Velocities, forces, singularities and conditioning of one pose (sections II-B, IV of the paper).

With the heights u1, u2 and projections s1, s2 of `links`, and e1 = u1 c + s1 s, e2 = u2 c − s2 s::

    q1' = x' − u1/s1 y' + b e1/s1 θ'
    q2' = x' + u2/s2 y' + b e2/s2 θ'        det J = −b N/(s1 s2),  N = u1 e2 + u2 e1
    q3' = x'

This is J = A⁻¹B of eqs 10-17 with the first term of eq. 11 corrected to q2'. N = 0 is a parallel
singularity that the paper does not mention: the platform can move with all carriages locked.

J mixes metres and radians, so the conditioning index depends on the unit of length. In
millimetres, as in the paper, it flags only the far edge of the workspace; with a characteristic
length near the machine's own size it also flags weak authority near the rail.
"""

from __future__ import annotations

from math import isfinite, sqrt
import struct
from typing import Any

import numpy as np

from facade_manipulator.errors import ParameterError, SingularityError
from facade_manipulator.kinematics.geometry import Carriages, Geometry, Pose, Twist, Wrench
from facade_manipulator.kinematics.inverse import Links, links
from facade_manipulator.kinematics.modes import WorkingMode

_TINY = 1e-300
_empty = np.empty
_pack_matrix = struct.Struct('9d').pack_into


def jacobian(
    geometry: Geometry, pose: Pose, working_mode: WorkingMode = WorkingMode.PLUS_MINUS
) -> np.ndarray:
    """
    Jacobian J from platform rates to carriage rates, (q1', q2', q3') = J (x', y', θ').

    Parameters
    ----------
    geometry : Geometry
    pose : Pose
        [m, m, rad].
    working_mode : WorkingMode

    Returns
    -------
    ndarray, shape (3, 3)
        Columns of x' and y' are pure numbers, the column of θ' is in m/rad.

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    References
    ----------
    Eqs 10-17 of the paper.

    """
    y1, t1, y2, t2 = _entries(geometry, pose, working_mode)
    matrix = _empty((3, 3))
    # A third of the time of np.array() on nested tuples.
    _pack_matrix(matrix, 0, 1.0, y1, t1, 1.0, y2, t2, 1.0, 0.0, 0.0)
    return matrix


def carriage_velocity(
    geometry: Geometry, pose: Pose, velocity: Twist,
    working_mode: WorkingMode = WorkingMode.PLUS_MINUS,
) -> Carriages:
    """
    Carriage velocities J·velocity of a platform velocity (x', y', θ') [m/s, rad/s].

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    """
    y1, t1, y2, t2 = _entries(geometry, pose, working_mode)
    vx, vy, omega = velocity
    return Carriages(vx + y1 * vy + t1 * omega, vx + y2 * vy + t2 * omega, vx)


def platform_velocity(
    geometry: Geometry, pose: Pose, velocity: Carriages,
    working_mode: WorkingMode = WorkingMode.PLUS_MINUS,
) -> Twist:
    """
    Platform velocity J⁻¹·velocity (x', y', θ') of carriage velocities [m/s, rad/s].

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.
    SingularityError
        If the pose is exactly singular, N = 0.

    """
    y1, t1, y2, t2 = _entries(geometry, pose, working_mode)
    v1, v2, v3 = velocity
    determinant = y1 * t2 - y2 * t1
    if determinant == 0.0:
        raise SingularityError('|N|', 0.0, 0.0, 'm2', 'not above')
    side1, side2 = v1 - v3, v2 - v3
    return Twist(
        v3,
        (t2 * side1 - t1 * side2) / determinant,
        (y1 * side2 - y2 * side1) / determinant,
    )


def end_effector_force(
    geometry: Geometry, pose: Pose, carriage_forces: Carriages,
    working_mode: WorkingMode = WorkingMode.PLUS_MINUS,
) -> Wrench:
    """
    Force Jᵀτ that carriage forces τ along the rail [N] exert through the end effector.

    Virtual work: Fᵀ ṗ = τᵀ q̇ for every motion. Friction and weight are not in it.

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    """
    y1, t1, y2, t2 = _entries(geometry, pose, working_mode)
    f1, f2, f3 = carriage_forces
    return Wrench(f1 + f2 + f3, y1 * f1 + y2 * f2, t1 * f1 + t2 * f2)


def parallel_singularity(
    geometry: Geometry, pose: Pose, working_mode: WorkingMode = WorkingMode.PLUS_MINUS
) -> float:
    """
    N = b s²(q1 − q2) + (q1 + q2 − 2 q3) y s + 2 y² c [m²]: det B = −4 b N, det J = −b N/(s1 s2).

    Zero at a parallel (type 2) singularity. A pose with N ≤ 0 lies on another assembly branch
    than the machine's and must not be commanded.

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    """
    return branch_number(links(geometry, pose, working_mode))


def branch_number(at: Links) -> float:
    """N [m²] of `parallel_singularity`, from the links of a pose; on floats as on arrays."""
    sine, cosine, u1, u2, s1, s2 = at
    return u1 * (u2 * cosine - s2 * sine) + u2 * (u1 * cosine + s1 * sine)


def local_conditioning_index(
    geometry: Geometry, pose: Pose, characteristic_length: float = 1.0,
    working_mode: WorkingMode = WorkingMode.PLUS_MINUS,
) -> float:
    """
    Local conditioning index 1/(‖J‖ ‖J⁻¹‖), with ‖J‖² = tr(JᵀJ)/3.

    It lies in [0, 1], depends on (y, θ) only, and is 0 on every singularity.

    Parameters
    ----------
    geometry : Geometry
    pose : Pose
        [m, m, rad].
    characteristic_length : float
        Unit of length of J [m]; 0.001 gives the paper's index in mm.
    working_mode : WorkingMode

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
    at = links(geometry, pose, working_mode)
    return sqrt(squared_index(at, geometry.platform_half_length / characteristic_length))


def check_characteristic_length(length: float) -> None:
    """
    Check a unit of length of the index [m].

    Raises
    ------
    ParameterError
        If it is not a positive length.

    """
    if not (isfinite(length) and length > 0.0):
        raise ParameterError(f'characteristic_length = {length} m is not a positive length')


def squared_index(at: Links, ratio: Any) -> Any:
    """
    Square of the index, on floats as on arrays: one formula for both arithmetics.

    With P = s1 s2, LCI² = 9 d² P²/(g² (d² + k²)), which stays finite on the far edge P = 0; there
    g² is 3 ‖J‖² P², d is det J·P, and k² is ‖adj J‖² P² less d².

    Parameters
    ----------
    at : Links
    ratio : float
        b over the characteristic length.

    """
    sine, cosine, u1, u2, s1, s2 = at
    y1, y2 = u1 * s2, u2 * s1
    e1, e2 = u1 * cosine + s1 * sine, u2 * cosine - s2 * sine
    t1, t2 = ratio * s2 * e1, ratio * s1 * e2
    determinant = ratio * (u1 * e2 + u2 * e1)
    determinant2 = determinant * determinant
    product = s1 * s2
    product2 = product * product
    sum2 = (y1 * y1 + y2 * y2) + (t1 * t1 + t2 * t2)  # the same to the last bit for −θ
    cofactor2 = sum2 + (y1 + y2) * (y1 + y2) + (t1 - t2) * (t1 - t2)
    # Folded flat, d and k vanish together and the index is 0.
    return 9.0 * determinant2 * product2 / (
        (sum2 + 3.0 * product2) * (determinant2 + cofactor2 + _TINY))


def _entries(
    geometry: Geometry, pose: Pose, working_mode: WorkingMode
) -> tuple[float, float, float, float]:
    """Return the y and θ entries of the Jacobian's first two rows."""
    sine, cosine, u1, u2, s1, s2 = links(geometry, pose, working_mode)
    half = geometry.platform_half_length
    y1, y2 = -u1 / s1, u2 / s2
    return y1, half * (sine - y1 * cosine), y2, half * (y2 * cosine - sine)
