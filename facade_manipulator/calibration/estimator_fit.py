"""
Where the estimator is mounted and how late its stamps are, from a recording.

A second measurement shows the head on the wall, the carriages show it on the rail; what the
estimator publishes must lie between the two. Where the second measurement has its origin does not
matter: its frame is found with the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from facade_manipulator.calibration.geometry_fit import AXES, FAR, HUBER
from facade_manipulator.calibration.unknowns import heads
from facade_manipulator.errors import CalibrationError
from facade_manipulator.kinematics import Geometry

NAMES = ('x of the mounting', 'y of the mounting', 'yaw of the mounting', 'delay')
UNITS = (('mm', 1e3), ('mm', 1e3), ('deg', 180.0 / np.pi), ('ms', 1e3))
ACCEPTED = np.array([0.02, 0.02, 0.005, 0.01])  # m, m, rad, s: known no better, nothing is found
TOLERANCES = np.array([2.0, 2.0, 0.2, 0.2, 10.0, 10.0, 1.0])
SMOOTHING = 0.3  # s, well below a period of any gondola
LONGEST_GAP = 1.0  # s
LEAST_OVERLAP = 20.0  # s
MOST_SAMPLES = 3000
Curve = Callable[[np.ndarray], np.ndarray]


class EstimatorFit(NamedTuple):
    """
    What was found.

    Parameters
    ----------
    mounting : tuple of three floats
        x, y, yaw on the rail [m, m, rad].
    delay : float
        Of the stamps [s].
    deviations : ndarray, shape (4,)
        Standard deviations of x, y, yaw and delay.
    turn : float
        Angle from the estimator's axes to those of the second measurement [rad].
    residual : ndarray, shape (3,)
        RMS of what remains on the wall; NaN where not measured.

    """

    mounting: tuple[float, float, float]
    delay: float
    deviations: np.ndarray
    turn: float
    residual: np.ndarray


def fit_estimator(
    geometry: Geometry, disturbance: np.ndarray, joints: np.ndarray, wall: np.ndarray
) -> EstimatorFit:
    """
    Find mounting and delay of an estimator.

    Parameters
    ----------
    geometry : Geometry
        Of the machine, calibrated.
    disturbance, joints, wall : ndarray, shape (n, 4)
        Stamps [s] with the disturbance as published, the carriages' positions and the head on
        the wall [m, m, rad]; NaN in the last where not measured.

    Raises
    ------
    CalibrationError
        If the recording has gaps, is too short or cannot show what is looked for.

    """
    for name, table in (('disturbance', disturbance), ('joints', joints), ('wall', wall)):
        _check_stamps(name, table[:, 0])
    start = disturbance[0, 0]  # seconds since 1970 leave too few digits for a delay
    disturbance, joints, wall = (table - [start, 0.0, 0.0, 0.0] for table in (
        disturbance, joints, wall))
    begin = max(table[0, 0] for table in (disturbance, joints, wall)) + 0.5
    end = min(table[-1, 0] for table in (disturbance, joints, wall)) - 0.5
    if end - begin < LEAST_OVERLAP:
        raise CalibrationError(
            f'the three recordings have {max(end - begin, 0.0):.1f} s in common, '
            f'{LEAST_OVERLAP:g} s are needed')
    wall = wall[(wall[:, 0] >= begin) & (wall[:, 0] <= end)]
    wall = wall[::max(1, len(wall) // MOST_SAMPLES)]
    times = wall[:, 0]
    carriages = np.column_stack([
        np.interp(times, joints[:, 0], joints[:, k]) for k in (1, 2, 3)])
    return _fit(_smoothed(disturbance), times, heads(geometry, carriages), wall[:, 1:])


def _check_stamps(name: str, stamps: np.ndarray) -> None:
    steps = np.diff(stamps)
    if len(stamps) < 2 or (steps <= 0.0).any():
        row = int(np.argmax(steps <= 0.0)) + 2 if len(stamps) > 1 else 1
        raise CalibrationError(f'{name}: the time must ascend, row {row} does not')
    if steps.max() > LONGEST_GAP:
        gap = int(np.argmax(steps))
        raise CalibrationError(
            f'{name}: a gap of {steps[gap]:.2f} s after row {gap + 1}, at {stamps[gap]:.2f} s; '
            f'bound {LONGEST_GAP:g} s')


def _smoothed(disturbance: np.ndarray) -> Curve:
    """Return the published disturbance as a smooth function of its stamps."""
    from scipy.interpolate import CubicSpline
    from scipy.signal import savgol_filter

    stamps = disturbance[:, 0]
    step = float(np.median(np.diff(stamps)))
    grid = np.arange(stamps[0], stamps[-1], step)
    even = np.column_stack([np.interp(grid, stamps, disturbance[:, k]) for k in (1, 2, 3)])
    window = max(5, 2 * int(0.5 * SMOOTHING / step) + 1)
    return CubicSpline(grid, savgol_filter(even, window, 3, axis=0), extrapolate=False)


def _fit(
    published: Curve, times: np.ndarray, head: np.ndarray, wall: np.ndarray
) -> EstimatorFit:
    there = np.isfinite(wall)

    def misses(values: np.ndarray) -> np.ndarray:
        expected = _expected(values, published(times + values[3]), head)
        return np.where(there, wall - expected, 0.0)

    values = np.zeros(len(TOLERANCES))
    values[4:6] = misses(values)[:, :2].mean(axis=0)
    noise = np.full(3, 1e-2)
    for _ in range(2):  # with weights guessed, then with those of the residuals
        values, rates = _solve(misses, values, noise, there)
        remains = misses(values)
        noise = np.maximum(1.4826 * np.median(np.abs(remains), axis=0), 1e-9)
    deviations = _deviations(rates, remains / noise, there)
    _check_shown(deviations)
    counts = np.where(there.any(axis=0), there.sum(axis=0), np.nan)
    return EstimatorFit(
        tuple(values[:3].tolist()), float(values[3]), deviations, float(values[6]),
        np.sqrt((remains ** 2).sum(axis=0) / counts))


def _solve(
    misses: Curve, values: np.ndarray, noise: np.ndarray, there: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the values that fit best, and the weighed Jacobian in units of the tolerances."""
    from scipy.optimize import least_squares

    def residuals(scaled: np.ndarray) -> np.ndarray:
        weighed = (misses(np.clip(scaled, -1.0, 1.0) * TOLERANCES) / noise)[there]
        return np.concatenate([np.nan_to_num(weighed, nan=FAR), scaled])

    found = least_squares(residuals, values / TOLERANCES, loss='huber', f_scale=HUBER,
                          diff_step=1e-7, x_scale='jac')
    return found.x * TOLERANCES, found.jac[:-len(TOLERANCES)]


def _deviations(rates: np.ndarray, weighed: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Return the deviations of x, y, yaw and delay; residuals that are alike count as fewer."""
    inflation = max(_correlation(weighed[:, k]) for k in np.flatnonzero(there.any(axis=0)))
    covariance = np.linalg.inv(rates.T @ rates / inflation + np.eye(len(TOLERANCES)))
    return np.sqrt(np.diag(covariance))[:4] * TOLERANCES[:4]


def _expected(values: np.ndarray, published: np.ndarray, head: np.ndarray) -> np.ndarray:
    """Return the head on the wall: frame of the wall, rail of the estimator, head on the rail."""
    x, y, yaw, _, *origin, turn = values
    theta = published[:, 2] - yaw
    moved = published[:, :2] + [x, y] + _turned(head[:, :2] - [x, y], theta)
    return np.column_stack([
        _turned(moved, np.full(len(theta), turn)) + origin, theta + turn + head[:, 2]])


def _turned(points: np.ndarray, angles: np.ndarray) -> np.ndarray:
    cosine, sine = np.cos(angles), np.sin(angles)
    return np.column_stack([
        cosine * points[:, 0] - sine * points[:, 1], sine * points[:, 0] + cosine * points[:, 1]])


def _correlation(values: np.ndarray) -> float:
    """Return how many samples of a series count as one: 1 + 2 Σ ρ up to its first zero."""
    spectrum = np.abs(np.fft.rfft(values - values.mean(), 2 * len(values))) ** 2
    rho = np.fft.irfft(spectrum)[:len(values)]
    rho /= max(rho[0], 1e-300)
    last = int(np.argmax(rho <= 0.0)) or len(rho)
    return float(1.0 + 2.0 * rho[1:last].sum())


def _check_shown(deviations: np.ndarray) -> None:
    blind = [f'{name} (+- {deviation * factor:.3g} {unit})'
             for name, deviation, accepted, (unit, factor) in zip(
                 NAMES, deviations, ACCEPTED, UNITS, strict=True) if deviation > accepted]
    if blind:
        raise CalibrationError(
            f'the recording cannot show {", ".join(blind)}: the gondola must sway and turn, and '
            f'{", ".join(AXES)} of the head be measured on the wall')


def report_estimator(found: EstimatorFit) -> list[str]:
    """Return what was found, line by line."""
    values = (*found.mounting, found.delay)
    lines = [f'{name:20s} {value * factor:+9.2f} +- {deviation * factor:.2f} {unit}'
             for name, value, deviation, (unit, factor) in zip(
                 NAMES, values, found.deviations, UNITS, strict=True)]
    lines += [f'{axis} of the head: {value * factor:.2f} {unit} RMS remain'
              for axis, value, (unit, factor) in zip(AXES, found.residual, UNITS, strict=False)
              if np.isfinite(value)]
    lines.append("the second measurement's axes are turned by "
                 f"{np.rad2deg(found.turn):+.2f} deg from the estimator's")
    return lines
