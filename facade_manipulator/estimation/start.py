"""Start of the filter: compute the rail's pose from measurements with up to 50 % outliers."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import product
import math

import numpy as np

LONGEST_START = 1.0  # s, maximum wait for further sensors of the same axes


class FirstMeasurements:
    """Newest measurements of one sensor while its axes have not started."""

    START_TIME = 0.3  # s, duration of the measurements that start an axis
    FEWEST_MEASUREMENTS = 4  # minimum number of measurements of a sensor
    # Share of measurements used; if half are of the wall, the outliers win 1 time in 6000
    DENSEST = 0.2

    def __init__(self) -> None:
        self.begin = math.inf  #: stamp of the first measurement after a silence [s]
        self._items: deque[tuple[float, float]] = deque()  # stamp, value
        self.variance = 0.0  #: largest variance of the measurements [m² or rad²]

    def add(self, stamp: float, value: float, variance: float = 0.0) -> None:
        """Add a measurement [m or rad] with its stamp [s] and its variance [m² or rad²]."""
        if self._items and stamp - self._items[-1][0] > LONGEST_START:
            self._items.clear()
        if not self._items:
            self.begin = stamp
            self.variance = 0.0
        self.variance = max(self.variance, variance)
        self._items.append((stamp, value))
        while (
            len(self._items) > self.FEWEST_MEASUREMENTS
            and stamp - self._items[0][0] > self.START_TIME
        ):
            self._items.popleft()

    def suffice(self, now: float) -> bool:
        """Return whether the measurements are sufficient in number and age at a time [s]."""
        if len(self._items) < self.FEWEST_MEASUREMENTS:
            return False
        newest, _ = self._items[-1]
        return newest > max(self.begin + self.START_TIME, now - LONGEST_START)

    def densest(self) -> float:
        """Return the newest value of the densest cluster [m or rad]."""
        values = np.array([value for _, value in self._items])
        ordered = np.sort(values)
        count = max(int(self.DENSEST * len(values)), 2)
        spans = ordered[count - 1 :] - ordered[: 1 - count]
        first = int(np.argmin(spans))
        last = first + count - 1
        is_close = (ordered[first] <= values) & (values <= ordered[last])
        return float(values[is_close][-1])


# Standard deviations of a rail at rest, which choose among the levels of the wall:
YAW_AT_REST = 0.01  # rad
Y_AT_REST = 0.05  # m
LEVEL_AT_REST = 0.5  # m
ROUGHNESS = 3e-3  # m, standard deviation of a wall from a plane
# m, distance of the sensors along the rail above which their distances show the yaw
LEAST_BASELINE = 3e-3


def start_at_wall(
    distance: float,
    mountings: np.ndarray,
    measured: Sequence[float],
    levels: Sequence[float],
    y: float = 0.0,
    yaw: float = 0.0,
) -> tuple[float, float, float]:
    """
    Return wall distance, y and yaw of the rail [m, m, rad] for the most likely levels.

    A level is the offset of a part of the wall, such as a recess; each sensor may see another.
    Each combination of levels gives a line through the measured points of the wall. The likeliest
    combination has a plane wall, a rail near its place at rest, and levels near 0.

    Parameters
    ----------
    distance : float
        Distance of the wall from the rail at rest [m]. For 0 it is unknown, and the returned
        distance is that of the line.
    mountings : array of shape (n, 3)
        Places of the sensors from the middle of the rail: x along the rail, y towards the wall,
        z up [m].
    measured : sequence of n numbers
        Distance that each sensor measures [m].
    levels : sequence of float
        Offsets of the parts of the wall that the sensors may see [m]; a part with a positive
        offset is behind the wall.
    y : float
        Place of the rail [m], used if the distance of the wall is unknown.
    yaw : float
        Yaw of the rail [rad], used if the sensors are too close together to show it.

    """
    along, across = mountings[:, :2].T
    candidates = []
    for chosen in product(levels, repeat=len(measured)):
        # the wall through the measured points is a line: middle + slope times the place
        points = np.array(measured) + across - chosen
        slope = -yaw
        middle = (points - slope * along).mean()
        if np.ptp(along) > LEAST_BASELINE:
            slope, middle = np.polyfit(along, points, 1)
        place = distance - middle if distance else y
        residuals = points - middle - slope * along

        cost = (slope / YAW_AT_REST) ** 2
        cost += (place / Y_AT_REST) ** 2
        cost += np.sum((residuals / ROUGHNESS) ** 2)
        cost += np.sum((np.array(chosen) / LEVEL_AT_REST) ** 2)
        candidates.append((cost, float(middle + place), float(place), -float(slope)))
    _, distance, y, yaw = min(candidates)
    return distance, y, yaw
