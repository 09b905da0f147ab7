"""
The errors of a machine from measurements of its head: robust least squares with their covariance.

What the drawing says is one more measurement of each unknown, with its tolerance. So the fit is
defined however little is measured, and what the measurements add is the ratio of the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import CalibrationError, ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.tools.calibration import robust_fit
from facade_manipulator.tools.calibration.design import (
    candidates,
    covariance_of,
    information,
    Noise,
    spread,
)
from facade_manipulator.tools.calibration.unknowns import (
    AXES,
    heads,
    in_rail,
    in_units,
    off_by,
    require_closed,
    SHAPE,
    UNITS,
    Unknown,
    values_of,
    with_values,
)

EXPLAINED = np.array([0.05, 0.05, 0.1])  # m, m, rad: errors of a machine explain no more
MOST_OUTLIERS = 0.2
KNOCKED = 0.25  # of the squares left: what all the rest of a knock comes to
LEAST_ROWS = 3  # before and after a knock; fewer are outliers
MOST_SCATTER = 5.0  # times the noise stated
IDENTIFIED = 0.5  # of its tolerance: an unknown known no better is not shown by the data
LEAST_SHARE, LINKED = 0.15, 0.5  # of an unknown in what is not identified, of two in each other
HELD_OUT_EVERY = 4
BLIND = 5.0  # times the noise: a head that is known no better has not been calibrated


class Measurements(NamedTuple):
    """The head, measured at carriage positions."""

    carriages: np.ndarray  #: as commanded, as `heads` takes them, shape (n, 3) or (n, 4)
    heads: np.ndarray  #: in frame rail, shape (n, 3) [m, m, rad]; NaN where not measured

    def part(self, rows: np.ndarray | slice) -> Measurements:
        """Return some of the rows."""
        return Measurements(*(table[rows] for table in self))


class Identification(NamedTuple):
    """A machine found."""

    geometry: Geometry  #: with the errors found
    unknowns: Sequence[Unknown]  #: what was looked for
    values: np.ndarray  #: of the unknowns, shape (m,)
    covariance: np.ndarray  #: of these values, shape (m, m)
    scatter: float  #: residuals over the noise that was stated, 1 where both agree
    outliers: list[tuple[int, int]]  #: row and axis of what contradicts the rest and is left out
    #: groups of unknowns, in words, that the data cannot show, or not apart from each other
    unidentified: list[list[str]]
    kept: Sequence[Unknown]  #: the rail's shape, where the data cannot tell it: as it was
    observability: float  #: Borm and Menq's index, in units of noise and tolerance


def check(geometry: Geometry, unknowns: Sequence[Unknown], measurements: Measurements) -> None:
    """
    Check that measurements can be those of this machine at all, and are enough.

    Raises a CalibrationError that names the row, numbered from 1, and what is wrong with it.
    """
    if any(u.field == 'backlash' for u in unknowns) and not measurements.carriages[:, 3:].any():
        raise CalibrationError(
            'backlash is looked for, but no row says in which direction the carriages arrived: '
            'column direction, 1 towards greater x, -1 towards less')
    numbers = int(np.isfinite(measurements.heads).sum())
    if numbers <= len(unknowns):
        raise CalibrationError(
            f'too few poses: {numbers} measured numbers for {len(unknowns)} unknowns')
    require_explained(geometry, measurements)


def require_explained(geometry: Geometry, measurements: Measurements) -> None:
    """Raise a CalibrationError that names the first row, from 1, where the head cannot be."""
    expected = heads(geometry, measurements.carriages)
    require_closed(expected, measurements.carriages)
    for row, axis in np.argwhere(np.abs(off_by(measurements.heads, expected)) > EXPLAINED):
        raise CalibrationError(_contradiction(
            row, axis, measurements.heads[row, axis], expected[row, axis]))


def _contradiction(row: int, axis: int, value: float, expected: float) -> str:
    unit, factor = UNITS[axis]
    message = (f'row {row + 1}: {AXES[axis]} = {value * factor:g} {unit}, but the head stands '
               f'near {expected * factor:.4g} {unit}: the bound is {EXPLAINED[axis] * factor:.3g} '
               f'{unit} from there')
    for meant, is_in in ((value / factor, unit), (value * factor, 'm' if axis < 2 else 'rad')):
        if abs(meant - expected) < EXPLAINED[axis]:
            message += f'; if it is in {is_in}, name the column {AXES[axis]}_{is_in}'
    return message


def identify(
    geometry: Geometry, unknowns: Sequence[Unknown], measurements: Measurements,
    noise: Noise | None = None,
) -> Identification:
    """
    Find the errors of a machine that is taken to be the drawing, or an earlier calibration.

    Raises a CalibrationError if the measurements are not of such a machine, too few, or contradict
    each other.
    """
    check(geometry, unknowns, measurements)
    noise, used = noise or Noise(), np.isfinite(measurements.heads)
    known = np.diag(covariance_of(
        information(geometry, unknowns, measurements.carriages, noise)[used]))
    fit = _MachineFit(geometry, [
        one for one, variance in zip(unknowns, known, strict=True)
        if one.field not in SHAPE or variance < IDENTIFIED ** 2], measurements, noise)
    values = fit.solve(used)
    fit.check_knock(used, values)
    misses = fit.misses(values)
    scatter = float(robust_fit.robust_scatter(misses[used]))
    outlying = used & (np.abs(misses) > robust_fit.OUTLIER * max(1.0, scatter))
    if outlying.sum() > MOST_OUTLIERS * used.sum():
        raise CalibrationError(
            f'{outlying.sum()} of {used.sum()} measured numbers contradict the rest: is this the '
            'machine of the parameter file, homed as now, and measured in frame rail?')
    if outlying.any():
        used &= ~outlying
        values = fit.solve(used, loss='linear')
    return fit.identification(
        used, values, [(pose, axis) for pose, axis in np.argwhere(outlying).tolist()],
        [one for one in unknowns if one not in fit.unknowns])


class _MachineFit(NamedTuple):
    """A machine as it is drawn, what is looked for, and how its head was measured."""

    geometry: Geometry
    unknowns: Sequence[Unknown]
    measurements: Measurements
    noise: Noise

    def solve(self, used: np.ndarray, loss: str = 'huber') -> np.ndarray:
        """Return the values of the unknowns that fit best."""
        def misses(values: np.ndarray) -> np.ndarray:
            try:
                return self.misses(values)[used]
            except ParameterError:  # a step beyond what any machine is
                return np.full(used.sum(), robust_fit.FAR)

        drawn = values_of(self.geometry, self.unknowns)
        least = np.array([unknown.least for unknown in self.unknowns])
        # not on a bound, where it would stay
        begin = drawn + np.where(np.isfinite(least), self.tolerances, 0.0)
        return robust_fit.robust_fit(misses, drawn, self.tolerances, begin, least, loss)[0]

    @property
    def tolerances(self) -> np.ndarray:
        return np.array([unknown.tolerance for unknown in self.unknowns])

    def misses(self, values: np.ndarray) -> np.ndarray:
        """Return measured less expected in standard deviations, shape (n, 3)."""
        machine = with_values(self.geometry, self.unknowns, values)
        carriages, measured = self.measurements
        return off_by(measured, heads(machine, carriages)) / self.noise.deviations

    def check_knock(self, used: np.ndarray, values: np.ndarray) -> None:
        """Raise a CalibrationError if from one row on all the heads stand elsewhere together."""
        machine = with_values(self.geometry, self.unknowns, values)
        try:
            rates = information(machine, self.unknowns, self.measurements.carriages, self.noise)
        except ParameterError:  # at the bounds of what any machine is: another one altogether
            return
        x, y = self.measurements.heads.T[:2, :, None]
        apart = (np.eye(3) + np.dstack([np.zeros((*rates.shape[:2], 2)), np.hstack(
            [-y, x, 0.0 * x])])) / self.noise.deviations[:, None]
        misses, drawn = self.misses(values)[used], np.eye(len(values), len(values) + 3)

        def moved(row: int) -> tuple[float, np.ndarray]:
            later = apart * (np.arange(len(apart)) >= row)[:, None, None]
            table = np.vstack([np.dstack([rates, np.nan_to_num(later)])[used], drawn])
            wanted = np.append(misses, np.zeros(len(drawn)))
            found = np.linalg.lstsq(table, wanted, rcond=None)[0]
            return float(((wanted - table @ found) ** 2).sum()), found[-3:]

        without, last = moved(len(apart))[0], len(apart) - LEAST_ROWS
        left, row = min(((moved(row)[0], row) for row in range(LEAST_ROWS, last + 1)),
                        default=(without, 0))
        if left < KNOCKED * without and without > 4.0 * len(misses):
            raise CalibrationError(
                f'from row {row + 1} on the head is elsewhere by {in_units(moved(row)[1])}: was '
                'the instrument knocked? Measure these rows, or those before, again')

    def identification(
        self, used: np.ndarray, values: np.ndarray, outliers: list[tuple[int, int]],
        kept: Sequence[Unknown],
    ) -> Identification:
        machine, unknowns = with_values(self.geometry, self.unknowns, values), self.unknowns
        rows = information(machine, unknowns, self.measurements.carriages, self.noise)[used]
        misses = self.misses(values)[used]
        scatter = float(np.sqrt(misses @ misses / max(1, len(misses) - len(unknowns))))
        if scatter > MOST_SCATTER:
            raise CalibrationError(
                f'the measurements scatter by {scatter:.3g} times the noise stated: they '
                'contradict each other, the noise is another (--noise), or the machine has errors '
                'that are not looked for (--find)')
        covariance = covariance_of(rows, scatter)
        singular = np.linalg.svd(rows, compute_uv=False)
        return Identification(
            machine, unknowns, values, covariance * np.outer(self.tolerances, self.tolerances),
            scatter, outliers, _unidentified(covariance, unknowns), kept,
            float(np.exp(np.mean(np.log(np.maximum(singular, 1e-12)))) / np.sqrt(len(rows))))


def _unidentified(covariance: np.ndarray, unknowns: Sequence[Unknown]) -> list[list[str]]:
    """
    Return the groups of unknowns that are, together, hardly better known than drawn.

    Directions that are known equally badly are any of their plane: so what belongs together is
    read from the projection on all of them.
    """
    from scipy.sparse.csgraph import connected_components

    spreads, directions = np.linalg.eigh(covariance)
    blind = directions[:, spreads > IDENTIFIED ** 2]
    shares = blind @ blind.T
    sizes = np.sqrt(np.diag(shares))
    part = np.flatnonzero(sizes > LEAST_SHARE)
    linked = np.abs(shares) > LINKED * np.outer(sizes, sizes)
    count, label = connected_components(linked[np.ix_(part, part)])
    return [[unknowns[k].words for k in part[label == group]] for group in range(count)]


class HeldOut(NamedTuple):
    """RMS of measured less expected at poses left out of a fit, before and after, shape (3,)."""

    count: int  # type: ignore[assignment]  # hides tuple.count
    before: np.ndarray
    after: np.ndarray


def cross_check(
    geometry: Geometry, unknowns: Sequence[Unknown], measurements: Measurements,
    noise: Noise | None = None,
) -> HeldOut | None:
    """Fit without every fourth pose and look at these; None where too few are left to fit."""
    measurements = measurements.part(np.isfinite(measurements.heads).any(axis=1))
    kept = np.arange(len(measurements.carriages)) % HELD_OUT_EVERY != HELD_OUT_EVERY - 1
    held = measurements.part(~kept)
    try:
        found = identify(geometry, unknowns, measurements.part(kept), noise)
    except CalibrationError:
        return None
    return HeldOut(len(held.carriages), *(
        robust_fit.rms(off_by(held.heads, heads(machine, held.carriages))) for machine in (
            geometry, found.geometry)))


def known_to(found: Identification, measurements: Measurements) -> np.ndarray:
    """Return to what the head is known where it is known worst, shape (3,); 0 if not measured."""
    known = spread(found.geometry, found.unknowns, found.covariance, candidates(found.geometry))
    return np.isfinite(measurements.heads).any(axis=0) * known.max(axis=0)


def check_accuracy(found: Identification, measurements: Measurements, noise: Noise) -> None:
    """
    Check that all over the workspace the head is known about as well as it was measured.

    Of an axis that was never measured nothing is asked. Raises a CalibrationError that names what
    the poses cannot show.
    """
    worst = known_to(found, measurements) / noise.deviations
    if worst.max() > BLIND:
        axis = int(np.argmax(worst))
        unit, factor = UNITS[axis]
        value = worst[axis] * noise.deviations[axis] * factor
        names = ', '.join(dict.fromkeys(sum(found.unidentified, [])))
        raise CalibrationError(
            f'poses that cannot show enough: somewhere {AXES[axis]} of the head would be known '
            f'to {value:.2g} {unit} only. Not known, or not apart: {names or "all of them"}. '
            'Measure at the poses of --plan, or look for less with --find')


def report_geometry(found: Identification, held: HeldOut | None) -> list[str]:
    """Return what was found, line by line."""
    lines = [
        f'{one.words:34s} {one.known(value, deviation, 3)}  ({one.name})'
        for one, value, deviation in zip(
            found.unknowns, found.values, np.sqrt(np.diag(found.covariance)), strict=True)]
    lines += [f'not known apart, together they hardly move the head: {", ".join(group)}'
              for group in found.unidentified if len(group) > 1]
    alone = [group[0] for group in found.unidentified if len(group) == 1]
    if alone:
        lines.append(f'hardly better known than before: {"; ".join(alone)}')
    if found.kept:
        lines.append('not determined by these poses, kept as it was: '
                     + ', '.join(f'{one.words} ({one.name})' for one in found.kept))
    lines.append(f'scatter: {found.scatter:.2f} of the noise stated; observability index '
                 f'{found.observability:.3g}')
    if found.scatter > 1.5:
        lines.append('the scatter is more than the noise stated: deviations are scaled by it')
    lines += [f'outlier: row {row + 1}, {AXES[axis]}' for row, axis in found.outliers]
    if held is not None:
        lines += [
            f'{AXES[k]} at {held.count} held-out poses: {held.before[k] * factor:.3f} {unit} '
            f'before, {held.after[k] * factor:.3f} {unit} after'
            for k, (unit, factor) in enumerate(UNITS) if np.isfinite(held.before[k])]
    return lines


def draw_accuracy(path: Path, drawing: Geometry, found: Identification) -> None:
    """Draw how far the head was off, and how well it is known now, over the workspace."""
    from matplotlib.figure import Figure

    permitted = candidates(found.geometry)
    now = heads(in_rail(found.geometry), permitted)
    off = now - heads(in_rail(drawing), permitted)
    left = spread(found.geometry, found.unknowns, found.covariance, permitted)
    figure = Figure(figsize=(8.0, 5.5), layout='constrained')
    for axes, values, title in zip(
            figure.subplots(2, 1, sharex=True), (off, left),
            ('the head was off by', 'it is known to (1 sigma)'), strict=True):
        size = 1e3 * np.hypot(values[:, 0], values[:, 1])
        order = np.argsort(size)  # of the poses at one place the worst is on top
        dots = axes.scatter(now[order, 0], now[order, 1], c=size[order], s=40.0)
        figure.colorbar(dots, ax=axes, label='mm')
        axes.set(title=title, xlabel='x [m]', ylabel='y [m]', aspect='equal')
    figure.savefig(path, dpi=110)
