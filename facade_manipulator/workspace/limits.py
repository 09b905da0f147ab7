"""
How far the head can go: exact limits of x, y and θ, without a grid.

At fixed (y, θ) the reachable x are one interval; at fixed y the reachable θ are one interval about
zero. Order and gap of the carriages, reach and the singularity N = 0 bound them; the stroke bounds
x alone. The bounds belong to a limit themselves: stay inside by a margin.
"""

from __future__ import annotations

from collections.abc import Callable
from math import acos, asin, atan2, cos, hypot, isfinite, sin, sqrt
from typing import NamedTuple

from facade_manipulator.errors import CarriageGapError, StrokeLimitError, UnreachableError
from facade_manipulator.kinematics import branch_number, Geometry, links, not_finite, Pose

_BISECTIONS = 60
_SAMPLES = 64


class Interval(NamedTuple):
    """A closed interval."""

    lower: float
    upper: float


def x_interval(geometry: Geometry, y: float, theta: float = 0.0) -> Interval:
    """
    Positions x along the rail at which the outer carriages stay on the stroke [m].

    Raises
    ------
    UnreachableError
        If a link is too short for (y, θ).
    StrokeLimitError
        If the stroke is too short for (y, θ) at any x.

    """
    _, cosine, _, _, projection1, projection2 = links(geometry, Pose(0.0, y, theta))
    span = geometry.platform_half_length * cosine
    least, greatest = geometry.stroke
    lower, upper = least + span - projection1, greatest - span + projection2
    if lower > upper:
        raise StrokeLimitError(
            'q2 - q1', greatest - least + lower - upper, greatest - least, 'm', 'above')
    return Interval(lower, upper)


def y_range(geometry: Geometry, theta: float = 0.0) -> Interval:
    """
    Distances y from the rail that are reachable at the angle θ, the stroke apart [m].

    With l < b a second, lower piece exists at some θ; this is the piece towards the façade.

    Raises
    ------
    ParameterError
        If the argument is not finite (a ValueError).
    CarriageGapError, UnreachableError
        If no y is reachable at θ.

    """
    if not isfinite(theta):
        raise not_finite(Pose(0.0, 0.0, theta))
    length, half = geometry.link_length, geometry.platform_half_length
    rise = half * abs(sin(theta))
    room = half * cos(theta) - geometry.carriage_gap
    if room < 0.0:
        raise CarriageGapError(
            'b cos(theta)', half * cos(theta), geometry.carriage_gap, 'm', 'below')
    upper = length - rise
    if room < length:
        lower = rise + sqrt(length * length - room * room)
    else:
        lower, upper = _regular_y(geometry, theta, upper)
    if lower >= upper:
        raise UnreachableError('least |y| + b |sin theta|', lower + rise, length, 'm', 'not below')
    return Interval(lower, upper)


def theta_max(geometry: Geometry, y: float) -> float:
    """
    Greatest |θ| at the distance y from the rail, the stroke apart [rad].

    Raises
    ------
    ParameterError
        If the argument is not finite (a ValueError).
    CarriageGapError, UnreachableError
        If y is not reachable at θ = 0.

    """
    if not isfinite(y):
        raise not_finite(Pose(0.0, y, 0.0))
    lower, upper = y_range(geometry)
    if y < lower:
        raise CarriageGapError('y', y, lower, 'm', 'below')
    if y >= upper:
        raise UnreachableError('y', y, upper, 'm', 'not below')
    bound = min(_order_angle(geometry, y), _reach_angle(geometry, y))
    start = asin(min(1.0, y / geometry.platform_half_length))
    if bound <= start or _number(geometry, y, bound) > 0.0:
        return bound  # N > 0 wherever both B stand in front of the rail
    return _bisect(lambda theta: _number(geometry, y, theta), bound, start)


def _reach_angle(geometry: Geometry, y: float) -> float:
    return asin(min(1.0, (geometry.link_length - y) / geometry.platform_half_length))


def _order_angle(geometry: Geometry, y: float) -> float:
    """
    Greatest θ with s1 ≤ b c − m.

    Squared, with y s + m c = ρ sin(θ + φ): ρ sin(θ + φ) ≤ (y² + b² + m² − l²)/(2 b).
    """
    half, gap = geometry.platform_half_length, geometry.carriage_gap
    radius, phase = hypot(y, gap), atan2(gap, y)
    height = (y * y + half * half + gap * gap - geometry.link_length ** 2) / (2.0 * half)
    upright = acos(gap / half)
    if height >= radius:
        return upright
    return min(upright, max(0.0, asin(height / radius) - phase))


def _regular_y(geometry: Geometry, theta: float, edge: float) -> Interval:
    """Return where N > 0 below the far edge, for links so short that they never cross."""
    rise = geometry.platform_half_length * abs(sin(theta))
    if rise <= edge:
        # N > 0 from the platform's rise upwards: both joints B are in front of the rail.
        return Interval(_bisect(lambda y: _number(geometry, y, theta), 0.0, rise), edge)
    samples = [edge * k / _SAMPLES for k in range(_SAMPLES + 1)]
    best = max(samples, key=lambda y: _number(geometry, y, theta))
    if _number(geometry, best, theta) <= 0.0:
        return Interval(edge, edge)
    lower = _bisect(lambda y: _number(geometry, y, theta), 0.0, best)
    if _number(geometry, edge, theta) > 0.0:
        return Interval(lower, edge)
    return Interval(lower, _bisect(lambda y: _number(geometry, y, theta), edge, best))


def _number(geometry: Geometry, y: float, theta: float) -> float:
    """Return N [m²] for θ ≥ 0, the far edge included."""
    square = geometry.link_length ** 2
    sine, cosine = abs(sin(theta)), cos(theta)
    u1 = y - geometry.platform_half_length * sine
    u2 = y + geometry.platform_half_length * sine
    s1, s2 = (sqrt(max(0.0, square - height * height)) for height in (u1, u2))
    return branch_number((sine, cosine, u1, u2, s1, s2))


def _bisect(function: Callable[[float], float], negative: float, positive: float) -> float:
    """Return the root between two arguments, on its positive side."""
    for _ in range(_BISECTIONS):
        middle = 0.5 * (negative + positive)
        if function(middle) > 0.0:
            positive = middle
        else:
            negative = middle
    return positive
