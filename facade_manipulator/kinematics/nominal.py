"""
Kinematics of the nominal `Geometry`; it uses only l, b, stroke and gap.

Most functions call `Geometry.drawn`, the `Mechanism` without calibration errors. The conditioning
index mixes metres and radians, so it depends on the unit of length. In millimetres, as in the
paper, the index is low only at the far edge of the workspace. With a characteristic length near
the machine's size it is also low near the rail, where authority is weak.
"""

from __future__ import annotations

from math import cos, isfinite, sqrt
from typing import TYPE_CHECKING

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import closure
from facade_manipulator.kinematics.geometry import (
    Carriages,
    Geometry,
    not_finite_error,
    Pose,
)
from facade_manipulator.kinematics.links import branch_number, Links, squared_index

if TYPE_CHECKING:
    import numpy as np


def links(geometry: Geometry, pose: Pose) -> Links:
    """
    Return the terms of both links at a pose, as needed by the velocity formulas.

    B1 and B2 are the joints between platform and links. Their distances from the rail, along y,
    are u1 = y − b s and u2 = y + b s [m]. The projections of the links on the rail, along x, are
    s1 = q1 − x + b c and s2 = x + b c − q2 [m]. Both are positive in the machine's working mode.

    Returns
    -------
    s, c, u1, u2, s1, s2 : float
        s and c are the sine and cosine of θ.

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    """
    return geometry.drawn.links(pose)


def inverse_kinematics(geometry: Geometry, pose: Pose) -> Carriages:
    """
    Return the carriage positions for a pose [m]; both outer carriages are within the platform.

    Only the reach of the links is checked; `Mechanism.certify` checks all limits.

    Parameters
    ----------
    geometry : Geometry
    pose : Pose
        [m, m, rad].

    Returns
    -------
    Carriages
        [m].

    Raises
    ------
    ParameterError
        If the pose is not finite (a ValueError).
    UnreachableError
        If a link is too short: ``|y| + b |sin θ|`` is not below l (eq. 19).

    References
    ----------
    Eqs 7-9 of the paper.

    """
    return geometry.drawn.inverse_kinematics(pose)


def working_modes(geometry: Geometry, pose: Pose) -> tuple[Carriages, ...]:
    """
    Return the carriage positions [m] for a pose in the paper's four working modes (eqs 7-9).

    The signs of the roots in q1 = x − b cos θ + σ1 s1 and q2 = x + b cos θ + σ2 s2 are in the
    order (+, +), (+, −), (−, +), (−, −). The machine is built for (+, −).

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    """
    _, _, _, _, s1, s2 = geometry.drawn.links(pose)
    q1, q2, q3 = geometry.drawn.inverse_kinematics(pose)
    other1 = q1 - 2.0 * s1
    other2 = q2 + 2.0 * s2
    return (
        Carriages(q1, other2, q3),
        Carriages(q1, q2, q3),
        Carriages(other1, other2, q3),
        Carriages(other1, q2, q3),
    )


def forward_kinematics(geometry: Geometry, carriages: Carriages) -> Pose:
    """
    Return the pose [m, m, rad] on the machine's branch: A1 before A2, y > 0, N > 0.

    On this branch q1 < q2, y > 0 (in front of the rail) and N > 0 (`parallel_singularity`).

    Parameters
    ----------
    geometry : Geometry
    carriages : Carriages
        [m].

    Returns
    -------
    Pose
        [m, m, rad].

    Raises
    ------
    ParameterError
        If a position is not finite (a ValueError).
    UnreachableError
        If the links cannot be joined, or only on another branch or in another working mode.
    SingularityError
        If the pose is exactly singular.

    """
    return geometry.drawn.forward_kinematics(carriages)


def assembly_modes(geometry: Geometry, carriages: Carriages) -> tuple[Pose, ...]:
    """
    Return all platform poses [m, m, rad] for three carriage positions, at most four.

    Two poses are in front of the rail and two are their mirror images behind it; any working mode
    is possible. Poses are sorted by decreasing cos θ, then by decreasing y. If the machine can
    take one of these poses, the first is the pose of `forward_kinematics`.

    Raises
    ------
    ParameterError
        If a position is not finite (a ValueError).

    """
    q1, q2, q3 = carriages
    if not all(map(isfinite, carriages)):
        raise not_finite_error(Carriages(q1, q2, q3))
    modes = []
    for y, theta in closure.platforms(
        geometry.link_length, geometry.platform_half_length, q1 - q3, q2 - q3
    ):
        modes.append(Pose(q3, y, theta))
        modes.append(Pose(q3, -y, -theta))
    return tuple(sorted(modes, key=lambda pose: (-cos(pose.theta), -pose.y)))


def jacobian(geometry: Geometry, pose: Pose) -> np.ndarray:
    """
    Return the Jacobian J that maps platform rates to carriage rates: q' = J (x', y', θ').

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
    return geometry.drawn.jacobian(pose)


def parallel_singularity(geometry: Geometry, pose: Pose) -> float:
    """
    Return N = b s²(q1 − q2) + (q1 + q2 − 2 q3) y s + 2 y² c [m²] at a pose.

    N is 0 at a parallel (type 2) singularity, as det B = −4 b N and det J = −b N/(s1 s2). A pose
    with N ≤ 0 is on another assembly branch than the machine's and must not be commanded.

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    """
    return branch_number(geometry.drawn.links(pose))


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
    ratio = geometry.platform_half_length / characteristic_length
    return sqrt(squared_index(geometry.drawn.links(pose), ratio, ratio))


def check_characteristic_length(length: float) -> None:
    """
    Require that the characteristic length of the index is positive [m].

    Raises a ParameterError for any other value.
    """
    if not (isfinite(length) and length > 0.0):
        raise ParameterError(
            f'characteristic_length = {length} m is not a positive length; '
            'next: set a length above 0 m'
        )
