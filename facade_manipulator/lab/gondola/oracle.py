"""
What can be predicted at best: what any prediction may be measured by.

Of gusts the power of each frequency is known. The estimates of a window and the disturbance later
have a known covariance then, and the conditional mean, which for Gaussian motion is what a Kalman
filter with the true model and noise gives, follows by linear algebra [1]_. Gusts push linearly
here and nothing else is; the axes are predicted one by one.

Of sines the frequencies are known, and amplitudes and phases follow from all estimates since the
start by least squares. Who has to find the frequencies too errs at least as much as the bound of
Cramér and Rao says, with what was known before in its information [2]_.

References
----------
.. [1] N. Wiener, "Extrapolation, Interpolation, and Smoothing of Stationary Time Series", MIT
   Press 1949.
.. [2] H. L. Van Trees, "Detection, Estimation, and Modulation Theory", Part I, Wiley 1968, 2.4.

"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from facade_manipulator.kinematics import MotionState, Pose, Twist
from facade_manipulator.lab.gondola.closed_loop import START
from facade_manipulator.lab.gondola.gondola import GondolaSettings, modes, wind_forces
from facade_manipulator.lab.gondola.motion import Motion, Sway, SwaySettings
from facade_manipulator.lab.gondola.scenario import Scenario
from facade_manipulator.lab.gondola.wind import (
    HIGHEST_FREQUENCY,
    LOWEST_FREQUENCY,
    spectral_density,
    WindSettings,
)
from facade_manipulator.prediction import Variances

WINDOW = 10.0  # s of estimates that count: in gusts 80 s make it better by less than 0.4 %
FARTHEST = 1.5  # s
LEAST_POWER = 1e-14  # m² or rad²: of an axis without motion, whose covariance is singular
STEP = 5e-4  # Hz, between the frequencies of gusts
SMALL = 1e-6  # m/s, of gusts whose forces are linear
DIFFERENCE = 1e-3  # s, of which velocities are taken
FREQUENCY_DEVIATION = 0.2  # Hz, of sways between 0.05 and 0.8 Hz, before anything is known


def limits(scenario: Scenario, motion: Motion, origin: float = START) -> dict[str, Any]:
    """
    Return the best predictions of a scenario's motion that begins at the origin [s], by name.

    What ``known`` predicts comes true, ``oracle`` knows the law, ``bound`` has to find the
    frequencies of sines, too. There are none where the head has part in the motion; the law of an
    estimator whose errors are not as it tells is not known.
    """
    if scenario.facade.present and scenario.gondola.reaction:
        return {}
    found = {'known': KnownDisturbance(motion, origin)}
    if not scenario.estimator.is_honest:
        return found
    if scenario.mission.motion == 'sway':
        for name, deviation in (('oracle', 0.0), ('bound', FREQUENCY_DEVIATION)):
            found[name] = SinesPrediction(scenario.sway, origin, deviation)
    if scenario.mission.motion == 'wind':
        found['oracle'] = GustsPrediction(
            *wind_law(scenario.gondola, scenario.wind), 1.0 / scenario.estimator.rate,
            scenario.estimator.variances())
    return found


def wind_law(gondola: GondolaSettings, wind: WindSettings) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies [Hz] and the power of each axis there, of sway under small gusts."""
    frequencies = np.arange(LOWEST_FREQUENCY, HIGHEST_FREQUENCY, STEP)
    natural, damping, participation, output = modes(gondola)
    forces = wind_forces(gondola, wind, SMALL * np.eye(3)) / SMALL
    s, natural = 2j * math.pi * frequencies, natural[:, None]
    resonances = 1.0 / (natural ** 2 + 2.0 * damping * natural * s + s * s)
    response = np.einsum('am,mf,km,gk->agf', output, resonances, participation, forces)
    gusts = np.stack([spectral_density(wind, axis, frequencies) for axis in range(3)])
    return frequencies, (np.abs(response) ** 2 * gusts).sum(axis=1) * STEP


def covariance(frequencies: np.ndarray, power: np.ndarray, lags: np.ndarray) -> np.ndarray:
    """Return the covariance of each axis over lags [s], shape (3, lags)."""
    return power @ np.cos(math.tau * np.outer(frequencies, lags))


class KnownDisturbance:
    """Predict what will come true, of a motion that counts time from the origin [s]."""

    def __init__(self, motion: Motion, origin: float) -> None:
        self.stamp = self.since = -math.inf
        self._motion, self._origin = motion, origin

    def update(self, stamp: float, values: Pose, variances: Variances) -> None:
        """Take an estimate."""
        self.since = stamp if self.since == -math.inf else self.since
        self.stamp = stamp

    def predict(self, time: float) -> MotionState:
        """Return the mean of what is possible at a time [s]."""
        before, after = self._position(time), self._position(time + DIFFERENCE)
        return MotionState(
            Pose(*before.tolist()), Twist(*((after - before) / DIFFERENCE).tolist()))

    def _position(self, time: float) -> np.ndarray:
        return np.array(self._motion(time - self._origin))


class GustsPrediction(KnownDisturbance):
    """
    Predict by the law of the disturbance: who knows what power comes, but not what comes.

    The power is the mean square of each axis at each frequency [Hz], shape (3, n); the interval is
    that between two estimates [s], and the variances are those of their noise.
    """

    def __init__(
        self, frequencies: np.ndarray, power: np.ndarray, interval: float, variances: Variances
    ) -> None:
        super().__init__(self._expected, 0.0)
        self._interval, self._variances = interval, np.array(variances)[:, None, None]
        self._size, self._steps = round(WINDOW / interval), math.ceil(FARTHEST / interval) + 1
        self._covariance = covariance(
            frequencies, power, interval * np.arange(self._size + self._steps))
        self._covariance[:, 0] += LEAST_POWER
        self._solved = {  # for half the window, a quarter and so on, as long as it is not full
            size: self._solve(size) for size in (
                self._size >> power for power in range(self._size.bit_length()))}
        self._values = np.zeros((0, 3))

    def update(self, stamp: float, values: Pose, variances: Variances) -> None:
        """Take an estimate; those that are missing become what is most likely by all others."""
        last = self.stamp if len(self._values) else stamp
        missing = round((stamp - last) / self._interval) - 1
        super().update(stamp, values, variances)
        gap = np.full((min(max(missing, 0), self._size), 3), math.nan)
        self._values = np.concatenate(([values], gap, self._values))[:self._size]
        size = max(size for size in self._solved if size <= len(self._values))
        inverse, weights = self._solved[size]
        seen = self._values[:size].T.copy()
        lost = np.isnan(seen[0])
        seen[:, lost] = 0.0
        seen[:, lost] = -np.linalg.solve(
            inverse[:, lost][..., lost], inverse[:, lost] @ seen[..., None])[..., 0]
        self._ahead = (weights @ seen[..., None])[..., 0].T

    def _expected(self, time: float) -> Pose:
        times = self.stamp + self._interval * np.arange(self._steps)
        return Pose(*(np.interp(time, times, axis) for axis in self._ahead.T))

    def _solve(self, size: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the inverse covariance of estimates, and their weights at every step ahead."""
        ages = np.arange(size)
        inverse = np.linalg.inv(
            self._covariance[:, np.abs(np.subtract.outer(ages, ages))]
            + self._variances * np.eye(size))
        return inverse, self._covariance[:, np.add.outer(np.arange(self._steps), ages)] @ inverse


class SinesPrediction(KnownDisturbance):
    """
    Predict sines of known frequencies, or with the least error that finding them allows.

    It is least squares about the truth, with parameters in units of their standard deviations
    before anything is known, of the frequencies the deviation [Hz], 0 if they are known. They
    begin as far off as is to be expected: no amplitude, and the frequencies wrong by one
    deviation.
    """

    def __init__(self, settings: SwaySettings, origin: float, deviation: float) -> None:
        self._sway, self._deviation = Sway(settings), deviation
        super().__init__(self._sway.at, origin)
        count = len(self._sway.rates)
        self._information = np.stack([np.eye(3 * count)] * 3)
        self._weighted = np.tile(np.repeat((-math.sqrt(2.0), 0.0, 1.0), count), (3, 1))

    def update(self, stamp: float, values: Pose, variances: Variances) -> None:
        """Take an estimate."""
        super().update(stamp, values, variances)
        slopes, noise = self._slopes(stamp), np.array(variances)[:, None]
        error = (values - super()._position(stamp))[:, None]
        self._information += slopes[:, :, None] * (slopes / noise)[:, None, :]
        self._weighted += slopes * error / noise
        self._off = np.linalg.solve(self._information, self._weighted[..., None])[..., 0]

    def deviations(self, time: float) -> tuple[float, ...]:
        """Return the standard deviations of the errors at a time [s]: x, y, yaw [m, m, rad]."""
        slopes = self._slopes(time)[..., None]
        return tuple(np.sqrt(
            (slopes * np.linalg.solve(self._information, slopes)).sum(axis=(1, 2))).tolist())

    def _position(self, time: float) -> np.ndarray:
        return super()._position(time) + (self._slopes(time) * self._off).sum(axis=1)

    def _slopes(self, time: float) -> np.ndarray:
        """Return the slopes by amplitudes in phase, in quadrature and frequencies, (3, n)."""
        elapsed, sway = time - self._origin, self._sway
        angles = sway.rates * elapsed + sway.phases
        quadrature = sway.amplitudes * np.cos(angles)
        return np.concatenate((
            sway.amplitudes * np.sin(angles) / math.sqrt(2.0), quadrature / math.sqrt(2.0),
            math.tau * self._deviation * elapsed * quadrature), axis=1)
