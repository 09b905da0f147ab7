"""
Closure of the two links: the cubic behind forward kinematics, and its polish.

The closure leaves a cubic in c = cos θ. With D = q2 − q1, S = q1 + q2 − 2 q3, e = S²/4 and
K0 = l² − b² − D²/4::

    y²  = K0 − e + b D c,      y s = S (2 b c − D)/(4 b),      f(c) = 0,
    f(c) = b D c³ + K0 c² − D (b + e/b) c + e (1 + D²/(4b²)) − K0.

It is not in the paper.
"""

from __future__ import annotations

from math import sqrt

from facade_manipulator.errors import SingularityError
from facade_manipulator.kinematics.geometry import Geometry

Coefficients = tuple[float, float, float, float]


def cubic(geometry: Geometry, distance: float, double_offset: float) -> Coefficients:
    """
    Coefficients (f0, f1, f2, f3) of f = f0 − f1 u + f2 u² − f3 u³ in u = 1 − cos θ.

    Near θ = 0, u keeps the digits that cos θ loses.

    Parameters
    ----------
    geometry : Geometry
    distance, double_offset : float
        D = q2 − q1 and S = q1 + q2 − 2 q3 [m].

    """
    half = geometry.platform_half_length
    e = 0.25 * double_offset * double_offset
    slack = 1.0 - distance / (2.0 * half)
    product = half * distance
    constant = closure_constant(geometry, distance)
    return (
        e * slack * slack,
        2.0 * (product + constant) - e * distance / half,
        3.0 * product + constant,
        product,
    )


def closure_constant(geometry: Geometry, distance: float) -> float:
    """K0 = l² − b² − D²/4 [m²]."""
    length, half = geometry.link_length, geometry.platform_half_length
    return (length - half) * (length + half) - 0.25 * distance * distance


def closure_residuals(
    geometry: Geometry, left: float, right: float, y: float, sine: float, cosine: float
) -> tuple[float, float]:
    """|A_i B_i|² − l² of both links [m²], for left = q1 − q3 and right = q2 − q3."""
    length, half = geometry.link_length, geometry.platform_half_length
    s1, s2 = left + half * cosine, half * cosine - right
    u1, u2 = y - half * sine, y + half * sine
    return s1 * s1 + u1 * u1 - length * length, s2 * s2 + u2 * u2 - length * length


def newton_step(
    geometry: Geometry, left: float, right: float, y: float, sine: float, cosine: float
) -> tuple[float, float]:
    """
    One Newton step (Δy, Δθ) on the closure of both links.

    Raises
    ------
    SingularityError
        If N is exactly 0 there.

    """
    half = geometry.platform_half_length
    residual1, residual2 = closure_residuals(geometry, left, right, y, sine, cosine)
    u1, u2 = y - half * sine, y + half * sine
    e1 = u1 * cosine + (left + half * cosine) * sine
    e2 = u2 * cosine - (half * cosine - right) * sine
    number = u1 * e2 + u2 * e1
    if number == 0.0:
        raise SingularityError('|N|', 0.0, 0.0, 'm2', 'not above')
    return (
        -0.5 * (residual1 * e2 + residual2 * e1) / number,
        -0.5 * (residual2 * u1 - residual1 * u2) / (number * half),
    )


def unit(sine: float, cosine: float) -> tuple[float, float]:
    """Scale a sine and a cosine that nearly belong together to one."""
    norm = sqrt(sine * sine + cosine * cosine)
    return sine / norm, cosine / norm
