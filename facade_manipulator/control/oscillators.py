"""
The model of one axis of the disturbance: an offset and two slightly damped oscillations.

A gondola on cables is a double pendulum: seen along one axis it swings about a slowly wandering
offset in two modes. The state of one axis is (offset, p, v, ω, p, v, ω): the place, the velocity
and the angular frequency of each oscillation; what is measured is offset + Σ p. The frequencies
belong to the state, so the extended Kalman filter adapts them. An oscillation is the real part of
the phasor p − i v/ω, which turns as exp((i − ζ) ω t) does. All functions work on arrays
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
DAMPING_RATIO = 0.005
LOWEST_FREQUENCY = 0.2
HIGHEST_FREQUENCY = 40.0

_RATE = 1j - DAMPING_RATIO  # of a phasor, by its frequency

# Elements of both oscillations in matrices whose rows are laid end to end: a slice of these is a
# view, several times cheaper than picking elements.
_DIAGONAL = slice(0, None, STATE_SIZE + 1)


def _block(row: int, column: int) -> slice:
    """Return the slice of an element of both (p, v, ω) blocks."""
    first = STATE_SIZE * (1 + row) + 1 + column
    return slice(first, None, 3 * (STATE_SIZE + 1))


_PP, _PV, _PW = (_block(0, column) for column in range(3))
_VP, _VV, _VW = (_block(1, column) for column in range(3))
_WW = _block(2, 2)


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
    """
    Return the place on the axis [m or rad]: the offset and both oscillations.

    Of rows of a covariance it is the covariance with that place.
    """
    return states[..., OFFSET] + states[..., 1] + states[..., 4]


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
    frequencies = states[..., FREQUENCIES]
    return _moved(states, phasors(states) * _turn(frequencies, interval))


def place_after(states: np.ndarray, interval: float) -> np.ndarray:
    """Return the place on the axis that `propagate` and `observe` would give."""
    turned = phasors(states) * _turn(states[..., FREQUENCIES], interval)
    return states[..., OFFSET] + turned.real.sum(axis=-1)


def transition(states: np.ndarray, interval: float) -> np.ndarray:
    """Return the derivative of `propagate` with respect to the state, shape (..., 7, 7)."""
    return propagate_with_transition(states, interval)[1]


def propagate_with_transition(
    states: np.ndarray, interval: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return what `propagate` and `transition` return."""
    frequencies, turn = states[..., FREQUENCIES], _turn(states[..., FREQUENCIES], interval)
    before = phasors(states)
    turned = before * turn
    by_frequency = (_RATE * interval) * turned - turn * (1j * before.imag / frequencies)
    matrix = np.zeros((*states.shape[:-1], STATE_SIZE * STATE_SIZE))
    matrix[..., _DIAGONAL] = 1.0
    matrix[..., _PP] = matrix[..., _VV] = turn.real
    matrix[..., _PV] = turn.imag / frequencies
    matrix[..., _VP] = -frequencies * turn.imag
    matrix[..., _PW] = by_frequency.real
    matrix[..., _VW] = -frequencies * by_frequency.imag - turned.imag
    return _moved(states, turned), matrix.reshape((*states.shape, STATE_SIZE))


def process_covariance(
    states: np.ndarray, interval: float, noise: ProcessNoise
) -> np.ndarray:
    """Return the covariance that the process noise adds over an interval, shape (..., 7, 7)."""
    frequencies = states[..., FREQUENCIES]
    matrix = np.zeros((*states.shape[:-1], STATE_SIZE * STATE_SIZE))
    acceleration = noise.acceleration[..., None] * interval
    matrix[..., OFFSET] = noise.offset * interval
    matrix[..., _PP] = acceleration * (interval * interval / 3.0)
    matrix[..., _PV] = matrix[..., _VP] = acceleration * (interval / 2.0)
    matrix[..., _VV] = acceleration
    matrix[..., _WW] = noise.frequency * interval * frequencies * frequencies
    return matrix.reshape((*states.shape, STATE_SIZE))


def taylor_coefficients(
    oscillations: np.ndarray, frequencies: np.ndarray, interval: float, degree: int
) -> np.ndarray:
    """
    Expand the sum of all oscillations of an axis about a time.

    Each derivative is the one before times (i − ζ) ω.

    Parameters
    ----------
    oscillations, frequencies : numpy.ndarray, shape (axes, ...)
        Phasor [m or rad] and angular frequency [rad/s] of each oscillation.
    interval : float
        Time from the phasors to the centre of the expansion [s].
    degree : int

    Returns
    -------
    numpy.ndarray, shape (degree + 1, axes)
        Coefficients of 1, t, t² …, t counted from the centre.

    """
    axes = len(oscillations)
    rate = (_RATE * frequencies).reshape(axes, -1)
    terms = np.empty((degree + 1, *rate.shape), complex)
    np.multiply(oscillations.reshape(axes, -1), np.exp(interval * rate), out=terms[0])
    np.divide(rate, np.arange(1, degree + 1)[:, None, None], out=terms[1:])
    np.multiply.accumulate(terms, axis=0, out=terms)
    return terms.real.sum(axis=-1)


def phasors(states: np.ndarray) -> np.ndarray:
    """Return p − i v/ω of each oscillation [m or rad], shape (..., 2); its amplitude is |p|."""
    return states[..., PLACES] - 1j * (states[..., VELOCITIES] / states[..., FREQUENCIES])


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


def _turn(frequencies: np.ndarray, interval: float) -> np.ndarray:
    return np.exp((_RATE * interval) * frequencies)


def _moved(states: np.ndarray, turned: np.ndarray) -> np.ndarray:
    moved = states.copy()
    moved[..., PLACES] = turned.real
    moved[..., VELOCITIES] = -states[..., FREQUENCIES] * turned.imag
    return moved
