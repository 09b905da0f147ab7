"""What a calibration has found, in words and as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from facade_manipulator.calibration.design import candidates, Noise, spread
from facade_manipulator.calibration.geometry_fit import Identification, identify, Measurements
from facade_manipulator.calibration.unknowns import AXES, heads, UNITS, Unknown
from facade_manipulator.errors import CalibrationError
from facade_manipulator.kinematics import Geometry

HELD_OUT_EVERY = 4
BLIND = 5.0  # times the noise: a head that is known no better has not been calibrated


class HeldOut(NamedTuple):
    """RMS of measured less expected at poses left out of a fit, before and after, shape (3,)."""

    count: int
    before: np.ndarray
    after: np.ndarray


def cross_check(
    geometry: Geometry, unknowns: Sequence[Unknown], measurements: Measurements,
    noise: Noise | None = None,
) -> HeldOut | None:
    """Fit without every fourth pose and look at these; None where too few are left to fit."""
    kept = np.arange(len(measurements.carriages)) % HELD_OUT_EVERY != HELD_OUT_EVERY - 1
    held = measurements.part(~kept)
    try:
        found = identify(geometry, unknowns, measurements.part(kept), noise)
    except CalibrationError:
        return None
    return HeldOut(len(held.carriages), *(
        _rms(held.heads - heads(machine, held.carriages)) for machine in (
            geometry, found.geometry)))


def _rms(values: np.ndarray) -> np.ndarray:
    """Return the root mean square of each column's numbers; NaN where it has none."""
    return np.ma.sqrt((np.ma.masked_invalid(values) ** 2).mean(axis=0)).filled(np.nan)


def check_accuracy(
    found: Identification, measurements: Measurements, noise: Noise
) -> None:
    """
    Check that all over the workspace the head is known about as well as it was measured.

    Of an axis that was never measured nothing is asked. Raises a CalibrationError that names what
    the poses cannot show.
    """
    measured = np.isfinite(measurements.heads).any(axis=0)
    known = spread(
        found.geometry, found.unknowns, found.covariance, candidates(found.geometry))
    worst = measured * (known / noise.deviations).max(axis=0)
    if worst.max() > BLIND:
        axis = int(np.argmax(worst))
        unit, factor = UNITS[axis]
        value = worst[axis] * noise.deviations[axis] * factor
        names = ', '.join(dict.fromkeys(sum(found.unidentified, [])))
        raise CalibrationError(
            f'poses that cannot show enough: somewhere {AXES[axis]} of the head would be known '
            f'to {value:.2g} {unit} only. Not known, or not apart: {names or "all of them"}. '
            'Measure at the poses of --plan, or look for less with --find')


def report(found: Identification, held: HeldOut | None) -> list[str]:
    """Return what was found, line by line."""
    lines = [_value(unknown, value, deviation) for unknown, value, deviation in zip(
        found.unknowns, found.values, np.sqrt(np.diag(found.covariance)), strict=True)]
    lines += [f'not known apart, together they hardly move the head: {", ".join(group)}'
              for group in found.unidentified if len(group) > 1]
    alone = [group[0] for group in found.unidentified if len(group) == 1]
    if alone:
        lines.append(f'hardly better known than before: {"; ".join(alone)}')
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


def _value(unknown: Unknown, value: float, deviation: float) -> str:
    unit, factor = UNITS[2 if unknown.is_angle else 0]
    return (f'{unknown.words:34s} {value * factor:+9.3f} +- {deviation * factor:.3f} {unit}  '
            f'({unknown.name})')


def draw_accuracy(
    path: Path, drawing: Geometry, found: Identification
) -> None:
    """Draw how far the head was off, and how well it is known now, over the workspace."""
    from matplotlib.figure import Figure

    permitted = candidates(found.geometry)
    now = heads(found.geometry, permitted)
    off = now - heads(drawing, permitted)
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
