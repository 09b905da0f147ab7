"""Find the two strongest oscillations in a window of unevenly sampled measurements."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

GRID_PERIOD = 0.04
TRANSFORM_SIZE = 2048
LEAST_CYCLES = 1.5
LEAST_SAMPLES = 32
LOWEST_FREQUENCY_HZ = 0.03
SEPARATION_HZ = 0.03
SECOND_SHARE = 0.02


class Oscillations(NamedTuple):
    """
    Offset plus oscillations p_i cos ω_i t + (v_i/ω_i) sin ω_i t, t = 0 at the window's end.

    Parameters
    ----------
    offset : float
    frequencies : tuple of float
        Angular frequencies of one or two oscillations, the stronger first [rad/s].
    places, velocities : tuple of float
        Of each oscillation at the window's end.
    unexplained : float
        Variance of what remains.
    explained : float
        Share of the window's variance that the oscillations explain, 1 for all of it.

    """

    offset: float
    frequencies: tuple[float, ...]
    places: tuple[float, ...]
    velocities: tuple[float, ...]
    unexplained: float
    explained: float


def fit_oscillations(times: np.ndarray, values: np.ndarray) -> Oscillations | None:
    """
    Fit an offset and up to two oscillations: peaks of the spectrum, then least squares.

    Parameters
    ----------
    times : numpy.ndarray, shape (n,)
        Ascending [s].
    values : numpy.ndarray, shape (n,)

    Returns
    -------
    Oscillations or None
        None if the window is too short to tell a frequency.

    """
    grid = np.arange(times[-1], times[0], -GRID_PERIOD)[::-1]
    if len(grid) < LEAST_SAMPLES:
        return None
    samples = np.interp(grid, times, values)
    elapsed = grid - times[-1]
    first = _peak(samples)
    if first * -elapsed[0] < LEAST_CYCLES:
        return None
    single = _solve(elapsed, samples, (first,))
    second = _peak(single[1])
    weak = single[1].var() < SECOND_SHARE * samples.var()
    if weak or abs(second - first) < SEPARATION_HZ:
        return _oscillations((first,), single, samples)
    pair = (first, second)
    return _oscillations(pair, _solve(elapsed, samples, pair), samples)


def _peak(samples: np.ndarray) -> float:
    """Return the frequency of the strongest peak [Hz], interpolated between the bins."""
    window = np.hanning(len(samples))
    size = max(TRANSFORM_SIZE, len(samples))
    power = np.abs(np.fft.rfft((samples - samples.mean()) * window, size))
    k = int(np.argmax(power[1:-1])) + 1
    left, middle, right = np.log(power[k - 1:k + 2] + 1e-300)
    curvature = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / curvature if curvature < 0.0 else 0.0
    return max((k + shift) / (size * GRID_PERIOD), LOWEST_FREQUENCY_HZ)


def _solve(
    elapsed: np.ndarray, samples: np.ndarray, frequencies_hz: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the least-squares coefficients and what they leave."""
    phase = np.outer(elapsed, 2.0 * np.pi * np.array(frequencies_hz))
    design = np.hstack([np.ones((len(elapsed), 1)), np.cos(phase), np.sin(phase)])
    coefficients = np.linalg.lstsq(design, samples, rcond=None)[0]
    return coefficients, samples - design @ coefficients


def _oscillations(
    frequencies_hz: tuple[float, ...], solution: tuple[np.ndarray, np.ndarray],
    samples: np.ndarray,
) -> Oscillations:
    coefficients, rest = solution
    count = len(frequencies_hz)
    frequencies = tuple(float(2.0 * np.pi * f) for f in frequencies_hz)
    sines = coefficients[1 + count:]
    return Oscillations(
        float(coefficients[0]), frequencies, tuple(map(float, coefficients[1:1 + count])),
        tuple(float(s * w) for s, w in zip(sines, frequencies, strict=True)),
        float(rest.var()), 1.0 - float(rest.var() / max(samples.var(), 1e-300)))
