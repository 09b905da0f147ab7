"""Start of the filter: the rail's pose from first measurements with up to half outliers."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import product
import math

import numpy as np

LONGEST_START = 1.0  # s, maximum wait for further sensors of the same axes


class FirstMeasurements:
    """Newest measurements of one sensor before its axes have started."""

    START_TIME = 0.3  # s, duration of the measurements that start an axis
    FEWEST_MEASUREMENTS = 4  # minimum number of measurements of a sensor
    # Share of measurements used: if half are of the wall, the others win 1 time in 6000
    DENSEST = 0.2

    def __init__(self) -> None:
        self.begin = math.inf  #: stamp of the first measurement after a silence [s]
        self._items: deque[tuple[float, float]] = deque()  # stamp, value

    def add(self, stamp: float, value: float) -> None:
        """Add a measurement [m or rad] with its stamp [s]."""
        if self._items and stamp - self._items[-1][0] > LONGEST_START:
            self._items.clear()
        if not self._items:
            self.begin = stamp
        self._items.append((stamp, value))
        while (
            len(self._items) > self.FEWEST_MEASUREMENTS
            and stamp - self._items[0][0] > self.START_TIME
        ):
            self._items.popleft()

    def suffice(self, now: float) -> bool:
        """Return whether enough measurements, including recent ones, exist at a time [s]."""
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


# Standard deviations at rest, which choose among the levels of the wall:
YAW_AT_REST = 0.01  # rad
Y_AT_REST = 0.05  # m
LEVEL_AT_REST = 0.5  # m
ROUGHNESS = 3e-3  # m, standard deviation of a wall from a plane


def start_at_wall(
    distance: float,
    mountings: np.ndarray,
    measured: Sequence[float],
    levels: Sequence[float],
) -> tuple[float, float, float]:
    """
    Return distance of the wall at rest, y and yaw [m, m, rad] for the likeliest levels.

    Parameters
    ----------
    distance : float
        Distance of the wall from the rail at rest [m]; 0 is unknown, and the rail is then at y =
        0.
    mountings, measured
        Place of each sensor on the rail, and its measured distance [m].
    levels
        Offsets of the levels that the sensors may see [m].

    """
    along, across = mountings[:, :2].T
    candidates = []
    for chosen in product(levels, repeat=len(measured)):
        # the wall through the measured points is a line: middle + slope times the place
        ends = np.array(measured) + across - chosen
        slope = 0.0
        middle = ends.mean()
        if np.ptp(along) > ROUGHNESS:
            slope, middle = np.polyfit(along, ends, 1)
        y = distance - middle if distance else 0.0
        rest = ends - middle - slope * along

        cost = (slope / YAW_AT_REST) ** 2
        cost += (y / Y_AT_REST) ** 2
        cost += np.sum((rest / ROUGHNESS) ** 2)
        cost += np.sum((np.array(chosen) / LEVEL_AT_REST) ** 2)
        candidates.append((cost, float(distance or middle), float(y), -float(slope)))
    _, distance, y, yaw = min(candidates)
    return distance, y, yaw
