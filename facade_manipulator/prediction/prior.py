"""
Prior of the continuation: second moments of features φ and moves m before any learning.

A move is the displacement from the level after a horizon (`continuation`). For a stationary motion
of spectral density S the moments are integrals of the frequency responses, E[φ φᵀ] = ∫ S Re(φ φᴴ)
df and E[φ m] = ∫ S Re(φ* m) df. The two motions are sways of the gondola, and the noise of the
estimator on a gondola at rest.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from facade_manipulator.prediction.filters import features, response

# s, after the newest estimate
HORIZONS = np.array((0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.6))
BAND_POINTS = 1000


class Moments(NamedTuple):
    """
    Second moments for one kind of motion, per unit of its strength.

    Parameters
    ----------
    features : numpy.ndarray, shape (FEATURES, FEATURES)
        E[φ φᵀ].
    moves : numpy.ndarray, shape (FEATURES, HORIZONS)
        E[φ m].
    level_variance : float
        Variance of the level.

    """

    features: np.ndarray
    moves: np.ndarray
    level_variance: float


SWAY_BAND = (0.05, 0.8)  # Hz: from 100 m of cable to a stiff guide
SWAY_SLOPE = -4.0  # of the position's spectral density


@lru_cache
def sway_moments() -> Moments:
    """Return the moments of sways with an acceleration variance of 1 m²/s⁴."""
    frequencies = np.geomspace(*SWAY_BAND, BAND_POINTS)
    power = frequencies**SWAY_SLOPE * np.gradient(frequencies)
    power /= power @ (2.0 * np.pi * frequencies) ** 4
    later = np.exp(2j * np.pi * np.outer(frequencies, HORIZONS))
    return _moments(response(frequencies), power, later)


NOISE_BAND = (0.0025, 25.0)  # Hz: the passband of the filters


@lru_cache
def noise_moments() -> Moments:
    """Return the moments of white noise with a density (variance times interval) of 1 m² s."""
    frequencies = np.linspace(*NOISE_BAND, BAND_POINTS)
    power = 2.0 * np.gradient(frequencies)
    return _moments(
        response(frequencies), power, np.zeros((BAND_POINTS, len(HORIZONS)))
    )


def _moments(states: np.ndarray, power: np.ndarray, later: np.ndarray) -> Moments:
    """Return the moments of tones with a given power, which become `later` after the horizons."""
    tones, level = features(states)
    moves = later - level[:, None]
    weighted = power[:, None] * tones.conj()
    return Moments(
        features=(weighted.T @ tones).real,
        moves=(weighted.T @ moves).real,
        level_variance=float(power @ np.abs(level) ** 2),
    )
