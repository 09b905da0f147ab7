"""
Velocities and forces at one pose (section II-B of the paper).

With the heights u1, u2 and projections s1, s2 of `links`, and e1 = u1 c + s1 s, e2 = u2 c − s2 s::

    q1' = x' − u1/s1 y' + b e1/s1 θ'
    q2' = x' + u2/s2 y' + b e2/s2 θ'        det J = −b N/(s1 s2),  N = u1 e2 + u2 e1
    q3' = x'

This is J = A⁻¹B of eqs 10-17 with the first term of eq. 11 corrected to q2'. N = 0 is a parallel
singularity that the paper does not mention: the platform can move with all carriages locked.
"""

from __future__ import annotations

import struct

import numpy as np

from facade_manipulator.errors import SingularityError
from facade_manipulator.kinematics.geometry import Carriages, Geometry, Pose, Twist, Wrench
from facade_manipulator.kinematics.inverse import links, WorkingMode

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


def _entries(
    geometry: Geometry, pose: Pose, working_mode: WorkingMode
) -> tuple[float, float, float, float]:
    """Return the y and θ entries of the Jacobian's first two rows."""
    sine, cosine, u1, u2, s1, s2 = links(geometry, pose, working_mode)
    half = geometry.platform_half_length
    y1, y2 = -u1 / s1, u2 / s2
    return y1, half * (sine - y1 * cosine), y2, half * (y2 * cosine - sine)
