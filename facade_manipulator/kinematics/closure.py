"""
Closure of the two links: the cubic behind forward kinematics, and its polish.

The closure leaves a cubic in c = cos θ. With D = q2 − q1, S = q1 + q2 − 2 q3, e = S²/4 and
K0 = l² − b² − D²/4::

    y²  = K0 − e + b D c,      y s = S (2 b c − D)/(4 b),      f(c) = 0,
    f(c) = b D c³ + K0 c² − D (b + e/b) c + e (1 + D²/(4b²)) − K0.

It is not in the paper.
"""

from __future__ import annotations

from facade_manipulator.errors import SingularityError
from facade_manipulator.kinematics.geometry import Geometry

FARTHEST = 200.0  # m, l + b of the largest geometry: what the links reach; no power overflows


def cubic(
    geometry: Geometry, left: float, right: float
) -> tuple[float, float, float, float, float]:
    """
    Return the cubic f = f0 − f1 u + f2 u² − f3 u³ in u = 1 − cos θ, and y² at u = 0.

    Near θ = 0, u keeps the digits that cos θ loses; y² falls by f3 u.

    Parameters
    ----------
    geometry : Geometry
    left, right : float
        q1 − q3 and q2 − q3 [m].

    Returns
    -------
    f0, f1, f2, f3, y² : float
        [m²].

    """
    length, half = geometry.link_length, geometry.platform_half_length
    distance = right - left
    e = 0.25 * (left + right) * (left + right)
    slack = 1.0 - 0.5 * distance / half
    product = half * distance
    constant = (length - half) * (length + half) - 0.25 * distance * distance  # K0
    return (
        e * slack * slack,
        2.0 * (product + constant) - e * distance / half,
        3.0 * product + constant,
        product,
        constant + product - e,
    )


def newton_step(
    geometry: Geometry, left: float, right: float, y: float, sine: float, cosine: float
) -> tuple[float, float]:
    """
    One Newton step (Δy, Δθ) on |A_i B_i|² = l² of both links.

    Raises
    ------
    SingularityError
        If N is exactly 0 there.

    """
    length, half = geometry.link_length, geometry.platform_half_length
    rise, span = half * sine, half * cosine
    u1, u2, s1, s2 = y - rise, y + rise, left + span, span - right
    square = length * length
    residual1 = s1 * s1 + u1 * u1 - square
    residual2 = s2 * s2 + u2 * u2 - square
    e1 = u1 * cosine + s1 * sine
    e2 = u2 * cosine - s2 * sine
    number = u1 * e2 + u2 * e1
    if number == 0.0:
        raise SingularityError('|N|', 0.0, 0.0, 'm2', 'not above')
    scale = -0.5 / number
    return (
        scale * (residual1 * e2 + residual2 * e1),
        scale * (residual2 * u1 - residual1 * u2) / half,
    )
