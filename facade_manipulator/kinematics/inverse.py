"""
Inverse kinematics: carriages and their velocities for a pose, and the checks of every limit.

References
----------
Park et al., "Design of a 3-DOF Parallel Manipulator to Compensate for Disturbances in Facade
Cleaning", eqs 7-19; conditioning eqs 24-25.

"""

from __future__ import annotations

from math import cos, isfinite, sin, sqrt
from typing import TYPE_CHECKING, TypeVar

from facade_manipulator.errors import (
    CarriageGapError,
    SingularityError,
    StrokeLimitError,
    UnreachableError,
)
from facade_manipulator.kinematics.geometry import Carriages, Geometry, not_finite, Pose

if TYPE_CHECKING:
    import numpy as np

# b over the unit of length of the index. That unit is 1 m for the design and grows with the
# mechanism, so that the same poses are well conditioned at every size.
CONDITIONING_RATIO = 0.348
# With that unit, the order of the carriages keeps the index of the design above 0.07 near the
# rail. Towards the far edge the index falls to 0 as the links become upright. At θ = 0 it falls
# below 0.05 within 0.1 mm of the edge, where carriages already move 40 times faster than the head.
MIN_CONDITIONING = 0.05
_TINY = 1e-300  # avoids NaN from 0/0
# The tuple s, c, u1, u2, s1, s2 of `links`: named fields would cost as much time as computing the
# values.
Links = tuple[float, float, float, float, float, float]
Number = TypeVar('Number', float, 'np.ndarray')
_new_tuple = tuple.__new__


def inverse_kinematics(geometry: Geometry, pose: Pose) -> Carriages:
    """
    Return the carriage positions of a pose, with both outer carriages within the platform [m].

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

    """
    x = pose[0]
    _, cosine, _, _, projection1, projection2 = links(geometry, pose)
    span = geometry.platform_half_length * cosine
    # half the time of Carriages(...), which matters because each setpoint needs one
    return _new_tuple(Carriages, (x - span + projection1, x + span - projection2, x))


def working_modes(geometry: Geometry, pose: Pose) -> tuple[Carriages, ...]:
    """
    Return the carriages of a pose in the paper's four working modes (eqs 7-9) [m].

    The signs of the roots in q1 = x − b cos θ + σ1 s1 and q2 = x + b cos θ + σ2 s2 are in the
    order (+, +), (+, −), (−, +), (−, −). The machine is built for (+, −).

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    """
    _, cosine, _, _, projection1, projection2 = links(geometry, pose)
    span = geometry.platform_half_length * cosine
    return tuple(
        Carriages(
            pose.x - span + sign1 * projection1,
            pose.x + span + sign2 * projection2,
            pose.x,
        )
        for sign1 in (1.0, -1.0)
        for sign2 in (1.0, -1.0)
    )


def links(geometry: Geometry, pose: Pose) -> Links:
    """
    Return the terms of both links at a pose that the velocity formulas need.

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
    x, y, theta = pose
    if not isfinite(x + y + theta):
        raise not_finite(Pose(x, y, theta))
    sine = sin(theta)
    length = geometry.link_length
    rise = geometry.platform_half_length * sine
    u1 = y - rise
    u2 = y + rise
    square = length * length
    root1 = square - u1 * u1
    root2 = square - u2 * u2
    if root1 <= 0.0 or root2 <= 0.0:
        raise UnreachableError(
            '|y| + b |sin theta|',
            abs(y) + abs(rise),
            length,
            'm',
            'not below',
            'geometry.link_length',
        )
    return sine, cos(theta), u1, u2, sqrt(root1), sqrt(root2)


def jacobian_entries(
    at: Links, half1: float, half2: float
) -> tuple[float, float, float, float]:
    """Return the y and θ entries of the Jacobian's first two rows, for both halves."""
    sine, cosine, u1, u2, s1, s2 = at
    y1, y2 = -u1 / s1, u2 / s2
    return y1, half1 * (sine - y1 * cosine), y2, half2 * (y2 * cosine - sine)


def branch_number(at: tuple[Number, Number, Number, Number, Number, Number]) -> Number:
    """Return N [m²] of `parallel_singularity` from the links of a pose, for floats or arrays."""
    sine, cosine, u1, u2, s1, s2 = at
    return u1 * (u2 * cosine - s2 * sine) + u2 * (u1 * cosine + s1 * sine)


def squared_index(
    at: tuple[Number, Number, Number, Number, Number, Number],
    ratio1: float,
    ratio2: float,
) -> Number:
    """
    Return the square of the conditioning index, for floats or arrays.

    With P = s1 s2, LCI² = 9 d² P²/(g² (d² + k²)), which stays finite on the far edge P = 0. Here
    g² = 3 ‖J‖² P², d = det J·P and k² = ‖adj J‖² P² − d².

    The ratios are the platform's halves over the characteristic length.
    """
    sine, cosine, u1, u2, s1, s2 = at
    y1, y2 = u1 * s2, u2 * s1
    e1, e2 = u1 * cosine + s1 * sine, u2 * cosine - s2 * sine
    t1, t2 = ratio1 * s2 * e1, ratio2 * s1 * e2
    determinant = ratio2 * u1 * e2 + ratio1 * u2 * e1
    determinant2 = determinant * determinant
    product = s1 * s2
    product2 = product * product
    # This order of factors gives the same last bit for −θ.
    sum2 = (y1 * y1 + y2 * y2) + (t1 * t1 + t2 * t2)
    cofactor2 = sum2 + (y1 + y2) * (y1 + y2) + (t1 - t2) * (t1 - t2)
    # If the mechanism is folded flat, d and k vanish together and the index is 0.
    return (
        9.0
        * determinant2
        * product2
        / ((sum2 + 3.0 * product2) * (determinant2 + cofactor2 + _TINY))
    )


def check_rail(
    geometry: Geometry, distance1: float, distance2: float, q1: float, q2: float
) -> None:
    """
    Require the stroke, then the order A1, A3, A2 with the gap between neighbours (eq. 18).

    The distances are q3 − q1 and q2 − q3 on the rail [m]. Checking the stroke of A1 and A2 is
    sufficient, because A3 is between them. Raises a StrokeLimitError or a CarriageGapError.
    """
    gap, (minimum, maximum) = geometry.carriage_gap, geometry.stroke
    if q1 < minimum:
        raise StrokeLimitError('q1', q1, minimum, 'm', 'below', 'geometry.stroke')
    if q2 > maximum:
        raise StrokeLimitError('q2', q2, maximum, 'm', 'above', 'geometry.stroke')
    if distance1 < gap or distance1 <= 0.0:
        raise CarriageGapError(
            'q3 - q1',
            distance1,
            gap,
            'm',
            'below' if gap else 'not above',
            'geometry.carriage_gap',
        )
    if distance2 < gap or distance2 <= 0.0:
        raise CarriageGapError(
            'q2 - q3',
            distance2,
            gap,
            'm',
            'below' if gap else 'not above',
            'geometry.carriage_gap',
        )


def check_branch(number: float, square: float = 1.0, least: float = 0.0) -> None:
    """
    Require N > 0 [m²], the machine's branch, and a minimum conditioning index.

    The caller passes the square of the index. Raises a SingularityError.
    """
    if number <= 0.0:
        raise SingularityError(
            'N', number, 0.0, 'm2', 'at or beyond the parallel singularity, not above'
        )
    index = sqrt(square)
    if index < least:
        raise SingularityError(
            'conditioning index', index, least, '', 'below', 'min_conditioning'
        )


def behind_rail(y: float) -> SingularityError:
    """Return the error for a platform behind the rail, at y [m]."""
    return SingularityError(
        'y', y, 0.0, 'm', 'behind the rail, on the mirrored assembly branch: not above'
    )
