"""Where the rail is by the first measurements, of which half may be of something else."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

PERIOD, PATIENCE = 0.3, 1.0  # s: of the measurements that are looked at, and for a second sensor
FEWEST = 4  # measurements of a sensor
DENSEST = 0.2  # share of them taken to be of the wall: where half see it, fewer do 1 in 6000 times
# What is likely at rest, to choose between the levels that sensors may look at:
LIKELY_YAW, LIKELY_Y, LIKELY_LEVEL = 0.01, 0.05, 0.5  # rad, m, m
ROUGHNESS = 3e-3  # m, by which a wall is no line


class WallStart(NamedTuple):
    """Where the rail is: distance of the wall at rest, y and yaw; how far off that is from it."""

    distance: float
    y: float
    yaw: float
    cost: float


def densest(values: Sequence[float]) -> float:
    """Return the newest of those values that are closest together."""
    ordered = np.sort(values)
    count = min(max(int(DENSEST * len(ordered)), 2), len(ordered))
    begin = int(np.argmin(ordered[count - 1:] - ordered[:len(ordered) - count + 1]))
    low, high = ordered[begin], ordered[begin + count - 1]
    return next(value for value in reversed(values) if low <= value <= high)


def start_at_wall(
    distance: float, mountings: Sequence[Sequence[float]], measured: Sequence[float],
    levels: Sequence[float],
) -> WallStart:
    """
    Return where the rail is by distances; of all levels they may be of, by the likeliest.

    By the distance of the wall from the rail at rest [m], 0 if it is not known, by where each
    sensor is on the rail and what it measures, and by how much farther the wall may be there [m].
    """
    places = np.array(mountings)[:, :2]
    return min((
        _fit(distance, places, np.array(measured) - np.array(chosen), chosen)
        for chosen in product(levels, repeat=len(measured))), key=lambda start: start.cost)


def _fit(
    distance: float, places: np.ndarray, measured: np.ndarray, levels: Sequence[float]
) -> WallStart:
    """Return the fit of a line through what was measured, the levels taken off."""
    along, across = places.T
    apart = along - along.mean()
    ends = measured + across
    width = float(apart @ apart)
    yaw = -float(apart @ ends) / width if width > ROUGHNESS ** 2 else 0.0
    rest = ends - ends.mean() + yaw * apart
    middle = float(ends.mean()) + yaw * float(along.mean())
    y = distance - middle if distance else 0.0
    cost = (yaw / LIKELY_YAW) ** 2 + (y / LIKELY_Y) ** 2 + float(
        rest @ rest) / ROUGHNESS ** 2 + sum((level / LIKELY_LEVEL) ** 2 for level in levels)
    return WallStart(distance or middle, y, yaw, cost)
