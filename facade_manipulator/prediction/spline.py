"""
Cubic splines through the positions forecast for the horizons.

The spline is "not-a-knot": a cubic, and a multiple of (t − knot)³ after each knot. It is linear in
the positions, so that one matrix product gives the coefficients of all axes.
"""

from __future__ import annotations

from bisect import bisect
import math

import numpy as np

from facade_manipulator.prediction.prior import HORIZONS

LAST_HORIZON = float(HORIZONS[-1])  # s
_KNOTS = HORIZONS[2:-2].tolist()  # s

Pieces = list[
    list[float]
]  #: coefficients of 1, t, t², t³ between the knots, of an axis


_CUBIC = [-math.inf] * 4  # the terms 1, t, t², t³ apply everywhere


def _matrix() -> np.ndarray:
    """Return the matrix that maps positions at the horizons to the coefficients of all pieces."""
    powers = HORIZONS[:, None] ** np.arange(4.0)

    # coefficients of 1, t, t², t³ in each term, and the time from which the term applies
    after_knots = [(-(knot**3), 3.0 * knot**2, -3.0 * knot, 1.0) for knot in _KNOTS]
    terms = np.vstack((np.eye(4), after_knots))
    starts = np.array((*_CUBIC, *_KNOTS))

    values = (powers @ terms.T) * (HORIZONS[:, None] > starts)
    to_terms = np.linalg.inv(values).T
    pieces = []
    for start in (-math.inf, *_KNOTS):
        applying = terms * (starts <= start)[:, None]
        pieces.append(to_terms @ applying)
    return np.hstack(pieces)


_SPLINE = _matrix()


def splines(positions: np.ndarray) -> np.ndarray:
    """Return spline coefficients, shape (..., pieces, 4), for positions, shape (..., HORIZONS)."""
    shape = (*positions.shape[:-1], len(_KNOTS) + 1, 4)
    return (positions @ _SPLINE).reshape(shape)


def motion(pieces: Pieces, t: float) -> tuple[float, float]:
    """
    Return position and velocity of a spline at a time after the estimate [s].

    Plain numbers are twice as fast as numpy when the caches are cold.
    """
    a, b, c, d = pieces[bisect(_KNOTS, t)]
    position = a + t * (b + t * (c + t * d))
    velocity = b + t * (2.0 * c + t * 3.0 * d)
    return position, velocity
