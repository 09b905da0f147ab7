"""
The closure of links that may be unlike: residuals, and Newton's method on them.

The platform's middle joint P slides above A3. With p = q1 − q3 and r = q2 − q3, the heights
u1 = y − b1 s and u2 = y + b2 s and the projections s1 = p + b1 c and s2 = b2 c − r, the links
close where s1² + u1² = l1² and s2² + u2² = l2². On a rail that is bent (`Bend`) y counts from A3,
A1 and A2 stand higher by d1 and d2, and P is off by −y k: u1 = y − b1 s − d1, s1 = p + y k + b1 c.
"""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

from facade_manipulator.kinematics.inverse import Links

CONVERGED = 1e-8  # m or rad: such a Newton step leaves its square
STEPS = 20

Mode = tuple[float, float]  # y and θ of the platform


class Lengths(NamedTuple):
    """Lengths of the links and of the platform's halves, on the sides of A1 and of A2 [m]."""

    link1: float
    link2: float
    half1: float
    half2: float


class Bend(NamedTuple):
    """How much higher than A3 on the rail A1 and A2 stand [m], and the lean of the slide on A3."""

    above1: float = 0.0
    above2: float = 0.0
    lean: float = 0.0


def closing(
    lengths: Lengths, left: float, right: float, y: float, theta: float, bend: Bend
) -> Links:
    """Return the links of carriages and a pose, whether they have their lengths or not."""
    _, _, half1, half2 = lengths
    sine, cosine, off = sin(theta), cos(theta), y * bend.lean
    return (sine, cosine, y - half1 * sine - bend.above1, y + half2 * sine - bend.above2,
            left + off + half1 * cosine, half2 * cosine - right - off)


def newton(
    lengths: Lengths, left: float, right: float, y: float, theta: float, bend: Bend
) -> Mode | None:
    """Return where Newton's method on the closure converges; None if it does not."""
    link1, link2, half1, half2 = lengths
    for _ in range(STEPS):
        sine, cosine, u1, u2, s1, s2 = closing(lengths, left, right, y, theta, bend)
        rise1, rise2 = u1 + bend.lean * s1, u2 - bend.lean * s2  # half of what y changes
        turn1, turn2 = half1 * (u1 * cosine + s1 * sine), half2 * (u2 * cosine - s2 * sine)
        number = 2.0 * (rise1 * turn2 + rise2 * turn1)
        if number == 0.0:
            return None
        miss1, miss2 = s1 * s1 + u1 * u1 - link1 * link1, s2 * s2 + u2 * u2 - link2 * link2
        dy = -(miss1 * turn2 + miss2 * turn1) / number
        dtheta = (miss1 * rise2 - miss2 * rise1) / number
        y, theta = y + dy, theta + dtheta
        if abs(dy) + abs(dtheta) <= CONVERGED:
            return y, theta
    return None
