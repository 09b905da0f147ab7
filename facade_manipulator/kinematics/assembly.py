"""Assembly modes: every pose in which the links can be joined to three carriages."""

from __future__ import annotations

from math import atan2, cos, hypot, isfinite, sin, sqrt

import numpy as np

from facade_manipulator.errors import SingularityError
from facade_manipulator.kinematics.closure import cubic, FARTHEST, newton_step
from facade_manipulator.kinematics.geometry import Carriages, Geometry, not_finite, Pose

_ROOT_TOLERANCE = 1e-6  # on the imaginary part and on cos θ: double roots split by √eps
_CLOSURE_TOLERANCE = 1e-10  # of the lengths: decides which candidate is real
_SAME_TOLERANCE = 1e-7  # of y/l and θ: two candidates that are one mode
_POLISH_STEPS = 4
_NEGLIGIBLE = 1e-30  # of the greatest coefficient: its root lies far beyond |cos θ| = 1


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
    left, right = q1 - q3, q2 - q3
    modes: list[Pose] = []
    if max(abs(left), abs(right)) > FARTHEST:
        return modes
    for y, theta in _candidates(geometry, left, right):
        y, theta = _polish(geometry, left, right, y, theta)
        if _closes(geometry, left, right, y, theta) and not _contains(geometry, modes, y, theta):
            modes.append(Pose(q3, y, theta))
    return sorted(modes, key=lambda mode: (-mode.y, abs(mode.theta)))


def _candidates(geometry: Geometry, left: float, right: float) -> list[tuple[float, float]]:
    """Return approximate (y, θ) of every root of the cubic, mirrors included."""
    f0, f1, f2, f3, square = cubic(geometry, left, right)
    half = geometry.platform_half_length
    found = []
    for root in _roots(-f3, f2, -f1, f0):
        cosine = 1.0 - root.real
        if abs(root.imag) > _ROOT_TOLERANCE or abs(cosine) > 1.0 + _ROOT_TOLERANCE:
            continue
        cosine = max(-1.0, min(1.0, cosine))
        y = sqrt(max(0.0, square - f3 * (1.0 - cosine)))
        # y s has a known sign; its size would be lost where y vanishes, the cosine's is not.
        sine = sqrt(1.0 - cosine * cosine)
        if (left + right) * (2.0 * half * cosine - right + left) < 0.0:
            sine = -sine
        found += [(y, atan2(sine, cosine)), (-y, atan2(-sine, cosine))]
    return found


def _roots(*coefficients: float) -> np.ndarray:
    """Return the roots of a polynomial; its leading coefficients may be next to nothing."""
    least = _NEGLIGIBLE * max(map(abs, coefficients))
    return np.roots([c if abs(c) > least else 0.0 for c in coefficients])


def _polish(
    geometry: Geometry, left: float, right: float, y: float, theta: float
) -> tuple[float, float]:
    """Newton steps on the closure; a singular mode is left as the cubic gave it."""
    for _ in range(_POLISH_STEPS):
        try:
            dy, dtheta = newton_step(geometry, left, right, y, sin(theta), cos(theta))
        except SingularityError:
            break
        if abs(dy) + abs(dtheta) > 0.1:
            break
        y, theta = y + dy, theta + dtheta
    return y, theta


def _closes(geometry: Geometry, left: float, right: float, y: float, theta: float) -> bool:
    """Whether both links have their length."""
    length = geometry.link_length
    span = geometry.platform_half_length * cos(theta)
    rise = geometry.platform_half_length * sin(theta)
    errors = (hypot(left + span, y - rise) - length, hypot(span - right, y + rise) - length)
    return max(map(abs, errors)) <= _CLOSURE_TOLERANCE * (length + abs(left) + abs(right))


def _contains(geometry: Geometry, modes: list[Pose], y: float, theta: float) -> bool:
    """Whether (y, θ) repeats a mode already found."""
    for mode in modes:
        turn = theta - mode.theta
        apart = abs(y - mode.y) / geometry.link_length + abs(sin(turn)) + abs(1.0 - cos(turn))
        if apart < _SAME_TOLERANCE:
            return True
    return False
