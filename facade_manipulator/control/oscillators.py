"""
The model of one axis of the disturbance: an offset and two slightly damped oscillations.

A gondola on cables is a double pendulum: seen along one axis it swings about a slowly wandering
offset in two modes. The state of one axis is (offset, p, v, ω, p, v, ω): the place, the velocity
and the angular frequency of each oscillation; what is measured is offset + Σ p. The frequencies
belong to the state, so the extended Kalman filter adapts them. All functions work on arrays
whose last axis is the state and broadcast over the leading ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

STATE_SIZE = 7
OFFSET = 0
PLACES = slice(1, None, 3)
VELOCITIES = slice(2, None, 3)
FREQUENCIES = slice(3, None, 3)
OBSERVATION = np.array([1.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0])
DAMPING_RATIO = 0.005
LOWEST_FREQUENCY = 0.2
HIGHEST_FREQUENCY = 40.0

_FIRST = np.arange(1, STATE_SIZE, 3)
_DIAGONAL = np.arange(STATE_SIZE)


class ProcessNoise(NamedTuple):
    """
    Spectral densities of what drives the model.

    Parameters
    ----------
    acceleration : numpy.ndarray
        Of the gusts that push the oscillations [m²/s³], broadcasting over the leading axes.
    offset : float
        Of the offset's random walk [m²/s].
    frequency : float
        Of the frequencies' random walk, relative to each [1/s].

    """

    acceleration: np.ndarray
    offset: float
    frequency: float


def observe(states: np.ndarray) -> np.ndarray:
    """Return the place on the axis [m or rad]: the offset and both oscillations."""
    return states @ OBSERVATION


def propagate(states: np.ndarray, interval: float) -> np.ndarray:
    """
    Move states forward in time.

    Parameters
    ----------
    states : numpy.ndarray, shape (..., 7)
    interval : float
        Time to propagate over [s].

    Returns
    -------
    numpy.ndarray, shape (..., 7)

    """
    places, velocities = states[..., PLACES], states[..., VELOCITIES]
    frequencies = states[..., FREQUENCIES]
    cosine, sine = _rotation(frequencies, interval)
    moved = states.copy()
    moved[..., PLACES] = cosine * places + sine / frequencies * velocities
    moved[..., VELOCITIES] = cosine * velocities - frequencies * sine * places
    return moved


def transition(states: np.ndarray, interval: float) -> np.ndarray:
    """Return the derivative of `propagate` with respect to the state, shape (..., 7, 7)."""
    p, v, w = states[..., PLACES], states[..., VELOCITIES], states[..., FREQUENCIES]
    cosine, sine = _rotation(w, interval)
    matrix = np.zeros((*states.shape, STATE_SIZE))
    matrix[..., _DIAGONAL, _DIAGONAL] = 1.0
    i, j, k = _FIRST, _FIRST + 1, _FIRST + 2
    matrix[..., i, i] = matrix[..., j, j] = cosine
    matrix[..., i, j] = sine / w
    matrix[..., j, i] = -w * sine
    dcosine = -interval * (sine + DAMPING_RATIO * cosine)
    dsine = interval * (cosine - DAMPING_RATIO * sine)
    matrix[..., i, k] = dcosine * p + (dsine - sine / w) / w * v
    matrix[..., j, k] = dcosine * v - (sine + w * dsine) * p
    return matrix


def process_covariance(
    states: np.ndarray, interval: float, noise: ProcessNoise
) -> np.ndarray:
    """Return the covariance that the process noise adds over an interval, shape (..., 7, 7)."""
    matrix = np.zeros((*states.shape, STATE_SIZE))
    i, j, k = _FIRST, _FIRST + 1, _FIRST + 2
    acceleration = noise.acceleration[..., None] * interval
    matrix[..., OFFSET, OFFSET] = noise.offset * interval
    matrix[..., i, i] = acceleration * (interval * interval / 3.0)
    matrix[..., i, j] = matrix[..., j, i] = acceleration * (interval / 2.0)
    matrix[..., j, j] = acceleration
    matrix[..., k, k] = noise.frequency * interval * states[..., FREQUENCIES] ** 2
    return matrix


def amplitudes(states: np.ndarray) -> np.ndarray:
    """Return the amplitude of each oscillation [m or rad], shape (..., 2)."""
    return np.hypot(states[..., PLACES], states[..., VELOCITIES] / states[..., FREQUENCIES])


def initial_state(offset: float, frequencies: Sequence[float]) -> np.ndarray:
    """Return a state at rest at an offset [m or rad], with the two frequencies [rad/s]."""
    state = np.zeros(STATE_SIZE)
    state[OFFSET] = offset
    state[FREQUENCIES] = frequencies
    return state


def initial_covariance(
    offset: float, amplitude: Sequence[float], frequencies: Sequence[float],
    relative_frequency: Sequence[float],
) -> np.ndarray:
    """Return the diagonal covariance of these standard deviations; v follows from p and ω."""
    deviation = np.zeros(STATE_SIZE)
    w = np.asarray(frequencies)
    deviation[OFFSET] = offset
    deviation[PLACES] = amplitude
    deviation[VELOCITIES] = np.asarray(amplitude) * w
    deviation[FREQUENCIES] = np.asarray(relative_frequency) * w
    return np.diag(deviation ** 2)


def _rotation(frequencies: np.ndarray, interval: float) -> tuple[np.ndarray, np.ndarray]:
    phase = frequencies * interval
    decay = np.exp(-DAMPING_RATIO * phase)
    return decay * np.cos(phase), decay * np.sin(phase)
