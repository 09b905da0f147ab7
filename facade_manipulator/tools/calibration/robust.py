"""Robust least squares, and a report of parameter combinations that the data do not determine."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

INLIER_RESIDUAL = 2.5  # standard deviations, up to which the loss is nearly quadratic
OUTLIER_RESIDUAL = 4.5  # standard deviations
FAR_RESIDUAL = 1e6  # standard deviations, value of a residual that cannot be evaluated


def fit(
    residuals: Callable[[np.ndarray], np.ndarray], start: np.ndarray, loss: str
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the least-squares parameters, and the Jacobian of the residuals at this solution.

    Parameters
    ----------
    residuals : callable
        Measured minus expected in standard deviations of the noise, shape (n,), from parameters of
        shape (m,) that are scaled to values of about 1. NaN where a value is undefined.
    start : ndarray, shape (m,)
    loss : str
        Loss of scipy's `least_squares`: ``'linear'``, ``'soft_l1'`` where some rows may be wrong.

    Returns
    -------
    parameters : ndarray, shape (m,)
    jacobian : ndarray, shape (n, m)
        Weighted by the loss.

    """
    # imported here, because nodes run without scipy
    from scipy.optimize import least_squares

    def finite(parameters: np.ndarray) -> np.ndarray:
        return np.nan_to_num(residuals(parameters), nan=FAR_RESIDUAL)

    found = least_squares(
        finite, start, loss=loss, f_scale=INLIER_RESIDUAL, diff_step=1e-4, xtol=1e-10
    )
    return found.x, found.jac


LEAST_SHARE = 0.3  # of a parameter in the unit vector of a combination


def unidentified(
    jacobian: np.ndarray, needed: np.ndarray, names: Sequence[str]
) -> list[str]:
    """
    Describe the parameter combinations that the data do not determine.

    A combination is a right singular vector of the Jacobian in units of the required standard
    deviations. A singular value below 1 means a deviation larger than required.

    Parameters
    ----------
    jacobian : ndarray, shape (n, m)
        Of residuals in standard deviations of the noise.
    needed : ndarray, shape (m,)
        Required standard deviation of each parameter.
    names : sequence of str
        Names of the m parameters.

    """
    _, values, vectors = np.linalg.svd(jacobian * needed, full_matrices=False)
    combinations = []
    for vector in vectors[values < 1.0]:
        involved = np.array(names)[np.abs(vector) > LEAST_SHARE]
        combinations.append(' apart from '.join(involved))
    return combinations


def deviation(residuals: np.ndarray) -> np.ndarray:
    """Return the standard deviation of each column about 0, computed from the median."""
    return np.asarray(1.4826 * np.median(np.abs(residuals), axis=0))
