"""
Fixed linear filters that compute the present motion at four bandwidths.

Each filter is the steady-state Kalman-Bucy filter for a position whose jerk is white noise. For
any noise, its poles are the poles of a Butterworth filter of third order, −ω and ω exp(±2πi/3).
Its estimates of position, velocity and acceleration, with the Laplace variable s in units of the
bandwidth ω [rad/s], are

    p = (2 s² + 2 s + 1) y / D,  v/ω = (2 s² + s) y / D,  a/ω² = s² y / D,

where D = s³ + 2 s² + 2 s + 1 and the input y is the measured position [m or rad].

The state of the filter is stored as its modes ż = λ (z − y), where λ is a pole. Of the complex
pair only one mode is stored. Each y holds for the interval before it, which may have any length.
|z| is at most twice the largest |y|.

References
----------
R. E. Kalman, R. S. Bucy, "New results in linear filtering and prediction theory", Journal of
Basic Engineering 83 (1961) 95-108, https://doi.org/10.1115/1.3658902.
"""

from __future__ import annotations

import numpy as np

BANDWIDTHS = np.array((0.8, 2.0, 4.0, 8.0))  # rad/s
LEVEL_FILTER = 2  # index of the filter to whose position the features are relative
FEATURES = 3 * len(BANDWIDTHS) - 1
# index of the level filter's a/ω² in the features
ACCELERATION_FEATURE = 3 * LEVEL_FILTER + 1

# the third: conjugate of the second
_POLES = np.array((-1.0, np.exp(2j * np.pi / 3.0)))
# numerators of position, velocity and acceleration, and Butterworth's third order
_NUMERATORS = np.array(((2.0, 2.0, 1.0), (2.0, 1.0, 0.0), (1.0, 0.0, 0.0)))
_DENOMINATOR = np.array((1.0, 2.0, 2.0, 1.0))


def _states_by_modes() -> np.ndarray:
    """Return the matrix that maps both filter modes to p, v/ω and a/ω² (real part)."""
    slope = np.polyder(_DENOMINATOR)
    rows = []
    for pole in _POLES:
        numerators = [np.polyval(row, pole) for row in _NUMERATORS]
        rows.append(np.array(numerators) / np.polyval(slope, pole))
    residues = np.array(rows)
    shares = np.array((1.0, 2.0))  # the second mode also stands for its conjugate
    return residues * shares[:, None] / -_POLES[:, None]


def features(states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the features of the continuation, which are independent of a constant offset.

    Parameters
    ----------
    states : numpy.ndarray, shape (..., bandwidths, 3)
        p, v/ω and a/ω² of every filter [m or rad].

    Returns
    -------
    features : numpy.ndarray, shape (..., FEATURES)
        p − level, v/ω and a/ω² of every filter, without p of the level filter [m or rad].
    level : numpy.ndarray, shape (...)
        Position p of the level filter [m or rad].

    """
    level = states[..., LEVEL_FILTER, 0]
    relative = states - level[..., None, None] * np.array((1.0, 0.0, 0.0))
    return np.delete(
        relative.reshape(*level.shape, -1), 3 * LEVEL_FILTER, axis=-1
    ), level


def response(frequencies: np.ndarray) -> np.ndarray:
    """Return the states at t = 0 for y = exp(2πi f t); f is in Hz; shape (f, bandwidths, 3)."""
    s = 2j * np.pi * frequencies[:, None] / BANDWIDTHS
    numerators = np.stack([np.polyval(row, s) for row in _NUMERATORS], axis=-1)
    return numerators / np.polyval(_DENOMINATOR, s)[..., None]


class FilterBank:
    """
    Filters of several axes, which are initially at rest at 0.

    The predictor updates the filters with each estimate, and ends doubts about the estimates.

    Parameters
    ----------
    axes : int

    Attributes
    ----------
    modes : numpy.ndarray, shape (axes, bandwidths, 2)
        Modes z of the poles −ω and ω exp(2πi/3) of every filter [m or rad].
    doubted : numpy.ndarray, shape (axes, bandwidths, 2)
        Part of the modes that errors of doubted estimates have caused [m or rad].

    """

    _RATES = BANDWIDTHS[:, None] * _POLES
    # from real and imaginary parts of the modes to features and level
    _UNITS = np.eye(2 * _RATES.size).view(complex).reshape(-1, *_RATES.shape)
    _OUTPUT = np.column_stack(features((_UNITS @ _states_by_modes()).real))

    def __init__(self, axes: int) -> None:
        self.modes = np.zeros((axes, *self._RATES.shape), complex)
        self.doubted = np.zeros_like(self.modes)

    def update(
        self, interval: float, values: np.ndarray, doubted: np.ndarray | None = None
    ) -> None:
        """
        Update the filters with positions that are constant for an interval [s].

        Parameters
        ----------
        interval : float
        values : numpy.ndarray, shape (axes,)
            [m or rad].
        doubted : numpy.ndarray, shape (axes,), optional
            Errors of doubted estimates in the values; omitted if no axis is in doubt [m or rad].

        """
        decay = np.exp(interval * self._RATES)
        self.modes = _held(self.modes, decay, values)
        if doubted is not None:
            self.doubted = _held(self.doubted, decay, doubted)

    def end_doubt(self, were_wrong: np.ndarray, is_doubted: np.ndarray) -> None:
        """Remove the effect of wrong estimates; keep that of estimates no longer in doubt."""
        wrong = np.where(were_wrong[:, None, None], self.doubted, 0.0)
        self.modes = self.modes - wrong
        self.doubted = np.where(is_doubted[:, None, None], self.doubted, 0.0)

    def features(
        self, without: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """
        Return the features, shape (axes, FEATURES), and the level, shape (axes,) [m or rad].

        Parameters
        ----------
        without : numpy.ndarray, shape (axes, bandwidths, 2), optional
            Modes to subtract [m or rad].

        """
        modes = self.modes if without is None else self.modes - without
        seen = modes.view(float).reshape(len(modes), -1) @ self._OUTPUT
        return seen[:, :-1], seen[:, -1]


def _held(modes: np.ndarray, decay: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the modes after values were constant for a time: z = y + exp(λ t) (z₀ − y)."""
    held = values[:, None, None]
    return held + decay * (modes - held)
