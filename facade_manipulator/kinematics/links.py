"""
Formulas of both links for a platform pose; each side has its own lengths l1, b1 or l2, b2.

B1 and B2 are the joints between platform and links. Their distances u1 and u2 from the rail, along
y, and the projections s1 and s2 of the links on the rail, along x, are

    u1 = y − b1 s,  u2 = y + b2 s,  s1 = √(l1² − u1²),  s2 = √(l2² − u2²),

where s and c are the sine and cosine of θ. The carriages are (eqs 7-9, in the working mode “+−” of
the machine, in which both projections point inwards)

    q1 = x − b1 c + s1,  q2 = x + b2 c − s2,  q3 = x.

With e1 = u1 c + s1 s and e2 = u2 c − s2 s, their rates are

    q1' = x' − u1/s1 y' + b1 e1/s1 θ'
    q2' = x' + u2/s2 y' + b2 e2/s2 θ'
    q3' = x'.

This is J = A⁻¹B of eqs 10-17 with the first term of eq. 11 corrected to q2'. Its determinant is
−b N/(s1 s2), where b is the mean of b1 and b2, and

    N = (b2 u1 e2 + b1 u2 e1)/b.

N = 0 is a parallel singularity that the paper does not mention: the platform can move with all
carriages locked.

The functions take numbers or arrays of poses.

References
----------
Park et al., "Design of a 3-DOF Parallel Manipulator to Compensate for Disturbances in Facade
Cleaning", eqs 7-25.

"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, sin, sqrt
from typing import Any, TYPE_CHECKING, TypeVar

from facade_manipulator.kinematics.geometry import Sides

if TYPE_CHECKING:
    import numpy as np

# The tuple s, c, u1, u2, s1, s2: named fields would cost as much time as computing the values.
Links = tuple[float, float, float, float, float, float]
Number = TypeVar('Number', float, 'np.ndarray')
AnyLinks = tuple[Number, Number, Number, Number, Number, Number]


def links(
    sides: Sides,
    y: Number,
    theta: Number,
    sin: Callable[[Any], Any] = sin,
    cos: Callable[[Any], Any] = cos,
    root: Callable[[Any], Any] = sqrt,
) -> AnyLinks[Number]:
    """
    Return s, c, u1, u2, s1 and s2 for a platform pose.

    Parameters
    ----------
    sides : Sides
        l1, l2, b1 and b2 [m].
    y, theta : float or array
        Pose of the platform [m, rad]; nothing depends on x.
    sin, cos : callable
        Those of numpy for arrays.
    root : callable
        Square root of s1² and s2², which are negative out of reach. Out of reach, the default
        raises a ValueError, the root of numpy returns NaN, and another root may return 0.

    """
    link1, link2, half1, half2 = sides
    sine = sin(theta)
    u1 = y - half1 * sine
    u2 = y + half2 * sine
    s1 = root(link1 * link1 - u1 * u1)
    s2 = root(link2 * link2 - u2 * u2)
    return sine, cos(theta), u1, u2, s1, s2


def x_interval(
    sides: Sides,
    stroke: tuple[float, float],
    cosine: Number,
    projection1: Number,
    projection2: Number,
) -> tuple[Number, Number]:
    """Return the x [m] with A1 at the minimum of the stroke, and the x with A2 at the maximum."""
    _, _, half1, half2 = sides
    minimum, maximum = stroke
    lower = minimum + half1 * cosine - projection1
    upper = maximum - half2 * cosine + projection2
    return lower, upper


def branch_number(
    at: AnyLinks[Number], half1: float = 1.0, half2: float = 1.0
) -> Number:
    """
    Return N [m²] of `parallel_singularity`, which needs only the ratio of both halves.

    N = (b2 u1 e2 + b1 u2 e1)/b.
    """
    sine, cosine, u1, u2, s1, s2 = at
    mean = 0.5 * (half1 + half2)
    e1 = u1 * cosine + s1 * sine
    e2 = u2 * cosine - s2 * sine
    return half2 / mean * u1 * e2 + half1 / mean * u2 * e1


_TINY = 1e-300  # avoids NaN from 0/0


def squared_index(at: AnyLinks[Number], ratio1: float, ratio2: float) -> Number:
    """
    Return the square of the conditioning index (eqs 24-25).

    With P = s1 s2, LCI² = 9 d² P²/(g² (d² + k²)), which stays finite on the far edge P = 0. Here
    g² = 3 ‖J‖² P², d = det J·P and k² = ‖adj J‖² P² − d².

    The ratios are the platform's halves over the characteristic length.
    """
    sine, cosine, u1, u2, s1, s2 = at
    e1 = u1 * cosine + s1 * sine
    e2 = u2 * cosine - s2 * sine

    # the entries of y' and θ' in J, times P
    y1 = u1 * s2
    y2 = u2 * s1
    t1 = ratio1 * s2 * e1
    t2 = ratio2 * s1 * e2

    determinant = ratio2 * u1 * e2 + ratio1 * u2 * e1
    determinant2 = determinant * determinant
    product = s1 * s2
    product2 = product * product
    # This order of factors gives the same last bit for −θ.
    sum2 = (y1 * y1 + y2 * y2) + (t1 * t1 + t2 * t2)
    cofactor2 = sum2 + (y1 + y2) * (y1 + y2) + (t1 - t2) * (t1 - t2)

    # If the mechanism is folded flat, d and k vanish together and the index is 0.
    norms2 = (sum2 + 3.0 * product2) * (determinant2 + cofactor2 + _TINY)
    return 9.0 * determinant2 * product2 / norms2
