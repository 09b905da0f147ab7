"""
Where the estimator is mounted and how late its stamps are, from a recording.

A second measurement shows the head on the wall, the carriages show it on the rail; what the
estimator publishes must lie between the two. Where the second measurement has its origin, how
slowly either drifts, and how late it is stamped does not matter: that is found with the rest. How
late shows only while the head moves on the rail. Its axes do not matter either, unless those of
the estimator are looked for: only axes that are those of `facade` part these from the yaw of the
mounting.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import CalibrationError, ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.prediction.estimate import EstimateSettings
from facade_manipulator.tools.calibration import unknowns
from facade_manipulator.tools.calibration.robust_fit import HUBER, robust_fit, robust_scatter
from facade_manipulator.tools.calibration.tables import at_times, require_dense
from facade_manipulator.tools.calibration.unknowns import AXES, DEG, UNITS, Unknown

LONGEST_DELAY = 0.5  # s
SOUGHT = {
    'x': Unknown('mounting', 0, 'x of the mounting', 20.0, accepted=0.02),
    'y': Unknown('mounting', 1, 'y of the mounting', 20.0, accepted=0.02),
    'yaw': Unknown('mounting', 2, 'yaw of the mounting', 0.5, DEG, 0.005),
    'delay': Unknown('delay', None, 'delay', LONGEST_DELAY, ('ms', 1e3), 0.01),
    'axes': Unknown('axes', None, 'angle of the axes', np.pi, DEG, 0.005),
}
DEFAULT = ('x', 'y', 'yaw', 'delay')
DRIFT = 3  # degree of the polynomial by which the second measurement's frame wanders
WANDERS = (DRIFT + 1) * [0.1]  # m, rad
# after these how late the second measurement is, then its frame's x, y and turn: where it is, by
# degree of its drift, and by how much it was knocked
TOLERANCES = np.array([
    *(one.tolerance for one in SOUGHT.values()), LONGEST_DELAY,
    10.0, *WANDERS, 10.0, *WANDERS, 1.0, *WANDERS])
DELAY, LATE, FRAME = 3, 5, 6
ORIGIN, TURN = [FRAME, FRAME + DRIFT + 2], FRAME + 2 * (DRIFT + 2)
KNOCKED = 0.2  # of the residuals' variance that a knock explains
LONGEST_GAP = 1.0  # s
LEAST_OVERLAP = 20.0  # s
MOST_SAMPLES = 2000
MOST_LEFT = 0.5  # of the motion
ALIKE = np.array([0.01, 0.01, 0.01])  # m, m, rad: no instrument is worse
PENALTIES = 10.0 ** np.arange(-2.0, 14.0, 0.25)  # of the smoothing, from none to a constant
OUTLIER, FAR_OFF = 6.0, 20.0  # standard deviations from neighbours, from a fit
CLOCKS = np.arange(-30.0, 30.0, 0.1)  # s, by which one may be wrong
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
    late: float  #: how late the second measurement is stamped [s]
    drift: np.ndarray  #: by which its frame wandered, shape (3,) [m, m, rad]
    knocked: float  #: after which time one of the frames jumped [s]; infinity for never
    #: standard deviation on the wall without outliers, shape (3,); NaN where not measured
    residual: np.ndarray


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
    head = unknowns.heads(geometry, joints[:, 1:])
    if np.isnan(head).any():
        raise CalibrationError(
            f'joints: {joints[np.isnan(head).any(axis=1), 0][0]:.2f} s after the first '
            'disturbance the links do not close; another geometry, unit or order of the '
            'carriages?')
    free = [k for k, name in enumerate(SOUGHT) if name in find] + [
        k for k in range(LATE, len(TOLERANCES)) if k != TURN or 'axes' not in find]
    return _Fit(_smoothed(disturbance), _curve(joints[:, 0], head), wall[:, 0], wall[:, 1:],
                free).solve(present or EstimateSettings())


def _in_common(recording: EstimatorRecording) -> EstimatorRecording:
    """Return the recording, of the wall only while there is the rest; its time begins at 0."""
    for name in ('disturbance', 'joints'):
        _check_stamps(name, getattr(recording, name), LONGEST_GAP)
    _check_stamps('wall', recording.wall, np.inf)  # between its rows nothing is interpolated
    start = recording.disturbance[0, 0]  # seconds since 1970 leave too few digits for a delay
    disturbance, joints, wall = (table - [start, 0.0, 0.0, 0.0] for table in recording)
    begin = max(table[0, 0] for table in (disturbance, joints, wall)) + 2 * LONGEST_DELAY
    end = min(table[-1, 0] for table in (disturbance, joints, wall)) - 2 * LONGEST_DELAY
    if end - begin < LEAST_OVERLAP:
        raise CalibrationError(
            f'the three recordings have {max(end - begin, 0.0):.1f} s in common, '
            f'{LEAST_OVERLAP:g} s are needed')
    wall = wall[(wall[:, 0] >= begin) & (wall[:, 0] <= end)]
    if not np.isfinite(wall[:, 1:]).any():
        raise CalibrationError(
            f'wall: nothing of {", ".join(AXES)} is measured while there is the rest')
    joints = joints[(joints[:, 0] >= begin - 4 * LONGEST_DELAY)
                    & (joints[:, 0] <= end + 4 * LONGEST_DELAY)]
    return EstimatorRecording(disturbance, joints, wall[::max(1, len(wall) // MOST_SAMPLES)])


def _check_stamps(name: str, table: np.ndarray, longest_gap: float) -> None:
    stamps = table[:, 0]
    steps = np.diff(stamps)
    if len(stamps) < 2 or (steps <= 0.0).any():
        row = int(np.argmax(steps <= 0.0)) + 2 if len(stamps) > 1 else 1
        raise CalibrationError(f'{name}: the time must ascend, row {row} does not')
    require_dense(name, stamps, longest_gap)


def _smoothed(disturbance: np.ndarray) -> Curve:
    """
    Return the published disturbance as a smooth function of its stamps, without its outliers.

    As smooth as generalised cross-validation wants it (P. Craven, G. Wahba, 1978): noise that is
    left would look like a motion, and shorten the lever arm.
    """
    from scipy.fft import dct, idct
    from scipy.ndimage import median_filter

    stamps = disturbance[:, 0]
    grid = np.arange(stamps[0], stamps[-1], float(np.median(np.diff(stamps))))
    even = at_times(disturbance, grid)
    usual = median_filter(even, (7, 1))
    even = np.where(np.abs(even - usual) > OUTLIER * robust_scatter(even - usual), usual, even)
    count = len(grid)
    bends = (2.0 - 2.0 * np.cos(np.pi * np.arange(count) / count)) ** 2
    spectrum, best, kept = dct(even, axis=0, norm='ortho'), np.full(3, np.inf), even.copy()
    for penalty in PENALTIES:
        gain = (1.0 / (1.0 + penalty * bends))[:, None]
        score = (((1.0 - gain) * spectrum) ** 2).sum(axis=0) / (count - gain.sum()) ** 2
        better = score < best
        best[better], kept[:, better] = score[better], (gain * spectrum)[:, better]
    return _curve(grid, idct(kept, axis=0, norm='ortho'))


def _curve(times: np.ndarray, values: np.ndarray) -> Curve:
    from scipy.interpolate import CubicSpline

    return CubicSpline(times, values, extrapolate=False)


@dataclass(frozen=True)
class _Fit:
    """The head on the rail and on the wall, and what is free between them."""

    published: Curve
    head: Curve
    times: np.ndarray
    wall: np.ndarray
    free: list[int]
    knocked: float = np.inf

    def solve(self, present: EstimateSettings) -> EstimatorFit:
        values = np.zeros(len(TOLERANCES))
        values[:LATE] = unknowns.values_of(present, SOUGHT.values())
        values[ORIGIN] = np.nan_to_num(
            np.ma.median(np.ma.masked_invalid(self.misses(values)), axis=0).filled(0.0)[:2])
        noise, tolerances = np.full(3, 1e-2), TOLERANCES[self.free]

        def with_free(free: np.ndarray) -> np.ndarray:
            changed = values.copy()
            changed[self.free] = np.clip(free, -tolerances, tolerances)
            return changed

        for _ in range(4):  # with weights guessed, then with those of the residuals
            found, rates = robust_fit(
                lambda free: (self.misses(with_free(free)) / noise).compressed(),  # noqa: B023
                np.zeros(len(tolerances)), tolerances, values[self.free])
            values = with_free(found)
            remains = self.misses(values)
            noise = np.maximum(np.ma.filled(robust_scatter(remains), 0.0), 1e-9)
        knocked = self._knock((remains / noise).filled(0.0))
        if np.isfinite(knocked):
            return replace(self, knocked=knocked).solve(present)
        residual = np.where(np.isfinite(self.wall).any(axis=0), noise, np.nan)
        self._check_agreement(residual)
        deviations = self._deviations(rates, np.clip((remains / noise).filled(0.0), -HUBER, HUBER))
        self._check_shown(deviations)
        return EstimatorFit(
            unknowns.with_values(present, SOUGHT.values(), values[:LATE]), deviations,
            float(values[TURN]), float(values[LATE]),
            np.ptp(self._frames(values), axis=0), self.knocked, residual)

    def misses(self, values: np.ndarray) -> np.ma.MaskedArray:
        """Return measured less expected on the wall, shape (m, 3); masked where not measured."""
        seen = self.times - values[LATE]
        published = self.published(seen + values[DELAY])
        return np.ma.array(
            self.wall - _expected(values, published, self.head(seen), self._frames(values)),
            mask=~np.isfinite(self.wall))

    def _frames(self, values: np.ndarray) -> np.ndarray:
        """Return where the second measurement's frame is at its times, shape (m, 3)."""
        return self._slow @ values[FRAME:].reshape(3, -1).T

    @cached_property
    def _slow(self) -> np.ndarray:
        """What a frame's place is made of at its times: the degrees of its drift, and a knock."""
        begin, end = self.times[[0, -1]]
        return np.column_stack([np.polynomial.legendre.legvander(
            2.0 * (self.times - begin) / (end - begin) - 1.0, DRIFT), self.times > self.knocked])

    def _knock(self, weighed: np.ndarray) -> float:
        """Return after which time all is elsewhere on the wall; infinity if it never is."""
        def left(fit: _Fit) -> float:
            slow, rows = fit._slow, np.abs(weighed).max(axis=1) < FAR_OFF
            found = np.linalg.lstsq(slow[rows], weighed[rows], rcond=None)[0]
            return float(((weighed - slow @ found)[rows] ** 2).sum())

        if np.isfinite(self.knocked):
            return np.inf
        remain, time = min((left(replace(self, knocked=time)), time) for time in np.arange(
            self.times[0] + 2.0, self.times[-1] - 2.0, 0.5).tolist())
        return time if remain < (1.0 - KNOCKED) * left(self) else np.inf

    def _deviations(self, rates: np.ndarray, weighed: np.ndarray) -> dict[str, float]:
        """Return the deviations by name; residuals that are alike count as fewer."""
        measured = np.flatnonzero(np.isfinite(self.wall).any(axis=0))
        inflation = max(_correlation(weighed[:, k]) for k in measured)
        covariance = np.linalg.inv(rates.T @ rates / inflation + np.eye(len(self.free)))
        deviations = np.sqrt(np.diag(covariance)) * TOLERANCES[self.free]
        names = dict(enumerate(SOUGHT))
        return {names[k]: float(deviation) for k, deviation in zip(
            self.free, deviations, strict=True) if k in names}

    def _check_agreement(self, residual: np.ndarray) -> None:
        """Reject what leaves much of the motion over, and say what the wall shows of it."""
        for axis, left, moved, alike, (unit, factor) in zip(
                AXES, residual, self.published(self.times).std(axis=0), ALIKE, UNITS, strict=True):
            if left > alike and left > MOST_LEFT * moved:
                raise CalibrationError(
                    f'the recordings contradict each other: {left * factor:.3g} {unit} RMS of the '
                    f"head's {axis} remain, of a motion of {moved * factor:.3g} {unit}; "
                    + self._cause())

    def _cause(self) -> str:
        """Return at which stamps, and how large, the wall shows the disturbance."""
        explained, table, shift = max(
            (float(np.nanmean(self._shown(*shifts)[0])), table, float(shift))
            for shift in CLOCKS for table, shifts in (
                ('wall', (shift, shift)), ('disturbance', (-shift, 0.0))))
        now, shares = self._shown(0.0, 0.0)
        if abs(shift) > LONGEST_DELAY and explained > 0.5 * (1.0 + np.nanmean(now)):
            return (f'they agree if the stamps of the {table} are {shift:+.1f} s late: '
                    'do both computers have the same clock?')
        return ('the wall shows ' + ', '.join(
            f'{share:.3g} times {axis}' for axis, share in zip(AXES, shares, strict=True)
            if np.isfinite(share)) + ' of the disturbance: 1 is right, another factor is another '
            'unit, sign or order of the axes')

    def _shown(self, published: float, head: float) -> tuple[np.ndarray, np.ndarray]:
        """Return which share of its motion each axis explains with stamps shifted, and how."""
        every = slice(None, None, max(1, len(self.times) // 500))
        times, slow = self.times[every], self._slow[every]
        motion = np.column_stack([
            self.published(times - published), self.head(times - head), slow])
        explained, shares = np.full((2, 3), np.nan)
        for axis, wall in enumerate(self.wall[every].T):
            rows = np.isfinite(motion).all(axis=1) & np.isfinite(wall)
            if rows.sum() > 2 * motion.shape[1]:
                found = np.linalg.lstsq(motion[rows], wall[rows], rcond=None)[0]
                still = wall[rows] - slow[rows] @ np.linalg.lstsq(
                    slow[rows], wall[rows], rcond=None)[0]
                explained[axis] = 1.0 - np.var(wall[rows] - motion[rows] @ found) / np.var(still)
                shares[axis] = found[axis]
        return explained, shares

    def _check_shown(self, deviations: dict[str, float]) -> None:
        found = {name: SOUGHT[name].blind(deviation) for name, deviation in deviations.items()}
        if blind := [*filter(None, found.values())]:
            shown = [name for name, words in found.items() if not words]
            sway, way = (unknowns.in_units(curve(self.times).std(axis=0))
                         for curve in (self.published, self.head))
            raise CalibrationError(
                f'the recording cannot show {", ".join(blind)}: the gondola swayed by {sway} RMS, '
                f'the head moved on the rail by {way}; a lever arm needs the gondola to turn, a '
                f'delay the head to move on the rail, and {", ".join(AXES)} of the head are to be '
                'measured on the wall'
                + (f'; or look for less with --find {" ".join(shown)}' if shown else ''))


def _expected(
    values: np.ndarray, published: np.ndarray, head: np.ndarray, frames: np.ndarray
) -> np.ndarray:
    """Return the head on the wall: frame of the wall, rail of the estimator, head on the rail."""
    x, y, yaw, _, axes = values[:LATE]
    theta = published[:, 2] - yaw
    moved = _turned(published[:, :2], axes) + [x, y] + _turned(head[:, :2] - [x, y], theta)
    return np.column_stack([
        _turned(moved, frames[:, 2]) + frames[:, :2], theta + frames[:, 2] + head[:, 2]])


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


def report_estimator(found: EstimatorFit) -> list[str]:
    """Return what was found, line by line."""
    lines = [
        f'{SOUGHT[name].words:20s} {SOUGHT[name].known(value, deviation)}'
        for name, deviation in found.deviations.items()
        for value in unknowns.values_of(found.settings, [SOUGHT[name]])]
    lines += [f'{axis} of the head: {value * factor:.2f} {unit} remain'
              for axis, value, (unit, factor) in zip(AXES, found.residual, UNITS, strict=True)
              if np.isfinite(value)]
    lines.append(f'the second measurement is stamped {1e3 * found.late:+.1f} ms late; beside the '
                 f'estimator it wandered by {unknowns.in_units(found.drift)}')
    if np.isfinite(found.knocked):
        lines.append(f'{found.knocked:.0f} s after the first disturbance it was knocked, or the '
                     'estimator was')
    if 'axes' not in found.deviations:
        lines.append("the second measurement's axes are turned by "
                     f'{np.rad2deg(found.turn):+.2f} deg from those of facade')
    return lines
