"""
Fit of sines to the last minute, a much longer time than the memory of the filters.

Model: y(t) = c + Σ Re A exp(iω t) [m or rad] for times t [s] before now, for each axis separately.
Gauss-Newton steps improve the last fit: least squares for c, A and changes of ω, then for c and A.
A tone is added at the peak of the residual's periodogram if the peak exceeds the noise of the
estimates. A tone is removed if its peak is below the noise, or if its frequency is too close to
that of a stronger tone. By the Cramér-Rao bound the error of K tones at the end of T seconds is
about σ sqrt(5 K Δt/T), with noise σ and interval Δt of the estimates.

References
----------
D. C. Rife, R. R. Boorstyn, "Multiple-tone parameter estimation from discrete-time observations",
Bell System Technical Journal 55 (1976) 1389-1410,
https://doi.org/10.1002/j.1538-7305.1976.tb02941.x.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

# Minimum time of the estimates that are averaged [s]: below π/FASTEST, and not a multiple of usual
# intervals, so that rounding does not change their number.
BLOCK = 0.142
BLOCKS = 400  # maximum number in the window of the fit
SHORTEST = 3.0  # s, minimum length of the window
MOST_TONES = 7  # of an axis: a false tone must leave room for a true tone
FASTEST = 12.0  # rad/s
SIGNIFICANT = (
    20.0  # minimum power of a tone in the periodogram divided by the power of the noise
)
MAX_TURN = 1.0  # rad, change of a tone's phase over the window in one step
MIN_DISTANCE = 1.0  # rad, between the phases of two tones over the window
POINTS = 1024  # of the periodogram


class Tones:
    """
    Sums of sines for several axes.

    Parameters
    ----------
    axes : int

    Attributes
    ----------
    noise_gain : numpy.ndarray, shape (axes,)
        Variance of the positions divided by the density of the noise [1/s], for one more tone than
        were found.

    """

    def __init__(self, axes: int) -> None:
        self.noise_gain = np.full(axes, 5.0 / SHORTEST)
        self._first, self._sum = math.inf, np.zeros(axes + 2)
        self._blocks = np.zeros(
            (0, axes + 2)
        )  # mean stamp, mean values, number of estimates
        self._frequencies = np.zeros((axes, MOST_TONES))
        self._amplitudes = np.zeros((axes, MOST_TONES), complex)
        self._constants, self._stamps = np.zeros((2, axes))

    def add(self, stamp: float, values: np.ndarray) -> None:
        """Add an estimate at a stamp [s]: one position for each axis [m or rad]."""
        if stamp - self._first > BLOCK:
            mean = np.append(self._sum[:-1] / self._sum[-1], self._sum[-1])
            self._blocks = np.vstack((self._blocks[1 - BLOCKS :], mean))
            self._first, self._sum = math.inf, 0.0 * self._sum
        self._first = min(self._first, stamp)
        self._sum += (stamp, *values.tolist(), 1.0)

    def at(self, stamp: float, ahead: np.ndarray) -> np.ndarray:
        """Return the positions at times [s] after a stamp [s], shape (axes, times) [m or rad]."""
        times = (stamp - self._stamps)[:, None] + ahead
        waves = np.exp(1j * times[..., None] * self._frequencies[:, None])
        return (
            self._constants[:, None]
            + (waves @ self._amplitudes[..., None])[..., 0].real
        )

    def fit(self, axis: int, variance: float) -> None:
        """Improve the fit of an axis by one step, for a variance of the estimates [m² or rad²]."""
        stamps, values, sizes = self._blocks[:, (0, 1 + axis, -1)].T
        span = stamps[-1] - stamps[0] if len(stamps) else 0.0
        if span < SHORTEST or stamps[-1] == self._stamps[axis]:
            return
        size = sizes.mean()
        window = _Window(
            stamps - stamps[-1],
            values,
            values.var(),
            variance / size,
            span / (len(stamps) - 1),
            size,
        )
        known = self._amplitudes[axis] != 0.0
        frequencies = self._frequencies[axis, known]
        turns = np.exp(1j * frequencies * (stamps[-1] - self._stamps[axis]))
        frequencies, amplitudes, self._constants[axis] = window.fit(
            frequencies, turns * self._amplitudes[axis, known]
        )
        self._amplitudes[axis], self._stamps[axis] = 0.0, stamps[-1]
        self._amplitudes[axis, : len(amplitudes)] = amplitudes
        self._frequencies[axis, : len(amplitudes)] = frequencies
        self.noise_gain[axis] = 5.0 * (len(amplitudes) + 1) / span


class _Window(NamedTuple):
    """Window of the fit: mean positions [m or rad] at times up to 0 [s]."""

    times: np.ndarray
    values: np.ndarray
    variance: float  #: of the means [m² or rad²]
    noise: float  #: variance of a mean's noise [m² or rad²]
    block: float  #: time from one mean to the next [s]
    size: float  #: number of estimates in a mean

    def fit(
        self, frequencies: np.ndarray, amplitudes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Return frequencies [rad/s], amplitudes and constant after one step."""
        most = -MAX_TURN / self.times[0]
        if len(frequencies):
            _, amplitudes, changes, _ = self._solve(frequencies, amplitudes)
            frequencies = frequencies + np.minimum(np.maximum(changes, -most), most)
            frequencies = frequencies[
                self._distinct(frequencies, np.abs(amplitudes) ** 2)
            ]
        # Without this second solution the amplitudes of new tones become right later.
        constant, amplitudes, _, residual = self._solve(frequencies)
        if len(frequencies) < MOST_TONES and len(new := self._strongest(residual)):
            frequencies = np.append(frequencies, new)
            amplitudes = np.append(
                amplitudes, 2.0 / len(residual) * (residual @ self._waves(-new))
            )
        return frequencies, amplitudes, constant

    def _waves(self, frequencies: np.ndarray) -> np.ndarray:
        """Return exp(iω t) averaged over each block, shape (times, frequencies)."""
        phases = self.times[:, None] * frequencies
        waves = np.cos(phases) + 1j * np.sin(phases)  # this is faster than exp()
        # The mean of evenly spaced estimates reduces each sine's amplitude.
        half = 0.5 * self.block * frequencies
        return waves * (np.sin(half) / (self.size * np.sin(half / self.size)))

    def _solve(
        self, frequencies: np.ndarray, amplitudes: np.ndarray | None = None
    ) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """
        Return constant, amplitudes, changes of the frequencies [rad/s], and residual.

        Without given amplitudes the frequencies do not change.
        """
        waves, count = self._waves(frequencies), len(frequencies)
        columns = [np.ones((len(waves), 1)), waves.real, -waves.imag]
        if amplitudes is not None:
            columns.append((1j * self.times[:, None] * waves * amplitudes).real)
        matrix = np.hstack(columns)
        ridge = np.full(matrix.shape[1], self.noise / (self.variance + self.noise))
        ridge[0], ridge[2 * count + 1 :] = (
            0.0,
            self.noise * (self.times[0] / MAX_TURN) ** 2,
        )
        found = np.linalg.solve(
            matrix.T @ matrix + np.diag(ridge), matrix.T @ self.values
        )
        real, imaginary = found[1 : 2 * count + 1].reshape(2, count)
        residual = self.values - matrix @ found
        return found[0], real + 1j * imaginary, found[2 * count + 1 :], residual

    def _distinct(self, frequencies: np.ndarray, power: np.ndarray) -> np.ndarray:
        """Return a mask of the tones above the noise and separate from stronger tones."""
        apart = -MIN_DISTANCE / self.times[0]
        is_near = np.abs(frequencies[:, None] - frequencies) < apart
        return (
            (power * len(self.times) > 2.0 * SIGNIFICANT * self.noise)
            & (frequencies > apart)
            & (frequencies < FASTEST)
            & ~(is_near & (power[:, None] < power)).any(axis=1)
        )

    def _strongest(self, residual: np.ndarray) -> np.ndarray:
        """Return the frequency [rad/s] of the strongest tone, empty if it is below the noise."""
        span, count = -self.times[0], len(residual)
        even = np.interp(
            -span / (count - 1) * np.arange(count - 1, -1, -1), self.times, residual
        )
        power = np.abs(np.fft.rfft(even, POINTS)) ** 2
        frequencies = (
            np.pi * np.arange(len(power)) / (len(power) - 1) * (count - 1) / span
        )
        power[(frequencies < np.pi / span) | (frequencies > FASTEST)] = 0.0
        peak = power.argmax()
        return frequencies[[peak]][power[[peak]] > SIGNIFICANT * count * self.noise]
