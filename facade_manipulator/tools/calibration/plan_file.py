"""The table of a plan on the disk: where to measure, and what has been measured there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import csv
from pathlib import Path

import numpy as np

from facade_manipulator.errors import CalibrationError, file_errors
from facade_manipulator.files import write_table
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import CARRIAGES
from facade_manipulator.tools.calibration.geometry_fit import Measurements
from facade_manipulator.tools.calibration.tables import read_table
from facade_manipulator.tools.calibration.target import Sought
from facade_manipulator.tools.calibration.unknowns import AXES, heads, in_rail

STATION = (*CARRIAGES, 'direction')
GOALS = tuple(f'goal_{name}' for name in AXES)
TOWARDS_GREATER = 1.0  # x, from where every pose is arrived at unless the plan says otherwise


def write_plan(path: Path, sought: Sought, carriages: np.ndarray) -> int:
    """
    Write where to measure, the first pose once more at the end, with empty cells.

    Carriages are as `plan` returns them. Returns how many poses these are. Raises a
    CalibrationError where a file would be lost that is more than such a plan.
    """
    if path.exists() and not _is_empty_plan(path):
        raise CalibrationError(f'{path} has measured values or is no plan: nothing is written; '
                               'name another file for the plan')
    carriages = np.vstack([carriages, carriages[:1]])  # shows whether the instrument moved
    if carriages.shape[1] == len(CARRIAGES):
        carriages = np.insert(carriages, len(CARRIAGES), TOWARDS_GREATER, axis=1)
    numbers = np.hstack([carriages, heads(in_rail(sought.geometry), carriages)])
    empty = [''] * len(sought.target.columns)
    _write(path, [dict(zip(
        (*STATION, *GOALS, *sought.target.columns), (*map(_cell, row), *empty), strict=True))
        for row in numbers.tolist()])
    return len(numbers)


def read_measured(path: Path, sought: Sought) -> Measurements:
    """Return what has been measured, NaN in rows where nothing was; errors name the row."""
    table = read_table(path, CARRIAGES, ('direction', *sought.target.columns))
    station, seen = np.nan_to_num(table[:, :4]), []
    for row, numbers in enumerate(table[:, 4:]):
        try:
            if station[row, 3] not in (-1.0, 0.0, 1.0):
                raise CalibrationError(f'direction = {station[row, 3]:g} is not 1, -1 or 0')
            seen.append(sought.target.pose(numbers, sought.number_noise))
        except CalibrationError as error:
            raise CalibrationError(f'row {row + 1}: {error}') from error
    return Measurements(station, np.array(seen))


def goals(path: Path, columns: Iterable[str]) -> list[tuple[Pose, float]]:
    """Return where the head is to stand in frame rail, and the direction to arrive in."""
    try:
        rows = _rows(path)
        if not rows:
            raise ValueError('it has no rows')
        [row[name] for row in rows for name in columns]
        return [(Pose(*(float(row[name]) for name in GOALS)), float(row['direction']))
                for row in rows]
    except (KeyError, TypeError, ValueError) as error:
        raise CalibrationError(
            f'{path} is no plan as calibrate geometry --plan writes it: {error}') from error


def fill(
    path: Path, number: int, station: Iterable[float], columns: Sequence[str],
    measured: Iterable[float],
) -> None:
    """Write the carriages with their direction and what was measured into a row, from 0."""
    rows = _rows(path)  # as they are now: somebody may have changed one meanwhile
    if any(rows[number][name] for name in columns):
        raise CalibrationError(f'row {number + 1} of {path} has measured values meanwhile')
    rows[number].update(zip(
        (*STATION, *columns), map(_cell, (*station, *measured)), strict=True))
    _write(path, rows)


def _is_empty_plan(path: Path) -> bool:
    with path.open(newline='', encoding='utf-8', errors='replace') as file:
        try:
            titles, *rows = csv.reader(file)
        except (ValueError, csv.Error):
            return False
    given = (*STATION, *GOALS)
    return tuple(titles[:len(given)]) == given and all(
        len(row) == len(titles) and not any(row[len(given):]) for row in rows)


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline='', encoding='utf-8', errors='replace') as file:
        return list(csv.DictReader(file))


def _write(path: Path, rows: Sequence[dict[str, str]]) -> None:
    with file_errors(path):
        write_table(path, rows[0], (row.values() for row in rows))


def _cell(value: float) -> str:
    return '' if np.isnan(value) else f'{value:.6f}'
