"""
What a pose asks of the mechanism: carriages and their velocities, and every limit.

References
----------
Park et al., "Design of a 3-DOF Parallel Manipulator to Compensate for Disturbances in Facade
Cleaning", eqs 7-19; conditioning eqs 24-25.

"""

from __future__ import annotations

from math import cos, isfinite, sin, sqrt
from typing import TypeVar

import numpy as np

from facade_manipulator.errors import (
    CarriageGapError,
    SingularityError,
    StrokeLimitError,
    UnreachableError,
)
from facade_manipulator.kinematics.geometry import Carriages, Geometry, not_finite, Pose

# b over the index's unit of length: for the design that is 1 m, for a mechanism of another size it
# grows with it, so that the same poses are well conditioned.
CONDITIONING_RATIO = 0.348
# With that unit, the order of the carriages alone keeps the design above 0.07 near the rail.
# Towards the far edge the index falls to 0 as the links become upright: 0.05 is passed 0.1 mm
# before it at θ = 0, where carriages already move 40 times faster than the head.
MIN_CONDITIONING = 0.05
_TINY = 1e-300  # keeps 0/0 from being NaN
# s, c, u1, u2, s1, s2 of `links`: plain tuples, because naming the fields would cost as much as
# computing them.
Links = tuple[float, float, float, float, float, float]
Number = TypeVar('Number', float, np.ndarray)
_new_tuple = tuple.__new__


def inverse_kinematics(geometry: Geometry, pose: Pose) -> Carriages:
    """
    Return the carriage positions of a pose, with both outer carriages inside the platform's span.

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
    # Carriages(...) in half the time: the machine asks for this at every setpoint.
    return _new_tuple(Carriages, (x - span + projection1, x + span - projection2, x))


def working_modes(geometry: Geometry, pose: Pose) -> tuple[Carriages, ...]:
    """
    Return the carriages of a pose in the paper's four working modes (eqs 7-9) [m].

    With the signs σ1 and σ2 of the roots in q1 = x − b cos θ + σ1 s1 and q2 = x + b cos θ + σ2 s2
    the order is (+, +), (+, −), (−, +), (−, −). The machine is built for (+, −).

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    """
    _, cosine, _, _, projection1, projection2 = links(geometry, pose)
    span = geometry.platform_half_length * cosine
    return tuple(
        Carriages(pose.x - span + sign1 * projection1, pose.x + span + sign2 * projection2, pose.x)
        for sign1 in (1.0, -1.0) for sign2 in (1.0, -1.0))


def links(geometry: Geometry, pose: Pose) -> Links:
    """
    Return the two links of a pose, as every formula of the velocities needs them.

    With s = sin θ and c = cos θ: heights u1 = y − b s and u2 = y + b s of B1 and B2 above the
    rail, and the links' projections on it, s1 = q1 − x + b c and s2 = x + b c − q2 [m]: of the
    paper's four working modes the machine is built for the one in which both are positive.

    Returns
    -------
    s, c, u1, u2, s1, s2

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
    height1 = y - rise
    height2 = y + rise
    square = length * length
    root1 = square - height1 * height1
    root2 = square - height2 * height2
    if root1 <= 0.0 or root2 <= 0.0:
        raise UnreachableError(
            '|y| + b |sin theta|', abs(y) + abs(rise), length, 'm', 'not below')
    return sine, cos(theta), height1, height2, sqrt(root1), sqrt(root2)


def jacobian_entries(
    at: Links, half1: float, half2: float
) -> tuple[float, float, float, float]:
    """Return the y and θ entries of the Jacobian's first two rows, for halves of the platform."""
    sine, cosine, u1, u2, s1, s2 = at
    y1, y2 = -u1 / s1, u2 / s2
    return y1, half1 * (sine - y1 * cosine), y2, half2 * (y2 * cosine - sine)


def branch_number(at: tuple[Number, Number, Number, Number, Number, Number]) -> Number:
    """N [m²] of `parallel_singularity`, from the links of a pose; on floats as on arrays."""
    sine, cosine, u1, u2, s1, s2 = at
    return u1 * (u2 * cosine - s2 * sine) + u2 * (u1 * cosine + s1 * sine)


def squared_index(
    at: tuple[Number, Number, Number, Number, Number, Number], ratio1: float, ratio2: float
) -> Number:
    """
    Square of the conditioning index, on floats as on arrays: one formula for both arithmetics.

    With P = s1 s2, LCI² = 9 d² P²/(g² (d² + k²)), which stays finite on the far edge P = 0; there
    g² is 3 ‖J‖² P², d is det J·P, and k² is ‖adj J‖² P² less d².

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
    sum2 = (y1 * y1 + y2 * y2) + (t1 * t1 + t2 * t2)  # the same to the last bit for −θ
    cofactor2 = sum2 + (y1 + y2) * (y1 + y2) + (t1 - t2) * (t1 - t2)
    # Folded flat, d and k vanish together and the index is 0.
    return 9.0 * determinant2 * product2 / (
        (sum2 + 3.0 * product2) * (determinant2 + cofactor2 + _TINY))


def check_rail(
    geometry: Geometry, distance1: float, distance2: float, q1: float, q2: float
) -> None:
    """
    Require the stroke, then the order A1, A3, A2 with the gap between neighbours (eq. 18).

    The distances are q3 − q1 and q2 − q3 on the rail [m]; the stroke is that of A1 and A2, and A3
    stands between them. Raises a StrokeLimitError or a CarriageGapError.
    """
    gap, (minimum, maximum) = geometry.carriage_gap, geometry.stroke
    if q1 < minimum:
        raise StrokeLimitError('q1', q1, minimum, 'm', 'below')
    if q2 > maximum:
        raise StrokeLimitError('q2', q2, maximum, 'm', 'above')
    if distance1 < gap or distance1 <= 0.0:
        raise CarriageGapError('q3 - q1', distance1, gap, 'm', 'below' if gap else 'not above')
    if distance2 < gap or distance2 <= 0.0:
        raise CarriageGapError('q2 - q3', distance2, gap, 'm', 'below' if gap else 'not above')


def check_branch(number: float, square: float = 1.0, least: float = 0.0) -> None:
    """
    Require N > 0 [m²], the machine's branch, and at least so much of the conditioning index.

    Of that the square is given. Raises a SingularityError.
    """
    if number <= 0.0:
        raise SingularityError(
            'N', number, 0.0, 'm2', 'at or beyond the parallel singularity, not above')
    index = sqrt(square)
    if index < least:
        raise SingularityError('conditioning index', index, least, '', 'below')


def behind_rail(y: float) -> SingularityError:
    """Say that a platform is behind the rail, ready to be raised."""
    return SingularityError(
        'y', y, 0.0, 'm', 'behind the rail, on the mirrored assembly branch: not above')
