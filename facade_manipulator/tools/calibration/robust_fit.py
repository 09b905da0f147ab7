"""Robust least squares in which what is known beforehand is one more measurement."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

HUBER = 2.5
OUTLIER = 4.5  # standard deviations
FAR = 1e6  # standard deviations, of what cannot be


def robust_fit(
    misses: Callable[[np.ndarray], np.ndarray], expected: np.ndarray, tolerances: np.ndarray,
    begin: np.ndarray, least: np.ndarray | float = -np.inf, loss: str = 'huber',
) -> tuple[np.ndarray, np.ndarray]:
    """
    Find the values of which something follows that is nearest to what was measured.

    Of values, shape (m,), `misses` returns measured less expected in standard deviations, shape
    (n,), NaN where nothing follows. They are `expected` beforehand, with `tolerances` as standard
    deviations; the search begins at `begin` and keeps above `least`; scipy names the loss.
    Returns the values, and the change of the misses with them in tolerances, shape (n, m).
    """
    from scipy.optimize import least_squares  # not of the machine's own needs

    def residuals(scaled: np.ndarray) -> np.ndarray:
        return np.append(
            np.nan_to_num(misses(expected + tolerances * scaled), nan=FAR), scaled)

    found = least_squares(
        residuals, (begin - expected) / tolerances, loss=loss, f_scale=HUBER,
        bounds=((least - expected) / tolerances, np.inf), diff_step=1e-4, xtol=1e-10)
    return expected + tolerances * found.x, found.jac[:-len(tolerances)]


def robust_scatter(misses: np.ndarray) -> np.ndarray:
    """Return the standard deviations of columns about 0, whatever a few of their values are."""
    return 1.4826 * np.ma.median(np.ma.abs(misses), axis=0)


def rms(values: np.ndarray) -> np.ndarray:
    """Return the root mean square of each column's numbers; NaN where it has none."""
    return np.ma.sqrt((np.ma.masked_invalid(values) ** 2).mean(axis=0)).filled(np.nan)
