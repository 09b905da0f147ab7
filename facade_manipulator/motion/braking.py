"""
How near two neighbouring carriages come when each stops on its own: three drives, no common brake.

The driver sends no target from which the three could not brake together and keep their gap. Drives
that stop by themselves know nothing of each other: here is what is left of the gap then, and how
far beyond the stroke they stop.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from facade_manipulator.motion.limits import MotionLimits

SPEEDS = 41  # of the search; twice as many change 0.1 mm


class Brake(NamedTuple):
    """How one carriage stops: it continues for `delay` [s], then brakes with `deceleration`."""

    delay: float
    deceleration: float


def least_distance(gap: float, limits: MotionLimits, left: Brake, right: Brake) -> float:
    """
    Return the minimum distance of neighbours that stop on their own, over all their motions.

    At any speeds up to the limit, the two are at least as far apart as lets all three
    brake together, on their path and at the limit of acceleration, with `gap` left at rest. On
    that path a carriage that moves off its neighbour first loses its acceleration, at the limit of
    jerk, and gains a²/2j of speed in that time; if it stops on its own it does not. They are
    nearest at rest: the distance that two lose until they are equally fast, two that are slower by
    that speed lose until they stand.

    Parameters
    ----------
    gap : float
        Least distance that is commanded [m].
    limits : MotionLimits
        Of what is commanded.
    left, right : Brake
        How the two stop.

    Returns
    -------
    float
        Least distance [m]; below 0 they would have to pass through each other.

    """
    speeds = np.linspace(-limits.speed, limits.speed, SPEEDS)
    start = starting_distances(gap, limits, speeds[:, None], speeds[None, :])
    way1, way2 = (
        speeds * (one.delay + np.abs(speeds) / (2.0 * one.deceleration)) for one in (left, right))
    return float(np.min(start + way2[None, :] - way1[:, None]))


def starting_distances(
    gap: float, limits: MotionLimits, left: np.ndarray, right: np.ndarray,
) -> np.ndarray:
    """Return the minimum distances [m] at which neighbours are commanded to have speeds [m/s]."""
    speed, acceleration = limits.speed, limits.acceleration
    gained = 0.5 * acceleration ** 2 / limits.jerk
    off1, off2 = left - np.minimum(gained, speed + left), right + np.minimum(gained, speed - right)
    together = np.maximum(np.abs(off1), np.abs(off2)) / (2.0 * acceleration)
    return gap + np.maximum(0.0, (off1 - off2) * together)


def overshoot(speed: float, acceleration: float, deceleration: float) -> float:
    """
    Return how far beyond the stroke a carriage may stop [m].

    It is commanded so that it could come to rest inside with the acceleration [m/s²], and brakes
    from its speed [m/s] with the deceleration [m/s²].
    """
    return max(0.0, 0.5 * speed ** 2 * (1.0 / deceleration - 1.0 / acceleration))


def highest_speed(keeps: Callable[[float], bool], speed: float) -> float:
    """Return the highest speed up to `speed` at which a condition of it holds [m/s]."""
    low, high = 0.0, speed
    if keeps(high):
        return high
    while high - low > 1e-3 * speed:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if keeps(middle) else (low, middle)
    return low
