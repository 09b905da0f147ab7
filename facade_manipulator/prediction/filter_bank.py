"""
Extended Kalman filters that hold different opinions on how hard the gusts push, side by side.

All axes and all opinions are one batch of arrays: numpy's cost is per call, not per filter.
"""

from __future__ import annotations

import numpy as np

from facade_manipulator.prediction import oscillators
from facade_manipulator.prediction.oscillators import ProcessNoise
from facade_manipulator.prediction.spectrum import Oscillations

OFFSET_DEVIATION = 0.1
AMPLITUDE_DEVIATION = (0.03, 0.01)
FREQUENCY_DEVIATION = 0.3
SEEDED_FREQUENCY_DEVIATION = (0.03, 0.1)
SEEDED_SHARE = 0.1


class FilterBank:
    """
    A filter for every axis and every opinion on the gusts.

    Parameters
    ----------
    values : numpy.ndarray, shape (axes,)
        First measurement, taken as the offsets [m or rad].
    frequencies : numpy.ndarray, shape (2,)
        Angular frequencies to start from [rad/s].
    noise : ProcessNoise
        ``noise.acceleration`` of shape (opinions,).

    """

    def __init__(
        self, values: np.ndarray, frequencies: np.ndarray, noise: ProcessNoise
    ) -> None:
        self._noise = noise
        self._frequencies = frequencies
        shape = (len(values), len(noise.acceleration))
        self.states = np.empty((*shape, oscillators.STATE_SIZE))
        self.covariances = np.empty((*self.states.shape, oscillators.STATE_SIZE))
        for axis, value in enumerate(values):
            self.restart(axis, slice(None), value)
        self._transition = oscillators.Transition(self.states.shape)
        self._noise_by_power = oscillators.process_covariance_by_power(noise).reshape(3, -1)

    def update(self, interval: float, values: np.ndarray, variances: np.ndarray) -> None:
        """
        Propagate all filters over an interval [s] and correct them by a measurement.

        Parameters
        ----------
        interval : float
        values, variances : numpy.ndarray, shape (axes,)
            Measured place on each axis and the variance of its noise.

        """
        predicted = self._transition.move(self.states, interval)
        step = self._transition.matrix
        covariance = step @ self.covariances @ step.swapaxes(-1, -2)
        powers = np.array((interval, interval ** 2, interval ** 3))
        covariance += (powers @ self._noise_by_power).reshape(covariance.shape[1:])
        oscillators.add_frequency_noise(covariance, self.states, interval, self._noise)
        projected = covariance @ oscillators.MEASURED
        spread = projected @ oscillators.MEASURED + variances[:, None]
        gain = projected / spread[..., None]
        innovation = values[:, None] - predicted @ oscillators.MEASURED
        predicted += gain * innovation[..., None]
        covariance -= gain[..., :, None] * projected[..., None, :]
        self.states = predicted
        self.covariances = 0.5 * (covariance + covariance.swapaxes(-1, -2))
        self._bound_frequencies()

    def restart(self, axis: int, opinion: int | slice, value: float) -> None:
        """Let filters of an axis begin at rest at a value [m or rad], as at their start."""
        self.states[axis, opinion] = oscillators.initial_state(value, self._frequencies)
        self.covariances[axis, opinion] = oscillators.initial_covariance(
            OFFSET_DEVIATION, AMPLITUDE_DEVIATION, self._frequencies, (FREQUENCY_DEVIATION,) * 2)

    def seed(self, axis: int, opinion: int, fit: Oscillations, variance: float) -> None:
        """
        Start one filter anew from oscillations found in its axis.

        Parameters
        ----------
        axis, opinion : int
        fit : Oscillations
            With t = 0 at the last update.
        variance : float
            Of the axis's measurement noise.

        """
        frequencies = self._frequencies.copy()
        frequencies[:len(fit.frequencies)] = fit.frequencies
        state = oscillators.initial_state(fit.offset, frequencies)
        state[oscillators.PLACES][:len(fit.places)] = fit.places
        state[oscillators.VELOCITIES][:len(fit.velocities)] = fit.velocities
        uncertain = max(variance, fit.unexplained)
        power = np.abs(oscillators.phasors(state)) ** 2
        amplitude = np.sqrt(uncertain + SEEDED_SHARE * power)
        offset = np.sqrt(uncertain + SEEDED_SHARE * power.sum())
        self.states[axis, opinion] = state
        self.covariances[axis, opinion] = oscillators.initial_covariance(
            offset, amplitude, frequencies, SEEDED_FREQUENCY_DEVIATION)

    def _bound_frequencies(self) -> None:
        frequencies = self.states[..., oscillators.FREQUENCIES]
        np.maximum(frequencies, oscillators.LOWEST_FREQUENCY, out=frequencies)
        np.minimum(frequencies, oscillators.HIGHEST_FREQUENCY, out=frequencies)
