"""Where the wall lies in frame facade, from places where the head has touched it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from facade_manipulator.calibration.geometry_fit import HUBER, OUTLIER
from facade_manipulator.calibration.unknowns import heads
from facade_manipulator.errors import CalibrationError
from facade_manipulator.kinematics import compose, Geometry, Pose

LEAST_TOUCHES = 3
ACCEPTED = np.array([0.01, 0.01])  # m, rad: known no better, the wall has not been found


class WallFit(NamedTuple):
    """
    A straight wall.

    Parameters
    ----------
    distance : float
        y of the wall at x = 0 [m].
    angle : float
        From x to the wall [rad].
    deviations : ndarray, shape (2,)
        Standard deviations of both.
    residuals : ndarray, shape (n,)
        Of the touches, away from the wall [m].
    outliers : list of int
        Rows that contradict the others.

    """

    distance: float
    angle: float
    deviations: np.ndarray
    residuals: np.ndarray
    outliers: list[int]


def touched_points(geometry: Geometry, carriages: np.ndarray, rails: np.ndarray) -> np.ndarray:
    """
    Return where the head touched, in frame facade, shape (n, 2) [m].

    Parameters
    ----------
    geometry : Geometry
    carriages : ndarray, shape (n, 3)
        Positions at the touch [m].
    rails : ndarray, shape (n, 3)
        Pose of the rail in facade then, as estimated; NaN for a rail at rest [m, m, rad].

    Raises
    ------
    CalibrationError
        If the links do not close at a row.

    """
    seen = heads(geometry, carriages)
    if np.isnan(seen).any():
        row = int(np.argmax(np.isnan(seen).any(axis=1)))
        raise CalibrationError(f'row {row + 1}: the links do not close there')
    return np.array([
        compose(Pose(*rail), Pose(*head))[:2]
        for rail, head in zip(np.nan_to_num(rails).tolist(), seen.tolist(), strict=True)])


def fit_wall(points: np.ndarray, noise: float = 1e-3) -> WallFit:
    """
    Fit a straight wall to touches.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        In frame facade [m].
    noise : float
        Standard deviation of a touch [m].

    Raises
    ------
    CalibrationError
        If there are too few, they are too near to each other, or no straight wall explains them.

    """
    from scipy.optimize import least_squares

    if len(points) < LEAST_TOUCHES:
        raise CalibrationError(
            f'{len(points)} touches: {LEAST_TOUCHES} are needed, better with some to spare')

    def misses(wall: np.ndarray) -> np.ndarray:
        distance, angle = wall
        return (points[:, 1] - distance) * np.cos(angle) - points[:, 0] * np.sin(angle)

    found = least_squares(lambda wall: misses(wall) / noise,
                          [np.median(points[:, 1]), 0.0], loss='huber', f_scale=HUBER)
    residuals = misses(found.x)
    information = found.jac.T @ found.jac
    deviations = np.sqrt(np.diag(np.linalg.pinv(information + 1e-9 * np.eye(2))))
    if (deviations > ACCEPTED).any():
        raise CalibrationError(
            f'the touches lie within {np.ptp(points[:, 0]):.3g} m along the wall: its angle '
            f'would be known to {np.rad2deg(deviations[1]):.2g} deg only')
    outliers = np.flatnonzero(np.abs(residuals) > OUTLIER * noise).tolist()
    if outliers and len(points) - len(outliers) <= LEAST_TOUCHES:
        raise CalibrationError(
            f'no straight wall explains the touches: they are off by up to '
            f'{1e3 * np.abs(residuals).max():.2g} mm')
    return WallFit(*found.x.tolist(), deviations, residuals, outliers)


def report_wall(found: WallFit) -> list[str]:
    """Return what was found, line by line."""
    distance, angle = found.deviations
    lines = [f'distance at x = 0   {found.distance * 1e3:+9.2f} +- {distance * 1e3:.2f} mm',
             f'angle to x          {np.rad2deg(found.angle):+9.3f} +- {np.rad2deg(angle):.3f} deg']
    lines += [f'row {row + 1}: {1e3 * miss:+.2f} mm off the wall'
              + (', an outlier' if row in found.outliers else '')
              for row, miss in enumerate(found.residuals)]
    return lines
