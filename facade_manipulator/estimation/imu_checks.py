"""Checks for IMU faults that the filter cannot detect: unit, mounting, order, swapped sides."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
import math

import numpy as np

from facade_manipulator.errors import InputError, require_recent
from facade_manipulator.estimation.estimator_settings import ImuSettings
from facade_manipulator.kinematics import GRAVITY

OLDEST_MEASUREMENT = 0.3  # s, maximum age of a measurement
SENSOR_CLOCK_TOLERANCE = 0.01  # s, maximum difference of clocks
# rad/s and m/s²; beyond these limits an IMU is saturated or broken
LARGEST_RATE = 4.0
LARGEST_FORCE = 30.0


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the rotation matrix Rz(yaw) Ry(pitch) Rx(roll) of three angles [rad]."""
    cr, cp, cy = np.cos((roll, pitch, yaw))
    sr, sp, sy = np.sin((roll, pitch, yaw))
    row_x = (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr)
    row_y = (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr)
    row_z = (-sp, cp * sr, cp * cr)
    return np.array((row_x, row_y, row_z))


class ImuGate:
    """Gate that rejects measurements impossible for an IMU on a gondola."""

    # maximum acceleration at rest [m/s²] that means an IMU with the unit g
    MOST_IN_G = 1.7
    SETTLING = 0.005  # share of a measurement in the mean acceleration
    UPRIGHT = 0.8  # minimum share of the acceleration along the rail's z: 37 degrees

    def __init__(self, settings: ImuSettings) -> None:
        self._delay = settings.delay
        self._rotation = rotation(*settings.mounting[3:]).tolist()
        self.reset()
        # mean acceleration of about the last second [m/s²]
        self._mean = [0.0, 0.0, GRAVITY]

    def reset(self) -> None:
        """Discard the newest measurement."""
        self.stamp = -math.inf  #: of the newest measurement [s]
        self.arrival = -math.inf  #: of the newest measurement [s]
        self.newest: tuple[float, ...] = ()  #: its rates and forces along the rail

    def check(
        self, now: float, stamp: float, rates: Sequence[float], forces: Sequence[float]
    ) -> tuple[float, tuple[float, ...]]:
        """
        Check a measurement; return its time [s], rates [rad/s] and forces [m/s²] in rail axes.

        Raises
        ------
        InputError
            With reason ``'not_finite'``, ``'saturated'``, ``'unit'``, ``'mounting'``,
            ``'stale'``, ``'future'`` or ``'out_of_order'``.

        """
        for value in (*rates, *forces):
            if not math.isfinite(value):
                raise InputError.not_finite('imu', value)
        stamp -= self._delay
        require_recent('imu', now - stamp, OLDEST_MEASUREMENT, SENSOR_CLOCK_TOLERANCE)
        if stamp <= self.stamp:
            raise InputError.out_of_order('imu', self.stamp - stamp)

        turned = self._along_rail(rates)
        forced = self._along_rail(forces)
        rate = max(map(abs, rates))
        self._require_below('turning rate', rate, LARGEST_RATE, 'rad/s')
        self._require_below('acceleration', math.hypot(*forces), LARGEST_FORCE, 'm/s^2')
        # after the limits, because one impossible measurement would dominate the mean for seconds
        self._update_mean(forced)
        self._require_upright()
        self.stamp = stamp
        self.arrival = now
        self.newest = (*turned, *forced)
        return stamp, self.newest

    def _along_rail(self, values: Sequence[float]) -> list[float]:
        """Transform a vector from the axes of the IMU to those of the rail."""
        x, y, z = values
        return [a * x + b * y + c * z for a, b, c in self._rotation]

    def _update_mean(self, forced: Sequence[float]) -> None:
        """Update the mean acceleration with an acceleration in the rail's axes."""
        means = []
        for mean, force in zip(self._mean, forced, strict=True):
            means.append(mean + self.SETTLING * (force - mean))
        self._mean = means

    @staticmethod
    def _require_below(name: str, value: float, bound: float, unit: str) -> None:
        if value >= bound:
            raise InputError(
                'saturated',
                f'imu rejected: {name} = {value:.3g} {unit} is not '
                f'below the limit {bound:g} {unit}; next: check range and unit of the imu',
            )

    def _require_upright(self) -> None:
        """Require that the mean acceleration is gravity along the rail's z."""
        upwards = self._mean[2]
        whole = math.hypot(*self._mean)
        if whole < self.MOST_IN_G:
            raise InputError(
                'unit',
                f'imu rejected: mean acceleration = {whole:.3g} m/s^2, expected about '
                f'{GRAVITY} m/s^2; next: publish accelerations in m/s^2 and with gravity',
            )
        if upwards < self.UPRIGHT * whole:
            raise InputError(
                'mounting',
                f"imu rejected: acceleration along the rail's z = {upwards:.3g} m/s^2 "
                f'of {whole:.3g} m/s^2; next: correct roll and pitch of imu.mounting',
            )


class YawComparison:
    """
    Comparison of the yaw from two distances with the integrated gyroscope rate.

    With swapped distance sensors, or rates in degrees, the filter gives plausible wrong estimates.
    """

    SHORTEST_BASELINE = 0.1  # m, minimum between two distance sensors to measure yaw
    # s, maximum between their stamps: the last distance of a silent sensor is out of date
    LONGEST_OFFSET = 0.2
    WINDOW = 0.5  # s, of a compared turn
    WINDOWS = 24  # number of the compared turns
    FEWEST_TURNS = 10  # minimum number of them
    TURNED = 2e-3  # rad, minimum standard deviation of the turns to compare
    CORRELATED = 0.8  # squared correlation of the turns that shows a fault
    # maximum ratio of distance turns to gyroscope turns that means swapped sides
    SWAPPED = -0.4
    # minimum and maximum ratio that mean degrees
    DEGREES = (0.6 * math.pi / 180.0, 1.6 * math.pi / 180.0)

    def __init__(self) -> None:
        self.turned = 0.0  #: integral of the gyroscope's yaw rate [rad]
        # stamp, this integral and yaw by the distances
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=self.WINDOWS)
        # stamps and distances by places along the rail
        self._newest: dict[float, tuple[float, float]] = {}

    def add_distance(self, place: float, stamp: float, distance: float) -> str:
        """Add a distance [m] measured at a position along the rail [m]; return a fault, if any."""
        self._newest[place] = (stamp, distance)
        left = min(self._newest)
        right = max(self._newest)
        if right - left < self.SHORTEST_BASELINE:
            return ''
        if self._samples and stamp - self._samples[-1][0] < self.WINDOW:
            return ''

        left_stamp, left_distance = self._newest[left]
        right_stamp, right_distance = self._newest[right]
        if abs(left_stamp - right_stamp) > self.LONGEST_OFFSET:
            return ''
        yaw = (left_distance - right_distance) / (right - left)
        self._samples.append((stamp, self.turned, yaw))
        if len(self._samples) < self.FEWEST_TURNS:
            return ''

        # regression of the turns by the distances on the turns by the gyroscope
        _, *turns = np.diff(self._samples, axis=0).T
        (variance, common), (_, other) = np.cov(turns)
        if variance < self.TURNED**2 or common**2 < self.CORRELATED * variance * other:
            return ''
        ratio = common / variance  # independent of the gyroscope's bias
        if ratio < self.SWAPPED:
            return (
                'the yaw of the distances is opposite to that of the imu; next: swap left and '
                'right, or correct imu.mounting'
            )
        if self.DEGREES[0] < abs(ratio) < self.DEGREES[1]:
            return (
                'the imu turns 57 times as far as the distances show; next: publish angular rates '
                'in rad/s, not in degrees per second'
            )
        return ''
