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
HIGHEST_DEGREE = 20  # of an expansion

MEASURED = np.zeros(STATE_SIZE)  # states @ MEASURED is the place on the axis
MEASURED[OFFSET] = MEASURED[PLACES] = 1.0

_RATE = 1j - DAMPING_RATIO  # of a phasor, by its frequency
_RATE_PARTS = np.array([_RATE.real, _RATE.imag])
_RECIPROCALS = 1.0 / np.arange(1.0, HIGHEST_DEGREE + 1.0)[:, None, None]


def _block(row: int, column: int) -> slice:
    """
    Return the slice of an element of both (p, v, ω) blocks in a matrix seen as one row.

    A slice is a view, several times cheaper than picking elements.
    """
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


class Transition:
    """
    Propagates states and keeps the derivative with respect to them.

    Parameters
    ----------
    shape : tuple of int
        Of the states, (..., 7).

    Attributes
    ----------
    matrix : numpy.ndarray, shape (..., 7, 7)
        Derivative of the last states moved with respect to the states before.

    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.matrix = np.tile(np.eye(STATE_SIZE), (*shape[:-1], 1, 1))
        elements = seen_as_rows(self.matrix)
        self._pp, self._pv, self._pw = (elements[..., at] for at in (_PP, _PV, _PW))
        self._vp, self._vv, self._vw = (elements[..., at] for at in (_VP, _VV, _VW))

    def move(self, states: np.ndarray, interval: float) -> np.ndarray:
        """Return what `propagate` does, and write the derivative."""
        frequencies = states[..., FREQUENCIES]
        falling = -frequencies
        turn, before = _turn(frequencies, interval), phasors(states)
        turned = before * turn
        # At constant velocity the phasor's imaginary part depends on the frequency.
        by_frequency = (1j * turn) * (before.imag / falling)
        by_frequency += (_RATE * interval) * turned
        real, imaginary = turn.real, turn.imag
        self._pp[...] = self._vv[...] = real
        np.divide(imaginary, frequencies, out=self._pv)
        np.multiply(imaginary, falling, out=self._vp)
        self._pw[...] = by_frequency.real
        np.multiply(by_frequency.imag, falling, out=self._vw)
        self._vw -= turned.imag
        return _moved(states, turned, falling)


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
    return _moved(states, phasors(states) * _turn(frequencies, interval), -frequencies)


def place_after(states: np.ndarray, interval: float) -> np.ndarray:
    """Return the place on the axis [m or rad] that `propagate` leads to."""
    turned = phasors(states) * _turn(states[..., FREQUENCIES], interval)
    return states[..., OFFSET] + np.add.reduce(turned.real, axis=-1)


def process_covariance_by_power(noise: ProcessNoise) -> np.ndarray:
    """
    Return what the noise of gusts and offset adds over an interval, by its powers 1 to 3.

    Returns
    -------
    numpy.ndarray, shape (3, ..., 7, 7)
        To be multiplied by the interval [s], its square and its cube.

    """
    acceleration = noise.acceleration[..., None]
    powers = np.zeros((3, *noise.acceleration.shape, STATE_SIZE * STATE_SIZE))
    powers[0, ..., OFFSET] = noise.offset
    powers[0, ..., _VV] = acceleration
    powers[1, ..., _PV] = powers[1, ..., _VP] = acceleration / 2.0
    powers[2, ..., _PP] = acceleration / 3.0
    return powers.reshape(*powers.shape[:-1], STATE_SIZE, STATE_SIZE)


def add_frequency_noise(
    covariance: np.ndarray, states: np.ndarray, interval: float, noise: ProcessNoise
) -> None:
    """Add to a covariance what the random walk of the frequencies adds over an interval [s]."""
    variances = seen_as_rows(covariance)[..., _WW]
    variances += (interval * noise.frequency) * np.square(states[..., FREQUENCIES])


def seen_as_rows(matrices: np.ndarray) -> np.ndarray:
    """Return contiguous matrices with their rows laid end to end, a view."""
    return matrices.reshape(*matrices.shape[:-2], -1)


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
        At most `HIGHEST_DEGREE`.

    Returns
    -------
    numpy.ndarray, shape (degree + 1, axes)
        Coefficients of 1, t, t² …, t counted from the centre.

    """
    axes = len(oscillations)
    rate = _rates(frequencies, 1.0).reshape(axes, -1)
    terms = np.empty((degree + 1, *rate.shape), complex)
    turned = np.exp(interval * rate, out=terms[0])
    turned *= oscillations.reshape(axes, -1)
    np.multiply(_RECIPROCALS[:degree], rate, out=terms[1:])
    np.multiply.accumulate(terms, axis=0, out=terms)
    return np.add.reduce(terms.real, axis=-1)


def phasors(states: np.ndarray) -> np.ndarray:
    """Return p − i v/ω of each oscillation [m or rad], shape (..., 2); its amplitude is |p|."""
    places = states[..., PLACES]
    result = np.empty(places.shape, complex)
    result.real = places
    result.imag = states[..., VELOCITIES] / -states[..., FREQUENCIES]
    return result


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
    angles = _rates(frequencies, interval)
    return np.exp(angles, out=angles)


def _rates(frequencies: np.ndarray, factor: float) -> np.ndarray:
    """Return (i − ζ) ω times a factor; part by part, because to mix kinds of numbers is slow."""
    parts = frequencies[..., None] * (factor * _RATE_PARTS)
    return parts.view(complex)[..., 0]


def _moved(states: np.ndarray, turned: np.ndarray, falling: np.ndarray) -> np.ndarray:
    """Return states with the phasors `turned`; `falling` is −ω."""
    moved = states.copy()
    moved[..., PLACES] = turned.real
    np.multiply(turned.imag, falling, out=moved[..., VELOCITIES])
    return moved
