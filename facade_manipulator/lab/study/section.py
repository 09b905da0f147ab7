"""
The section θ = 0 of the workspace in closed form, for one design or for arrays of them.

There both links have the projection s = √(l² − y²), the x-interval the width Q − 2 b + 2 s, and
the conditioning index is a function of τ = y²/s² alone::

    LCI² = 36 β² τ/((3 + 2 k τ)(4 β² τ + 2 k + 4)),  β = b over the characteristic length,
    k = 1 + β²,

so LCI ≥ t is a quadratic inequality in τ.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from facade_manipulator.kinematics import Geometry

Bounds = tuple[Any, Any]


class Designs(NamedTuple):
    """The lengths of many designs [m]: arrays of one shape, or a number for all of them."""

    link_length: Any
    platform_half_length: Any
    stroke_length: Any
    carriage_gap: Any


Lengths = Geometry | Designs


def section_bounds(
    of: Lengths, threshold: float = 0.0, characteristic_length: float = 1.0
) -> Bounds:
    """
    Return the y at which any x is reachable at θ = 0; lower = upper where there is none [m].

    The index there is `threshold` at least, of which the characteristic length [m] is the unit.
    """
    length, half = of.link_length, of.platform_half_length
    room = half - of.carriage_gap
    lower = np.sqrt(np.maximum(0.0, length * length - room * room))
    # The stroke holds the outer carriages' distance 2 b − 2 s.
    least = np.maximum(0.0, half - 0.5 * of.stroke_length)
    upper = np.sqrt(np.maximum(0.0, length * length - least * least))
    if threshold > 0.0:
        good_lower, good_upper = _good_bounds(length, half, threshold, characteristic_length)
        lower = np.fmax(lower, good_lower)
        upper = np.where(np.isnan(good_upper), lower, np.minimum(upper, good_upper))
    return lower, np.maximum(lower, upper)


def _good_bounds(
    length: Any, half: Any, threshold: float, characteristic_length: float
) -> Bounds:
    """
    Return the y at which the conditioning index reaches `threshold` at θ = 0 [m].

    Both ends are NaN where it does at no y.
    """
    beta2 = (half / characteristic_length) ** 2
    k = 1.0 + beta2
    square = threshold * threshold
    a = 8.0 * k * beta2 * square
    b = square * (12.0 * beta2 + 4.0 * k * k + 8.0 * k) - 36.0 * beta2
    c = 6.0 * square * (k + 2.0)
    with np.errstate(invalid='ignore', divide='ignore'):
        discriminant = b * b - 4.0 * a * c
        double = np.where(b < 0.0, np.sqrt(discriminant) - b, np.nan)
        lower, upper = 2.0 * c / double, double / (2.0 * a)  # Vieta: no digits are lost
        # 1/(1 + 1/τ) for the upper end, which is infinite where every y is good enough
        return length * np.sqrt(lower / (1.0 + lower)), length / np.sqrt(1.0 + 1.0 / upper)


def section_area(
    of: Lengths, threshold: float = 0.0, characteristic_length: float = 1.0
) -> Any:
    """Area between `section_bounds` at θ = 0 [m²]: ∫ (Q − 2 b + 2 √(l² − y²)) dy."""
    lower, upper = section_bounds(of, threshold, characteristic_length)
    return ((of.stroke_length - 2.0 * of.platform_half_length) * (upper - lower)
            + segment(of.link_length, upper) - segment(of.link_length, lower))


def segment(length: Any, y: Any) -> Any:
    """∫ 2 √(l² − y²) dy [m²]."""
    ratio = np.clip(y / length, -1.0, 1.0)
    return length * length * (ratio * np.sqrt(1.0 - ratio * ratio) + np.arcsin(ratio))
