"""
Where the estimator is mounted and how late its stamps are, from a recording.

A second measurement shows the head on the wall, the carriages show it on the rail; what the
estimator publishes must lie between the two. Where the second measurement has its origin does not
matter: its frame is found with the rest. Its axes do not either, unless those of the estimator are
looked for: only axes that are those of `facade` part these from the yaw of the mounting.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import CalibrationError, ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.prediction import EstimateSettings
from facade_manipulator.tools.calibration.robust_fit import rms, robust_fit, robust_scatter
from facade_manipulator.tools.calibration.tables import at_times
from facade_manipulator.tools.calibration.unknowns import (
    AXES,
    DEG,
    heads,
    UNITS,
    Unknown,
    values_of,
    with_values,
)

SOUGHT = {
    'x': Unknown('mounting', 0, 'x of the mounting', 20.0, accepted=0.02),
    'y': Unknown('mounting', 1, 'y of the mounting', 20.0, accepted=0.02),
    'yaw': Unknown('mounting', 2, 'yaw of the mounting', 0.5, DEG, 0.005),
    'delay': Unknown('delay', None, 'delay', 0.5, ('ms', 1e3), 0.01),
    'axes': Unknown('axes', None, 'angle of the axes', np.pi, DEG, 0.005),
}
DEFAULT = ('x', 'y', 'yaw', 'delay')
# after these, x and y of the second measurement's origin and the turn of its axes
TOLERANCES = np.array([*(one.tolerance for one in SOUGHT.values()), 10.0, 10.0, 1.0])
DELAY, ORIGIN, TURN = 3, [5, 6], 7
SMOOTHING = 0.3  # s, well below a period of any gondola
LONGEST_GAP = 1.0  # s
LEAST_OVERLAP = 20.0  # s
MOST_SAMPLES = 3000
MOST_LEFT = 0.5  # of the motion
ALIKE = np.array([0.01, 0.01, 0.01])  # m, m, rad: no instrument is worse
LEAST_MOTION = 5.0  # times what is noise of its velocity
Curve = Callable[[np.ndarray], np.ndarray]


class EstimatorRecording(NamedTuple):
    """What a fit is made of, each of shape (n, 4); the first column of each is the stamp [s]."""

    disturbance: np.ndarray  #: as published: x, y, θ [m, m, rad]
    joints: np.ndarray  #: positions of the carriages [m]
    wall: np.ndarray  #: the head on the wall: x, y, θ [m, m, rad]; NaN where not measured


class EstimatorFit(NamedTuple):
    """What was found."""

    settings: EstimateSettings  #: with what was found; the rest is as it was
    deviations: dict[str, float]  #: standard ones of what was looked for [m, rad or s], by name
    turn: float  #: from the axes of `facade` to those of the second measurement [rad]
    residual: np.ndarray  #: RMS of what remains on the wall, shape (3,); NaN where not measured


def fit_estimator(
    geometry: Geometry, recording: EstimatorRecording, find: Sequence[str] = DEFAULT,
    present: EstimateSettings | None = None,
) -> EstimatorFit:
    """
    Find mounting, delay and axes of an estimator on a machine whose geometry is calibrated.

    `find` has names of `SOUGHT`; with ``'axes'`` the second measurement has the axes of `facade`.
    `present` holds for the rest. Raises a ParameterError for an unknown name, a
    CalibrationError if the recording has gaps, is too short or cannot show what is looked for.
    """
    unknown = [name for name in find if name not in SOUGHT]
    if unknown:
        raise ParameterError(f'{unknown[0]} is not one of {", ".join(SOUGHT)}')
    disturbance, joints, wall = _in_common(recording)
    times = wall[:, 0]
    head = heads(geometry, at_times(joints, times))
    if np.isnan(head).any():
        raise CalibrationError(
            f'joints: {times[np.isnan(head).any(axis=1)][0]:.2f} s after the first disturbance '
            'the links do not close; another geometry, unit or order of the carriages?')
    free = [k for k, name in enumerate(SOUGHT) if name in find] + ORIGIN
    if 'axes' not in find:
        free.append(TURN)
    return _Fit(_smoothed(disturbance), times, head, wall[:, 1:], free).solve(
        present or EstimateSettings())


def _in_common(recording: EstimatorRecording) -> EstimatorRecording:
    """Return the recording, of the wall only while there is the rest; its time begins at 0."""
    for name in ('disturbance', 'joints'):
        _check_stamps(name, getattr(recording, name), LONGEST_GAP)
    _check_stamps('wall', recording.wall, np.inf)  # between its rows nothing is interpolated
    start = recording.disturbance[0, 0]  # seconds since 1970 leave too few digits for a delay
    disturbance, joints, wall = (table - [start, 0.0, 0.0, 0.0] for table in recording)
    begin = max(table[0, 0] for table in (disturbance, joints, wall)) + 0.5
    end = min(table[-1, 0] for table in (disturbance, joints, wall)) - 0.5
    if end - begin < LEAST_OVERLAP:
        raise CalibrationError(
            f'the three recordings have {max(end - begin, 0.0):.1f} s in common, '
            f'{LEAST_OVERLAP:g} s are needed')
    wall = wall[(wall[:, 0] >= begin) & (wall[:, 0] <= end)]
    if not np.isfinite(wall[:, 1:]).any():
        raise CalibrationError(
            f'wall: nothing of {", ".join(AXES)} is measured while there is the rest')
    return EstimatorRecording(disturbance, joints, wall[::max(1, len(wall) // MOST_SAMPLES)])


def _check_stamps(name: str, table: np.ndarray, longest_gap: float) -> None:
    stamps = table[:, 0]
    steps = np.diff(stamps)
    if len(stamps) < 2 or (steps <= 0.0).any():
        row = int(np.argmax(steps <= 0.0)) + 2 if len(stamps) > 1 else 1
        raise CalibrationError(f'{name}: the time must ascend, row {row} does not')
    if steps.max() > longest_gap:
        gap = int(np.argmax(steps))
        raise CalibrationError(
            f'{name}: a gap of {steps[gap]:.2f} s after row {gap + 1}, at {stamps[gap]:.2f} s; '
            f'bound {longest_gap:g} s')


def _smoothed(disturbance: np.ndarray) -> Curve:
    """
    Return the published disturbance as a smooth function of its stamps.

    Raises a CalibrationError if it moves no more than its noise, which would look like a motion.
    """
    from scipy.interpolate import CubicSpline
    from scipy.signal import savgol_coeffs, savgol_filter

    stamps = disturbance[:, 0]
    step = float(np.median(np.diff(stamps)))
    grid = np.arange(stamps[0], stamps[-1], step)
    even = at_times(disturbance, grid)
    window = max(5, 2 * int(0.5 * SMOOTHING / step) + 1)
    smooth = savgol_filter(even, window, 3, axis=0)
    of_noise = (even - smooth).std(axis=0) * np.linalg.norm(
        savgol_coeffs(window, 3, deriv=1, delta=step))
    if (np.gradient(smooth, step, axis=0).std(axis=0) < LEAST_MOTION * of_noise).all():
        raise CalibrationError('the gondola hangs still: the disturbance moves no more than its '
                               'noise; let it sway and turn')
    return CubicSpline(grid, smooth, extrapolate=False)


class _Fit(NamedTuple):
    """The head on the rail and on the wall at the same times, and what is free between them."""

    published: Curve
    times: np.ndarray
    head: np.ndarray
    wall: np.ndarray
    free: list[int]

    def solve(self, present: EstimateSettings) -> EstimatorFit:
        values = np.append(values_of(present, SOUGHT.values()), [0.0, 0.0, 0.0])
        values[ORIGIN] = np.nan_to_num(
            np.ma.masked_invalid(self.misses(values)).mean(axis=0).filled(0.0)[:2])
        noise, tolerances = np.full(3, 1e-2), TOLERANCES[self.free]

        def with_free(free: np.ndarray) -> np.ndarray:
            changed = values.copy()
            changed[self.free] = np.clip(free, -tolerances, tolerances)
            return changed

        for _ in range(2):  # with weights guessed, then with those of the residuals
            found, rates = robust_fit(
                lambda free: (self.misses(with_free(free)) / noise).compressed(),  # noqa: B023
                np.zeros(len(tolerances)), tolerances, values[self.free])
            values = with_free(found)
            remains = self.misses(values)
            noise = np.maximum(np.ma.filled(robust_scatter(remains), 0.0), 1e-9)
        residual = rms(remains)
        _check_agreement(residual, self.published(self.times).std(axis=0))
        deviations = self._deviations(rates, (remains / noise).filled(0.0))
        _check_shown(deviations)
        return EstimatorFit(
            with_values(present, SOUGHT.values(), values[:len(SOUGHT)]), deviations,
            float(values[TURN]), residual)

    def misses(self, values: np.ndarray) -> np.ma.MaskedArray:
        """Return measured less expected on the wall, shape (m, 3); masked where not measured."""
        published = self.published(self.times + values[DELAY])
        return np.ma.array(self.wall - _expected(values, published, self.head),
                           mask=~np.isfinite(self.wall))

    def _deviations(self, rates: np.ndarray, weighed: np.ndarray) -> dict[str, float]:
        """Return the deviations by name; residuals that are alike count as fewer."""
        measured = np.flatnonzero(np.isfinite(self.wall).any(axis=0))
        inflation = max(_correlation(weighed[:, k]) for k in measured)
        covariance = np.linalg.inv(rates.T @ rates / inflation + np.eye(len(self.free)))
        deviations = np.sqrt(np.diag(covariance)) * TOLERANCES[self.free]
        names = dict(enumerate(SOUGHT))
        return {names[k]: float(deviation) for k, deviation in zip(
            self.free, deviations, strict=True) if k in names}


def _expected(values: np.ndarray, published: np.ndarray, head: np.ndarray) -> np.ndarray:
    """Return the head on the wall: frame of the wall, rail of the estimator, head on the rail."""
    x, y, yaw, _, axes, *origin, turn = values
    theta = published[:, 2] - yaw
    moved = _turned(published[:, :2], axes) + [x, y] + _turned(head[:, :2] - [x, y], theta)
    return np.column_stack([_turned(moved, turn) + origin, theta + turn + head[:, 2]])


def _turned(points: np.ndarray, angles: np.ndarray | float) -> np.ndarray:
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


def _check_agreement(residual: np.ndarray, motion: np.ndarray) -> None:
    """Reject what leaves much of the motion over: no mounting does, another unit or sign does."""
    for axis, left, moved, alike, (unit, factor) in zip(
            AXES, residual, motion, ALIKE, UNITS, strict=True):
        if left > alike and left > MOST_LEFT * moved:
            raise CalibrationError(
                f'the recordings contradict each other: {left * factor:.3g} {unit} RMS of the '
                f"head's {axis} remain, of a motion of {moved * factor:.3g} {unit}; another unit, "
                'sign or order of the axes in one of them?')


def _check_shown(deviations: dict[str, float]) -> None:
    blind = [f'{SOUGHT[name].words} (+- {deviation * factor:.3g} {unit})'
             for name, deviation in deviations.items()
             for unit, factor in [SOUGHT[name].unit] if deviation > SOUGHT[name].accepted]
    if blind:
        shown = [name for name, deviation in deviations.items()
                 if deviation <= SOUGHT[name].accepted]
        raise CalibrationError(
            f'the recording cannot show {", ".join(blind)}: the gondola must sway and turn, and '
            f'{", ".join(AXES)} of the head be measured on the wall'
            + (f'; or look for less with --find {" ".join(shown)}' if shown else ''))


def report_estimator(found: EstimatorFit) -> list[str]:
    """Return what was found, line by line."""
    lines = [
        f'{SOUGHT[name].words:20s} {value * factor:+9.2f} +- {deviation * factor:.2f} {unit}'
        for name, deviation in found.deviations.items()
        for value in values_of(found.settings, [SOUGHT[name]])
        for unit, factor in [SOUGHT[name].unit]]
    lines += [f'{axis} of the head: {value * factor:.2f} {unit} RMS remain'
              for axis, value, (unit, factor) in zip(AXES, found.residual, UNITS, strict=True)
              if np.isfinite(value)]
    if 'axes' not in found.deviations:
        lines.append("the second measurement's axes are turned by "
                     f'{np.rad2deg(found.turn):+.2f} deg from those of facade')
    return lines
