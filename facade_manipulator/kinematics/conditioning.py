"""
Local conditioning index (eqs 24-25 of the paper).

The Jacobian mixes metres and radians, so the index depends on the unit of length. In millimetres,
as in the paper, it flags only the far edge of the workspace; with a characteristic length near
the machine's own size it also flags weak authority near the rail.
"""

from __future__ import annotations

from math import isfinite, sqrt
from typing import Any

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics.geometry import Geometry, Pose
from facade_manipulator.kinematics.inverse import Links, links
from facade_manipulator.kinematics.modes import WorkingMode

_TINY = 1e-300


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
