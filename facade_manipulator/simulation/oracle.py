"""
The best linear prediction there is: what any other may be measured by.

Where the law of the disturbance is known, as the power of each of its frequencies, the estimates
of a window and the disturbance later have a known covariance, and the conditional mean, which for
Gaussian motion is what a Kalman filter with the true model and noise gives, follows by linear
algebra. Gusts push linearly here and nothing else is; the axes are predicted one by one.

References
----------
N. Wiener, "Extrapolation, Interpolation, and Smoothing of Stationary Time Series", MIT Press 1949.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from facade_manipulator.kinematics import MotionState, Pose, Twist
from facade_manipulator.simulation.gondola import AIR_DENSITY, GondolaSettings, modes
from facade_manipulator.simulation.scenario import Scenario
from facade_manipulator.simulation.sway import SwaySettings
from facade_manipulator.simulation.wind import (
    HIGHEST_FREQUENCY,
    LOWEST_FREQUENCY,
    spectral_density,
    WindSettings,
)

WINDOW = 20.0  # s of estimates that count
FARTHEST = 0.6  # s
LEAST_POWER = 1e-14  # m² or rad²: of an axis without motion, whose covariance is singular
STEP = 5e-4  # Hz, between the frequencies of gusts
GROWTH = 1.5  # from one number of estimates to the next for which weights are kept


class Law(NamedTuple):
    """
    Power of the disturbance by frequency.

    Parameters
    ----------
    frequencies : numpy.ndarray, shape (n,)
        [Hz].
    power : numpy.ndarray, shape (3, n)
        Mean square of each [m², m², rad²].

    """

    frequencies: np.ndarray
    power: np.ndarray

    def covariance(self, lags: np.ndarray) -> np.ndarray:
        """Return the covariance over lags [s], shape (3, lags)."""
        return self.power @ np.cos(math.tau * np.outer(self.frequencies, lags))


def law(scenario: Scenario) -> Law | None:
    """Return the law of a scenario's disturbance, None if it has none: the head has no law."""
    if scenario.facade.present and scenario.gondola.reaction:
        return None
    if scenario.mission.motion == 'sway':
        return sway_law(scenario.sway)
    if scenario.mission.motion == 'wind':
        return wind_law(scenario.gondola, scenario.wind)
    return None


def sway_law(settings: SwaySettings) -> Law:
    """Return the law of sines whose phases are not known."""
    axes = [settings.sines(axis)[:2] for axis in ('x', 'y', 'yaw')]
    power = [np.square(amplitudes) / 2.0 for amplitudes, _ in axes]
    spread = np.zeros((3, sum(map(len, power))))
    for axis, end in enumerate(np.cumsum([len(part) for part in power])):
        spread[axis, end - len(power[axis]):end] = power[axis]
    return Law(np.concatenate([frequencies for _, frequencies in axes]), spread)


def wind_law(gondola: GondolaSettings, wind: WindSettings) -> Law:
    """Return the law of a gondola's sway under small gusts."""
    frequencies = np.arange(LOWEST_FREQUENCY, HIGHEST_FREQUENCY, STEP)
    natural, _, participation, output = modes(gondola)
    force = 0.5 * AIR_DENSITY * gondola.drag_coefficient * gondola.area * wind.mean_speed
    along, across = math.cos(wind.direction), math.sin(wind.direction)
    forces = force * np.array([[2.0 * along, -across], [2.0 * across, along], [0, 0], [0, 0]])
    forces[2] = gondola.pressure_offset * forces[1]
    s = 2j * math.pi * frequencies
    damping = 2.0 * gondola.damping_ratio * natural[:, None]
    resonances = 1.0 / (natural[:, None] ** 2 + damping * s + s * s)
    response = np.einsum('am,mf,km,kg->agf', output, resonances, participation, forces)
    gusts = np.stack([spectral_density(wind, axis, frequencies) for axis in range(2)])
    return Law(frequencies, (np.abs(response) ** 2 * gusts).sum(axis=1) * STEP)


class OraclePrediction:
    """
    Predict by the law of the disturbance.

    Parameters
    ----------
    law : Law
    interval : float
        Between two estimates [s].
    variances : Pose
        Of their noise.

    """

    def __init__(self, law: Law, interval: float, variances: Pose) -> None:
        self.stamp: float | None = None
        self.since: float | None = None
        self._interval = interval
        self._size = round(WINDOW / interval)
        steps = math.ceil(FARTHEST / interval) + 1
        covariance = law.covariance(interval * np.arange(self._size + steps))
        covariance[:, 0] += LEAST_POWER
        self._weights = {
            size: np.stack([_weights(axis, variance, size, steps) for axis, variance in zip(
                covariance, variances, strict=True)]) for size in _sizes(self._size)}
        self._values = np.zeros((0, 3))

    def update(self, stamp: float, values: Pose, variances: Pose) -> None:
        """Take an estimate; where some are missing, their predictions."""
        if self.stamp is None:
            self.since = stamp
        else:
            missing = round((stamp - self.stamp) / self._interval) - 1
            for step in range(1, min(missing, len(self._ahead) - 1) + 1):
                self._values = np.vstack([self._ahead[step], self._values])
        self.stamp = stamp
        self._values = np.vstack([values, self._values])[:self._size]
        size = max(size for size in self._weights if size <= len(self._values))
        self._ahead = np.einsum('ahn,na->ha', self._weights[size], self._values[:size])

    def predict(self, time: float) -> MotionState:
        """Return the mean of what is possible at a time [s]."""
        steps = min(max((time - self.stamp) / self._interval, 0.0), len(self._ahead) - 1.001)
        before, after = self._ahead[int(steps):int(steps) + 2]
        position = before + (steps - int(steps)) * (after - before)
        velocity = (after - before) / self._interval
        return MotionState(Pose(*position.tolist()), Twist(*velocity.tolist()))

    def deviations(self, time: float) -> None:
        """Return None: nobody asks."""


def _sizes(most: int) -> list[int]:
    """Return 1 and so on to most, ever farther apart."""
    sizes = [1]
    while sizes[-1] < most:
        sizes.append(min(math.ceil(GROWTH * sizes[-1]), most))
    return sizes


def _weights(covariance: np.ndarray, variance: float, size: int, steps: int) -> np.ndarray:
    """Return the weights of the newest estimates, at every step ahead, shape (steps, size)."""
    lags = np.abs(np.subtract.outer(np.arange(size), np.arange(size)))
    later = np.stack([covariance[step:step + size] for step in range(steps)], axis=1)
    return np.linalg.solve(covariance[lags] + variance * np.eye(size), later).T
