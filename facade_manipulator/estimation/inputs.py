"""What the inertial sensor says, along the axes of the rail; no filter shows its errors."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
import math

import numpy as np

from facade_manipulator.errors import InputError, require_recent
from facade_manipulator.estimation.settings import ImuSettings
from facade_manipulator.kinematics import GRAVITY

LEAST_IN_G, MOST_IN_G = 0.3, 1.7  # m/s² that a sensor at rest measures if its unit is g
SETTLING = 0.005  # of that mean at each measurement
UPRIGHT = 0.8  # share of the acceleration that is along the rail's z at least: 37 degrees
OLDEST, LEAD = 0.3, 0.01  # s: older than the history, and how far clocks may be apart
SHORTEST = 0.1  # m, between two distances that show a yaw
WINDOW, WINDOWS = 0.5, 24  # s and number: over which yaws of distances and gyroscope are compared
TURNED, PAIRS = 3e-3, 30  # rad: two windows whose turns differ by it are a pair, so many decide
SPREAD = 0.3  # of the ratios, between their quartiles: beyond it they mean nothing
SWAPPED, DEGREES = -0.4, (0.6 * math.pi / 180.0, 1.6 * math.pi / 180.0)  # distances : gyroscope


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the matrix from the axes of what is turned so to those it is turned in."""
    (cr, cp, cy), (sr, sp, sy) = np.cos((roll, pitch, yaw)), np.sin((roll, pitch, yaw))
    return np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr]])


class ImuGate:
    """Let through what an inertial sensor can have measured."""

    def __init__(self, settings: ImuSettings) -> None:
        self._settings = settings
        self._turn = rotation(*settings.mounting[3:]).tolist()
        self.stamp = -math.inf  #: of the newest measurement [s]
        self._mean = [0.0, 0.0, GRAVITY]  # accelerations of the last second or so

    def check(
        self, now: float, stamp: float, rates: Sequence[float], forces: Sequence[float]
    ) -> tuple[float, tuple[float, float, float], tuple[float, float, float]]:
        """
        Return when it was measured [s], turning rates and accelerations along the rail's axes.

        Raises
        ------
        InputError
            With reason ``'not_finite'``, ``'saturated'``, ``'unit'``, ``'mounting'``,
            ``'stale'``, ``'future'`` or ``'out_of_order'``.

        """
        if wrong := [value for value in (*rates, *forces) if not math.isfinite(value)]:
            raise InputError.not_finite('imu', wrong[0])
        stamp -= self._settings.delay
        require_recent('imu', now - stamp, OLDEST, LEAD)
        if stamp <= self.stamp:
            raise InputError.out_of_order('imu', self.stamp - stamp)
        turned, forced = self._turned(rates), self._turned(forces)
        self._mean = [mean + SETTLING * (force - mean)
                      for mean, force in zip(self._mean, forced, strict=True)]
        self._check_size(max(map(abs, rates)), math.hypot(*forces))
        self._check_gravity()
        self.stamp = stamp
        return stamp, turned, forced

    def _turned(self, vector: Sequence[float]) -> tuple[float, float, float]:
        x, y, z = vector
        one, two, three = (a * x + b * y + c * z for a, b, c in self._turn)
        return one, two, three

    def _check_size(self, rate: float, force: float) -> None:
        settings = self._settings
        if rate >= settings.largest_rate:
            raise InputError('saturated', f'imu turns at {rate:.3g} rad/s, bound '
                             f'{settings.largest_rate:g} rad/s (imu.largest_rate)')
        if force >= settings.largest_acceleration:
            raise InputError('saturated', f'imu accelerates by {force:.3g} m/s^2, bound '
                             f'{settings.largest_acceleration:g} m/s^2 (imu.largest_acceleration)')

    def _check_gravity(self) -> None:
        """Check what is left of the accelerations in the mean."""
        upwards, whole = self._mean[2], math.hypot(*self._mean)
        if whole < MOST_IN_G:
            wrong = ('its unit seems to be g' if whole > LEAST_IN_G else
                     'gravity seems to be taken out of it')
            raise InputError('unit', f'imu measures {whole:.3g} m/s^2 in all, expected {GRAVITY} '
                             f'm/s^2 about: {wrong}')
        if upwards < UPRIGHT * whole:
            raise InputError(
                'mounting', f"imu measures {upwards:.3g} m/s^2 along the rail's z of "
                f'{whole:.3g} m/s^2 in all: roll and pitch of imu.mounting are wrong')


class YawComparison:
    """
    Compare the yaw of two distances with that of the gyroscope.

    Sensors of the left and the right in each other's place, or rates in degrees, make a filter
    that is wrong and does not show it.
    """

    def __init__(self) -> None:
        self._turns: deque[tuple[float, float]] = deque(maxlen=WINDOWS)
        self._begin: tuple[float, float] | None = None
        self._turned = 0.0
        self._newest: dict[float, float] = {}

    def add_rate(self, rate: float, step: float) -> None:
        """Add a turning rate [rad/s] that lasted for a time [s]."""
        self._turned += rate * step

    def add_distance(self, place: float, stamp: float, distance: float) -> str:
        """Add a distance [m] at a place along the rail [m]; return what is wrong, if anything."""
        self._newest[place] = distance
        left, right = min(self._newest), max(self._newest)
        if right - left < SHORTEST or (
                self._begin is not None and 0.0 <= stamp - self._begin[0] < WINDOW):
            return ''
        yaw = (self._newest[left] - self._newest[right]) / (right - left)
        if self._begin is not None:
            self._turns.append((self._turned, yaw - self._begin[1]))
        self._begin, self._turned = (stamp, yaw), 0.0
        return self._wrong()

    def _wrong(self) -> str:
        """Return what is wrong by the ratio of all pairs of windows: an offset does not matter."""
        gyroscope, distances = np.array(self._turns).reshape(-1, 2).T
        one, other = np.triu_indices(len(gyroscope), 1)
        turned = gyroscope[one] - gyroscope[other]
        pairs = np.abs(turned) > TURNED
        if pairs.sum() < PAIRS:
            return ''
        ratios = np.sort((distances[one] - distances[other])[pairs] / turned[pairs])
        low, ratio, high = ratios[[len(ratios) * k // 4 for k in (1, 2, 3)]]
        if ratio < SWAPPED and high - low < SPREAD:
            return ('the distances turn against the gyroscope: left and right are swapped, or z '
                    'of the imu points down')
        if DEGREES[0] < abs(ratio) < DEGREES[1] and high - low < SPREAD * DEGREES[1]:
            return ('the gyroscope turns 57 times as far as the distances: its unit seems to be '
                    'degrees per second')
        return ''
