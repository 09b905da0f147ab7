"""Where the wall lies in frame facade, from places where the head has touched it."""

from __future__ import annotations

from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import CalibrationError
from facade_manipulator.kinematics import compose, Geometry, Pose
from facade_manipulator.prediction.estimate import EstimateSettings
from facade_manipulator.tools.calibration.robust_fit import HUBER, OUTLIER, robust_scatter
from facade_manipulator.tools.calibration.unknowns import heads, require_closed

LEAST_TOUCHES, MOST_LISTED = 3, 20
YIELDS = 1e-3  # m/N, of a soft brush: what is known of it beforehand
ACCEPTED = np.array([0.01, 0.01])  # m, rad: known no better, the wall has not been found


class WallFit(NamedTuple):
    """A straight wall."""

    distance: float  #: y of the wall at x = 0 [m]
    angle: float  #: from x to the wall [rad]
    yields: float  #: how far brush and wall give way to a force [m/N]; 0 where none was measured
    deviations: np.ndarray  #: standard deviations of distance and angle, shape (2,) [m, rad]
    residuals: np.ndarray  #: of the touches, away from the wall, shape (n,) [m]
    outliers: list[int]  #: rows that contradict the others


def touched_points(geometry: Geometry, carriages: np.ndarray, rails: np.ndarray) -> np.ndarray:
    """
    Return where the head touched, in frame facade, shape (n, 2) [m].

    Carriages are positions at the touch, shape (n, 3) [m]; rails poses of the rail in facade then,
    as estimated, shape (n, 3) [m, m, rad], NaN for a rail at rest. Raises a CalibrationError if
    the links do not close at a row.
    """
    seen = heads(geometry, carriages)
    require_closed(seen, carriages)
    return np.array([
        compose(Pose(*rail), Pose(*head))[:2]
        for rail, head in zip(np.nan_to_num(rails).tolist(), seen.tolist(), strict=True)])


def mean_by_second(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the means of the rows that fall into the same second, shape (seconds, k)."""
    _, second = np.unique(np.floor(times), return_inverse=True)
    return np.column_stack([
        np.bincount(second, column) / np.bincount(second) for column in values.T])


def fit_wall(
    points: np.ndarray, noise: float = 1e-3, forces: np.ndarray | None = None
) -> WallFit:
    """
    Fit a straight wall to touches in frame facade, shape (n, 2) [m], with their noise [m].

    Of forces of the head on the wall, shape (n,) [N], NaN where not measured, what gives way to
    them is found, and the wall is where it was touched without force. Raises a CalibrationError if
    there are too few, they are too near to each other, or no straight wall explains them.
    """
    from scipy.optimize import least_squares

    if len(points) < LEAST_TOUCHES:
        raise CalibrationError(
            f'{len(points)} touches: {LEAST_TOUCHES} are needed, better with some to spare')

    pressed = np.zeros(len(points)) if forces is None else np.nan_to_num(forces)

    def misses(wall: np.ndarray) -> np.ndarray:
        distance, angle, yields = wall
        return ((points[:, 1] - distance) * np.cos(angle) - points[:, 0] * np.sin(angle)
                - YIELDS * yields * pressed)

    found = least_squares(lambda wall: np.append(misses(wall) / noise, wall[2]),
                          [np.median(points[:, 1]), 0.0, 0.0], loss='huber', f_scale=HUBER)
    residuals = misses(found.x)
    deviations = np.sqrt(np.diag(np.linalg.pinv(
        found.jac.T @ found.jac + 1e-9 * np.eye(3))))[:2]
    _check_shown(points, deviations)
    outliers = np.flatnonzero(np.abs(residuals) > OUTLIER * noise).tolist()
    if outliers and len(points) - len(outliers) <= LEAST_TOUCHES:
        raise CalibrationError(
            f'no straight wall explains the touches: they are off by up to '
            f'{1e3 * np.abs(residuals).max():.2g} mm')
    deviations *= max(1.0, robust_scatter(residuals) / noise)
    distance, angle, yields = found.x.tolist()
    return WallFit(distance, angle, YIELDS * yields, deviations, residuals, outliers)


def _check_shown(points: np.ndarray, deviations: np.ndarray) -> None:
    distance, angle = deviations > ACCEPTED
    if angle:
        raise CalibrationError(
            f'the touches lie within {np.ptp(points[:, 0]):.3g} m along the wall: its angle '
            f'would be known to {np.rad2deg(deviations[1]):.2g} deg only')
    if distance:
        raise CalibrationError(
            'the force is the same at all touches: what gives way to it cannot be known, and the '
            f'distance to {1e3 * deviations[0]:.2g} mm only; touch with less force too')


def along_wall(estimate: EstimateSettings, found: WallFit) -> tuple[EstimateSettings, float]:
    """
    Turn frame facade so that its x lies along the wall.

    Returns by what estimates are those of the rail in that frame, and the wall's distance there.
    """
    x, y, yaw = estimate.mounting
    turned = replace(estimate, mounting=(x, y, yaw + found.angle),
                     axes=math.remainder(estimate.axes - found.angle, math.tau))
    # the estimator's place at rest stays where it was, the rest turns about it
    cosine, sine = math.cos(found.angle), math.sin(found.angle)
    return turned, cosine * (found.distance - y) + sine * x + y


def report_wall(found: WallFit) -> list[str]:
    """Return what was found, line by line."""
    distance, angle = found.deviations
    lines = [f'distance at x = 0   {found.distance * 1e3:+9.2f} +- {distance * 1e3:.2f} mm',
             f'angle to x          {np.rad2deg(found.angle):+9.3f} +- {np.rad2deg(angle):.3f} deg']
    if found.yields:
        lines.append(f'gives way by        {found.yields * 1e3:+9.3f} mm/N')
    lines.append(f'{len(found.residuals)} touches, '
                 f'{1e3 * np.sqrt(np.mean(found.residuals ** 2)):.2f} mm RMS off the wall')
    few = len(found.residuals) <= MOST_LISTED
    lines += [f'row {row + 1}: {1e3 * miss:+.2f} mm off the wall'
              + (', an outlier' if row in found.outliers else '')
              for row, miss in enumerate(found.residuals) if few or row in found.outliers]
    return lines
