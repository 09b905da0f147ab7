"""
Assembly modes: every pose in which the links can be joined to three carriages.

The platform's middle joint P slides above A3. With p = q1 − q3 and r = q2 − q3, the heights
u1 = y − b1 s and u2 = y + b2 s and the projections s1 = p + b1 c and s2 = b2 c − r, the links
close where s1² + u1² = l1² and s2² + u2² = l2². That leaves y² = α + β c and y s = γ + δ c, and so
a cubic in c = cos θ. It is not in the paper.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import atan2, cos, hypot, isfinite, sin, sqrt
from typing import NamedTuple

import numpy as np

from facade_manipulator.kinematics.geometry import Carriages, Geometry, not_finite, Pose
from facade_manipulator.kinematics.inverse import Links

FARTHEST = 200.0  # m, l + b of the largest geometry: what the links reach; no power overflows
CONVERGED = 1e-8  # such a Newton step leaves its square
STEPS = 20
_ROOT_TOLERANCE = 1e-6  # on the imaginary part and on cos θ: double roots split by √eps
_CLOSURE_TOLERANCE = 1e-10  # of the lengths: decides which candidate is real
_SAME_TOLERANCE = 1e-7  # of y/l and θ: two candidates that are one mode
_NEGLIGIBLE = 1e-30  # of the greatest coefficient: its root lies far beyond |cos θ| = 1

Mode = tuple[float, float]  # y and θ of the platform


class Lengths(NamedTuple):
    """Lengths of the links and of the platform's halves, on the sides of A1 and of A2 [m]."""

    link1: float
    link2: float
    half1: float
    half2: float


def assembly_modes(geometry: Geometry, carriages: Carriages) -> list[Pose]:
    """
    All real poses of three carriage positions: up to four, each with its mirror in the rail.

    Parameters
    ----------
    geometry : Geometry
    carriages : Carriages
        [m].

    Returns
    -------
    list of Pose
        Empty if the links cannot be joined; y descending, the machine's branch among the first.

    Raises
    ------
    ParameterError
        If a position is not finite (a ValueError).

    """
    q1, q2, q3 = carriages
    if not all(map(isfinite, carriages)):
        raise not_finite(Carriages(q1, q2, q3))
    length, half = geometry.link_length, geometry.platform_half_length
    return [Pose(q3, y, theta) for y, theta in modes(
        Lengths(length, length, half, half), q1 - q3, q2 - q3)]


def modes(lengths: Lengths, left: float, right: float) -> list[Mode]:
    """Return y and θ of every assembly mode for left = q1 − q3 and right = q2 − q3 [m]."""
    found: list[Mode] = []
    if max(abs(left), abs(right)) > FARTHEST:
        return found
    for candidate in _candidates(lengths, left, right):
        mode = newton(lengths, left, right, *candidate) or candidate  # a singular one stays
        if _closes(lengths, left, right, *mode) and not any(
                _same(lengths.link1, mode, other) for other in found):
            found.append(mode)
    return sorted(found, key=lambda mode: (-mode[0], abs(mode[1])))


def closing(lengths: Lengths, left: float, right: float, y: float, theta: float) -> Links:
    """Return the links of carriages and a pose, whether they have their lengths or not."""
    _, _, half1, half2 = lengths
    sine, cosine = sin(theta), cos(theta)
    return (sine, cosine, y - half1 * sine, y + half2 * sine,
            left + half1 * cosine, half2 * cosine - right)


def newton(
    lengths: Lengths, left: float, right: float, y: float, theta: float
) -> Mode | None:
    """Return where Newton's method on the closure converges; None if it does not."""
    link1, link2, half1, half2 = lengths
    for _ in range(STEPS):
        sine, cosine, u1, u2, s1, s2 = closing(lengths, left, right, y, theta)
        turn1, turn2 = half1 * (u1 * cosine + s1 * sine), half2 * (u2 * cosine - s2 * sine)
        number = 2.0 * (u1 * turn2 + u2 * turn1)
        if number == 0.0:
            return None
        miss1, miss2 = s1 * s1 + u1 * u1 - link1 * link1, s2 * s2 + u2 * u2 - link2 * link2
        dy = -(miss1 * turn2 + miss2 * turn1) / number
        dtheta = (miss1 * u2 - miss2 * u1) / number
        y, theta = y + dy, theta + dtheta
        if abs(dy) + abs(dtheta) <= CONVERGED:
            return y, theta
    return None


def _candidates(lengths: Lengths, left: float, right: float) -> Iterator[Mode]:
    """Yield approximate (y, θ) of every root of the cubic, mirrors included."""
    link1, link2, half1, half2 = lengths
    whole = half1 + half2
    rest1 = (link1 - half1) * (link1 + half1) - left * left
    rest2 = (link2 - half2) * (link2 + half2) - right * right
    alpha, beta = (half2 * rest1 + half1 * rest2) / whole, 2.0 * half1 * half2 * (
        right - left) / whole
    gamma, delta = (rest2 - rest1) / (2.0 * whole), (half2 * right + half1 * left) / whole
    even = gamma + delta
    # in u = 1 − cos θ, which keeps the digits that cos θ loses near θ = 0
    for root in _roots(-beta, 3.0 * beta + alpha + delta * delta,
                       -2.0 * (alpha + beta + delta * even), even * even):
        cosine = 1.0 - root.real
        if abs(root.imag) > _ROOT_TOLERANCE or abs(cosine) > 1.0 + _ROOT_TOLERANCE:
            continue
        cosine = max(-1.0, min(1.0, cosine))
        # y s has a known sign; its size would be lost where y vanishes, the cosine's is not
        y, sine = sqrt(max(0.0, alpha + beta * cosine)), sqrt(1.0 - cosine * cosine)
        if gamma + delta * cosine < 0.0:
            sine = -sine
        yield y, atan2(sine, cosine)
        yield -y, atan2(-sine, cosine)


def _roots(*coefficients: float) -> np.ndarray:
    """Return the roots of a polynomial; its leading coefficients may be next to nothing."""
    least = _NEGLIGIBLE * max(map(abs, coefficients))
    return np.roots([c if abs(c) > least else 0.0 for c in coefficients])


def _closes(lengths: Lengths, left: float, right: float, y: float, theta: float) -> bool:
    """Whether both links have their length."""
    _, _, u1, u2, s1, s2 = closing(lengths, left, right, y, theta)
    misses = hypot(u1, s1) - lengths.link1, hypot(u2, s2) - lengths.link2
    return max(map(abs, misses)) <= _CLOSURE_TOLERANCE * (lengths.link1 + abs(left) + abs(right))


def _same(length: float, a: Mode, b: Mode) -> bool:
    """Whether two modes are one."""
    turn = a[1] - b[1]
    return abs(a[0] - b[0]) / length + abs(sin(turn)) + abs(1.0 - cos(turn)) < _SAME_TOLERANCE
