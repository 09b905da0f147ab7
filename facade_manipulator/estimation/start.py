"""The pose of the rail from the first measurements, half of which may be of something else."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import product

import numpy as np

PERIOD = 0.3  # s, of measurements by which an axis starts
PATIENCE = 1.0  # s, to wait for further sensors of the same axes
FEWEST = 4  # measurements of a sensor
# Share of them taken to be of the wall: where half are, this share is not 1 time in 6000
DENSEST = 0.2
# Standard deviations at rest, to choose between the levels of the wall:
YAW_AT_REST, Y_AT_REST, LEVEL = 0.01, 0.05, 0.5  # rad, m, m
ROUGHNESS = 3e-3  # m, by which a wall differs from a plane


class FirstMeasurements:
    """Measurements of one sensor before its axes have started."""

    def __init__(self) -> None:
        self._items: deque[tuple[float, float]] = deque()  # stamp, value

    def add(self, stamp: float, value: float) -> None:
        """Add a measurement."""
        self._items.append((stamp, value))
        while stamp - self._items[0][0] > 2.0 * PATIENCE:
            self._items.popleft()

    def span(self, now: float) -> float:
        """Return the time [s] over which enough have arrived; 0 for too few or old ones."""
        if len(self._items) < FEWEST or now - self._items[-1][0] > PATIENCE:
            return 0.0
        return self._items[-1][0] - self._items[0][0]

    def densest(self) -> float:
        """Return the newest of the values that are closest together."""
        begin = self._items[-1][0] - PERIOD
        values = [value for stamp, value in self._items if stamp >= begin]
        ordered = np.sort(values)
        count = min(max(int(DENSEST * len(ordered)), 2), len(ordered))
        first = int(np.argmin(ordered[count - 1:] - ordered[:len(ordered) - count + 1]))
        low, high = ordered[first], ordered[first + count - 1]
        return next(value for value in reversed(values) if low <= value <= high)


def start_at_wall(
    distance: float, mountings: np.ndarray, measured: Sequence[float],
    levels: Sequence[float],
) -> tuple[float, float, float]:
    """
    Return distance of the wall at rest, y and yaw [m, m, rad] by the likeliest levels.

    Parameters
    ----------
    distance : float
        Of the wall from the rail at rest [m]; 0 is unknown: the rail is then at y = 0.
    mountings, measured
        Place of each sensor on the rail, and its distance [m].
    levels
        Offsets of the levels that the sensors may see [m].

    """
    along, across = mountings[:, :2].T
    best, least = (0.0, 0.0, 0.0), np.inf
    for chosen in product(levels, repeat=len(measured)):
        ends = np.array(measured) + across - chosen
        slope, middle = (np.polyfit(along, ends, 1) if np.ptp(along) > ROUGHNESS
                         else (0.0, ends.mean()))
        y = distance - middle if distance else 0.0
        rest = ends - middle - slope * along
        cost = ((slope / YAW_AT_REST) ** 2 + (y / Y_AT_REST) ** 2 + np.sum(
            (rest / ROUGHNESS) ** 2) + np.sum((np.array(chosen) / LEVEL) ** 2))
        if cost < least:
            best, least = (float(distance or middle), float(y), -float(slope)), cost
    return best
