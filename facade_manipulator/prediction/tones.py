"""
Fit of sines to the last minute, which is much longer than the memory of the filters.

Model: y(t) = c + Σ Re A exp(iω t) [m or rad] for times t [s] before now, for each axis separately.
Gauss-Newton steps improve the last fit: least squares for c, A and changes of ω, then for c and A.
A tone is added at the peak of the residual's periodogram if the peak exceeds the noise of the
estimates. A tone is removed if its peak is below the noise, or if its frequency is too close to
the frequency of a stronger tone. By the Cramér-Rao bound the error of K tones at the end of T
seconds is about σ sqrt(5 K Δt/T), with noise σ and interval Δt of the estimates.

References
----------
D. C. Rife, R. R. Boorstyn, "Multiple-tone parameter estimation from discrete-time observations",
Bell System Technical Journal 55 (1976) 1389-1410,
https://doi.org/10.1002/j.1538-7305.1976.tb02941.x.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

MOST_TONES = 7  # of an axis; a false tone must leave room for a true tone


class Tones:
    """
    Sum of sines for each axis.

    Parameters
    ----------
    axes : int
    ahead : numpy.ndarray, shape (times,)
        Times after a stamp [s] for which `at` computes positions.

    Attributes
    ----------
    noise_gain : numpy.ndarray, shape (axes,)
        Variance of the positions divided by the density of the noise [1/s], for one more tone than
        were found.

    """

    # Maximum time from the first to the last of the estimates that are averaged [s]: below
    # π/FASTEST_TONE, and not a multiple of usual intervals, so that rounding does not change their
    # number.
    BLOCK = 0.142
    BLOCKS = 400  # maximum number in the window of the fit
    SHORTEST_WINDOW = 3.0  # s, minimum length of the window

    def __init__(self, axes: int, ahead: np.ndarray) -> None:
        self.noise_gain = np.full(axes, 5.0 / self.SHORTEST_WINDOW)
        self._ahead = ahead
        # stamp and values of each estimate in the present block
        self._block: list[tuple[float, ...]] = []
        # mean stamp, mean values, number of estimates
        self._blocks = np.zeros((0, axes + 2))
        # the last fits: the phases of the amplitudes are those at the stamps
        self._stamps = np.zeros(axes)
        self._constants = np.zeros(axes)
        self._frequencies = np.zeros((axes, MOST_TONES))
        self._amplitudes = np.zeros((axes, MOST_TONES), complex)
        # the same amplitudes with the phases after each of the times ahead
        self._amplitudes_ahead = np.zeros((axes, MOST_TONES, len(ahead)), complex)

    def add(self, stamp: float, values: np.ndarray) -> None:
        """Add a decided position of each axis [m or rad]; stamps [s] must ascend."""
        if self._block and stamp - self._block[0][0] > self.BLOCK:
            mean = np.append(np.mean(self._block, axis=0), len(self._block))
            self._blocks = np.vstack((self._blocks[1 - self.BLOCKS :], mean))
            self._block = []
        self._block.append((stamp, *values.tolist()))

    def at(self, stamp: float) -> np.ndarray:
        """Return positions at the times ahead of a stamp [s], shape (axes, times) [m or rad]."""
        phases = (stamp - self._stamps)[:, None] * self._frequencies
        turns = np.exp(1j * phases)
        sums = (turns[:, None] @ self._amplitudes_ahead)[:, 0]
        return self._constants[:, None] + sums.real

    def fit(self, axis: int, variance: float) -> None:
        """Improve the fit of an axis by one step for a variance of the estimates [m² or rad²]."""
        stamps, values, sizes = self._blocks[:, (0, 1 + axis, -1)].T
        span = stamps[-1] - stamps[0] if len(stamps) else 0.0
        if span < self.SHORTEST_WINDOW or stamps[-1] == self._stamps[axis]:
            return

        size = sizes.mean()
        window = _Window(
            times=stamps - stamps[-1],
            values=values,
            variance=values.var(),
            noise=variance / size,
            block=span / (len(stamps) - 1),
            size=size,
        )
        is_known = self._amplitudes[axis] != 0.0
        frequencies = self._frequencies[axis, is_known]
        turns = np.exp(1j * frequencies * (stamps[-1] - self._stamps[axis]))
        amplitudes = turns * self._amplitudes[axis, is_known]
        frequencies, amplitudes, constant = window.fit(frequencies, amplitudes)

        count = len(amplitudes)
        self._stamps[axis] = stamps[-1]
        self._constants[axis] = constant
        self._frequencies[axis, :count] = frequencies
        self._amplitudes[axis] = 0.0
        self._amplitudes[axis, :count] = amplitudes
        turns_ahead = np.exp(1j * frequencies[:, None] * self._ahead)
        self._amplitudes_ahead[axis] = 0.0
        self._amplitudes_ahead[axis, :count] = amplitudes[:, None] * turns_ahead
        self.noise_gain[axis] = 5.0 * (count + 1) / span


FASTEST_TONE = 12.0  # rad/s
# minimum power of a tone in the periodogram divided by the power of the noise
SIGNIFICANT_POWER = 20.0
MAX_TURN = 1.0  # rad, change of a tone's phase over the window in one step
MIN_DISTANCE = 1.0  # rad, between the phases of two tones over the window
PERIODOGRAM_POINTS = 1024  # of the periodogram


class _Window(NamedTuple):
    """Data of the fit: mean positions [m or rad] at times up to 0 [s]."""

    times: np.ndarray
    values: np.ndarray
    variance: float  #: of the means [m² or rad²]
    noise: float  #: variance of a mean's noise [m² or rad²]
    block: float  #: time from one mean to the next [s]
    size: float  #: number of estimates in a mean

    def fit(
        self, frequencies: np.ndarray, amplitudes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Return frequencies [rad/s], amplitudes and constant after one fit step."""
        if len(frequencies):
            largest = -MAX_TURN / self.times[0]
            _, amplitudes, changes, _ = self._solve(frequencies, amplitudes)
            changes = np.minimum(np.maximum(changes, -largest), largest)
            frequencies = frequencies + changes
            power = np.abs(amplitudes) ** 2
            frequencies = frequencies[self._distinct(frequencies, power)]

        # Without this second solution, the amplitudes of new tones become correct only later.
        constant, amplitudes, _, residual = self._solve(frequencies)
        if len(frequencies) < MOST_TONES:
            new = self._strongest(residual)
            if len(new):
                cosines, sines = self._waves(new)
                amplitude = (cosines - 1j * sines) @ residual * (2.0 / len(residual))
                frequencies = np.append(frequencies, new)
                amplitudes = np.append(amplitudes, amplitude)
        return frequencies, amplitudes, constant

    def _waves(self, frequencies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return cos ωt and sin ωt averaged over each block, each of shape (tones, times)."""
        phases = frequencies[:, None] * self.times
        # The mean of evenly spaced estimates reduces each sine's amplitude.
        half = 0.5 * self.block * frequencies[:, None]
        gain = np.sin(half) / (self.size * np.sin(half / self.size))
        return gain * np.cos(phases), gain * np.sin(phases)

    def _solve(
        self, frequencies: np.ndarray, amplitudes: np.ndarray | None = None
    ) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """
        Return constant, amplitudes, frequency changes [rad/s] and residual.

        Without given amplitudes the frequencies do not change.
        """
        cosines, sines = self._waves(frequencies)
        count = len(frequencies)

        # rows of the constant, of the real and imaginary amplitudes, and of the changes
        rows = [np.ones((1, len(self.times))), cosines, -sines]
        if amplitudes is not None:
            # derivative of Re A exp(iωt) with respect to ω: −t (Re A sin ωt + Im A cos ωt)
            slopes = amplitudes[:, None].real * sines
            slopes += amplitudes[:, None].imag * cosines
            rows.append(-self.times * slopes)
        matrix = np.vstack(rows)
        ridge = np.full(len(matrix), self.noise / (self.variance + self.noise))
        ridge[0] = 0.0
        ridge[2 * count + 1 :] = self.noise * (self.times[0] / MAX_TURN) ** 2

        square = matrix @ matrix.T + np.diag(ridge)
        found = np.linalg.solve(square, matrix @ self.values)
        real, imaginary = found[1 : 2 * count + 1].reshape(2, count)
        residual = self.values - found @ matrix
        return found[0], real + 1j * imaginary, found[2 * count + 1 :], residual

    def _distinct(self, frequencies: np.ndarray, power: np.ndarray) -> np.ndarray:
        """Return a mask of the tones that exceed the noise and are not near stronger tones."""
        apart = -MIN_DISTANCE / self.times[0]
        is_near = np.abs(frequencies[:, None] - frequencies) < apart
        is_weaker = power[:, None] < power
        is_double = (is_near & is_weaker).any(axis=1)
        is_above_noise = power * len(self.times) > 2.0 * SIGNIFICANT_POWER * self.noise
        is_in_band = (frequencies > apart) & (frequencies < FASTEST_TONE)
        return is_above_noise & is_in_band & ~is_double

    def _strongest(self, residual: np.ndarray) -> np.ndarray:
        """Return the frequency of the strongest tone [rad/s]; empty if it is below the noise."""
        span = -self.times[0]
        count = len(residual)

        # periodogram of the residual at equal intervals
        times = -span / (count - 1) * np.arange(count - 1, -1, -1)
        even = np.interp(times, self.times, residual)
        power = np.abs(np.fft.rfft(even, PERIODOGRAM_POINTS)) ** 2
        last = len(power) - 1
        frequencies = np.pi * np.arange(len(power)) / last * (count - 1) / span

        power[(frequencies < np.pi / span) | (frequencies > FASTEST_TONE)] = 0.0
        peak = power.argmax()
        is_significant = power[[peak]] > SIGNIFICANT_POWER * count * self.noise
        return frequencies[[peak]][is_significant]
