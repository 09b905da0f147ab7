"""
Workspace metrics from exact intervals: ranges, areas, volume and share of good poses.

At fixed (y, θ) the reachable x are one interval (`kinematics.maps.x_intervals`), and neither the
conditioning index nor N depends on x. At fixed y the reachable θ are one interval about zero. With
a gap and l < b, other intervals exist beyond N = 0. Areas and volumes are therefore integrals over
y and θ of the width of the x-interval.

Rounding may put a pose at a bound outside, so callers stay inside by a margin.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry, maps
from facade_manipulator.kinematics.maps import number_at


class Good(NamedTuple):
    """Criterion for a good pose (section IV-B): minimum index, and its unit of length [m]."""

    threshold: float = 0.001
    characteristic_length: float = 0.001  # the paper's lengths are in mm


PAPER_GOOD = Good()


class Workspace(NamedTuple):
    """Volume over (x, y, θ) with both signs of θ [m² rad]; shares of it: good, beyond N = 0."""

    volume: float
    ratio: float  #: this and the next share are NaN if the workspace is empty
    beyond_share: float


def y_range(geometry: Geometry) -> tuple[float, float]:
    """Return the minimum and maximum y [m] at θ = 0 on a rail of unlimited length."""
    length = geometry.link_length
    room = geometry.platform_half_length - geometry.carriage_gap
    return sqrt(max(0.0, length * length - room * room)), length


def theta_limits(geometry: Geometry, y: np.ndarray) -> np.ndarray:
    """Return the maximum ``|θ|`` [rad] before N = 0 for every y; 0 if θ = 0 is unreachable."""
    bound = np.nan_to_num(theta_bounds(geometry, y))
    regular = number_at(geometry, y, bound) > 0.0
    # N > 0 for every θ at which no joint of the platform is behind the rail.
    inside = np.arcsin(np.minimum(1.0, y / geometry.platform_half_length))

    def number(theta: np.ndarray) -> np.ndarray:
        return number_at(geometry, y, theta)

    root = bisect(number, bound, np.minimum(bound, inside))
    return np.where(regular, bound, root)


def theta_bounds(geometry: Geometry, y: np.ndarray) -> np.ndarray:
    """
    Return the maximum ``|θ|`` [rad] from order, gap and reach for every y > 0.

    NaN where θ = 0 is not reachable. `theta_limits` also respects N = 0, which matters for links
    shorter than b.
    """
    (_, bound), _ = _theta_intervals(geometry, y)
    return np.where(bound >= 0.0, bound, np.nan)


def _theta_intervals(geometry: Geometry, y: np.ndarray) -> list[list[np.ndarray]]:
    """
    Return the intervals of θ ≥ 0 [rad] that satisfy order, gap and reach, for every y > 0.

    The order requires sin(θ + φ) ≤ h/r, so θ has an upper bound or, beyond N = 0, a lower bound.
    The second interval exists only with a gap and links shorter than b, and only where h < r.
    """
    length = geometry.link_length
    half = geometry.platform_half_length
    gap = geometry.carriage_gap

    # the end by reach, and by the gap
    reach = np.arcsin(np.clip((length - y) / half, -1.0, 1.0))
    end = np.minimum(reach, np.arccos(gap / half))

    # r, φ and h of the order
    radius = np.hypot(y, gap)
    phase = np.arctan2(gap, y)
    height = (y * y + half * half + gap * gap - length * length) / (2.0 * half)
    limit = np.arcsin(np.clip(height / radius, -1.0, 1.0))
    order = np.where(height < radius, limit - phase, np.pi)
    beyond = np.maximum(order, np.pi - limit - phase)
    return [[np.zeros_like(y), np.minimum(order, end)], [beyond, end]]


SEARCH = 2001  # samples of y for the peak of θ, then of ever shorter ranges about it


def theta_peak(geometry: Geometry) -> tuple[float, float]:
    """Return the y [m] with the largest of the `theta_limits`, and its angle [rad]."""
    y = np.linspace(*y_range(geometry), SEARCH)[1:]
    for _ in range(4):
        theta = theta_limits(geometry, y)
        best = int(np.argmax(theta))
        peak = (float(y[best]), float(theta[best]))
        before = max(best - 1, 0)
        after = min(best + 1, len(y) - 1)
        y = np.linspace(y[before], y[after], SEARCH)
    return peak


def section_bounds(geometry: Geometry, good: Good | None = None) -> tuple[float, float]:
    """
    Return minimum and maximum y [m] with a reachable x at θ = 0; equal if there is none.

    With a definition of `good`, all poses of this section are good. At θ = 0 both links have the
    projection s = √(l² − y²), and the index is a function of only τ = y²/s²::

        LCI² = 36 β² τ/((3 + 2 k τ)(4 β² τ + 2 k + 4)),  k = 1 + β²

    with b = β times the characteristic length, so LCI ≥ threshold is a quadratic inequality in τ.
    """
    half = geometry.platform_half_length
    lower, length = y_range(geometry)
    # The stroke holds the distance 2 b − 2 s of the outer carriages.
    least = max(0.0, half - 0.5 * geometry.stroke_length)
    upper = sqrt(max(0.0, length * length - least * least))
    if good is not None and good.threshold > 0.0:
        roots = _good_roots(half / good.characteristic_length, good.threshold)
        if roots is None:
            return lower, lower
        first, last = (length * sqrt(root / (1.0 + root)) for root in roots)
        lower = max(lower, first)
        upper = min(upper, last)
    return lower, max(lower, upper)


def require_section(geometry: Geometry) -> None:
    """Raise a ParameterError if the head reaches no pose at θ = 0."""
    lower, upper = section_bounds(geometry)
    if not lower < upper:
        raise ParameterError(
            f'the workspace is empty at theta = 0: stroke {geometry.stroke_length:g} m and '
            f'carriage_gap {geometry.carriage_gap:g} m leave no pose; next: set a longer stroke'
        )


def _good_roots(ratio: float, threshold: float) -> tuple[float, float] | None:
    """
    Return the τ at which the index equals the threshold; None if there is none.

    They are the roots of a τ² + b τ + c.
    """
    beta2 = ratio * ratio
    square = threshold * threshold
    k = 1.0 + beta2
    a = 8.0 * k * beta2 * square
    b = square * (12.0 * beta2 + 4.0 * k * k + 8.0 * k) - 36.0 * beta2
    c = 6.0 * square * (k + 2.0)
    discriminant = b * b - 4.0 * a * c
    if b >= 0.0 or discriminant < 0.0:
        return None
    double = sqrt(discriminant) - b
    return 2.0 * c / double, double / (2.0 * a)  # Vieta's formula loses no digits


def section_area(geometry: Geometry, good: Good | None = None) -> float:
    """Return the area within `section_bounds` at θ = 0 [m²]: ∫ (Q − 2 b + 2 √(l² − y²)) dy."""
    lower, upper = section_bounds(geometry, good)
    length = geometry.link_length

    def segment(y: float) -> float:
        """Return the integral of 2 √(l² − y²) from 0 to y."""
        ratio = y / length
        angle = ratio * sqrt(1.0 - ratio * ratio) + np.arcsin(ratio)
        return length * length * float(angle)

    width = geometry.stroke_length - 2.0 * geometry.platform_half_length
    return width * (upper - lower) + segment(upper) - segment(lower)


CELLS = 256  # of y and of θ: the ratio is exact to 1e-4, the volume to 3e-5
INSIDE_BOUND = 1.0 - 1e-12  # of a bound, where rounding must not lead beyond it


def measure(
    geometry: Geometry, good: Good = PAPER_GOOD, cells: int = CELLS
) -> Workspace:
    """
    Measure the workspace from reach, order, gap and stroke, including poses beyond N = 0.

    An index or N that passes its bound within a cell of θ divides this cell in proportion.
    """
    angle = np.linspace(0.0, 0.5 * np.pi, cells + 1)
    sums = np.zeros(3)  # volume, good and beyond
    for piece, least in enumerate((y_range(geometry)[0], 0.0)):
        y, weight = _nodes(least, geometry.link_length, cells)
        lower, upper = _theta_intervals(geometry, y)[piece]
        lower = INSIDE_BOUND * lower[:, None]
        upper = INSIDE_BOUND * upper[:, None]
        span = np.maximum(0.0, upper - lower)
        if not span.any():
            continue

        # volumes of the cells; θ = lower + span sin²
        theta = lower + span * np.sin(angle) ** 2
        length = good.characteristic_length
        at = maps.pose_map(geometry, y[:, None], theta, length)
        density = at.width * span * np.sin(2.0 * angle)
        volumes = 0.5 * (density[:, 1:] + density[:, :-1]) * angle[1]

        # With the sign of N the index is smooth where it vanishes, so that cells are divided
        # correctly there.
        index = np.copysign(at.conditioning, at.number)
        is_good = _share_above(index - good.threshold)
        is_good = is_good + _share_above(-good.threshold - index)
        is_beyond = _share_above(-at.number)
        for number, share in enumerate((np.ones_like(volumes), is_good, is_beyond)):
            sums[number] += 2.0 * weight @ (volumes * share).sum(axis=1)
    with np.errstate(invalid='ignore'):
        ratio, beyond_share = (sums[1:] / sums[0]).tolist()
    return Workspace(float(sums[0]), ratio, beyond_share)


def _share_above(values: np.ndarray) -> np.ndarray:
    """Return the share of every cell in which a value, given at the cell edges, is positive."""
    high = np.maximum(values[:, :-1], values[:, 1:])
    low = np.minimum(values[:, :-1], values[:, 1:])
    with np.errstate(invalid='ignore', divide='ignore'):
        share = np.where(high > low, high / (high - low), high > 0.0)
    return np.clip(share, 0.0, 1.0)


UNION_Y = 400  # of y, and of θ, for the union
UNION_THETA = 257


def union_area(geometry: Geometry) -> float:
    """
    Return the area of all points (x, y) that the head reaches at some θ [m²].

    At fixed y the intervals of neighbouring θ overlap. The intervals of one sign of θ form one
    interval.
    """
    y, weight = _nodes(*y_range(geometry), UNION_Y)
    theta = theta_bounds(geometry, y)[:, None] * np.linspace(0.0, 1.0, UNION_THETA)
    lower, upper = union_ends(geometry, y[:, None], theta)
    mirrored_lower, mirrored_upper = union_ends(geometry, y[:, None], -theta)
    overlap = np.minimum(upper, mirrored_upper) - np.maximum(lower, mirrored_lower)
    both = (upper - lower) + (mirrored_upper - mirrored_lower)
    width = both - np.maximum(0.0, overlap)
    return float(np.nan_to_num(width) @ weight)


def union_ends(
    geometry: Geometry, y: np.ndarray, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of the union of x-intervals over the angles of each row; NaN if empty."""
    lower, upper = maps.x_intervals(geometry, y, theta)
    return np.fmin.reduce(lower, axis=1), np.fmax.reduce(upper, axis=1)


def _nodes(lower: float, upper: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights of an integral, dense at both ends, where integrands have roots."""
    angle = 0.5 * np.pi * (np.arange(count) + 0.5) / count
    size = upper - lower
    weight = 0.5 * np.pi / count * size * np.sin(2.0 * angle)
    return lower + size * np.sin(angle) ** 2, weight


BISECTIONS = 60  # iterations from any interval to the resolution of a double


def bisect(function: Callable[[Any], Any], negative: Any, positive: Any) -> Any:
    """Return the roots of a function between negative and positive arguments by bisection."""
    for _ in range(BISECTIONS):
        middle = 0.5 * (negative + positive)
        is_above = function(middle) > 0.0
        positive = np.where(is_above, middle, positive)
        negative = np.where(is_above, negative, middle)
    return positive
