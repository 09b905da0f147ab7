"""Tables of numbers as technicians write them: CSV, units in the column's name, gaps named."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
import csv
import math
from pathlib import Path
import sys

import numpy as np

from facade_manipulator.errors import CalibrationError

TYPED = Path('-')
PASSED_OVER = 'goal', 'note'
NO_ROW = '#', 'sep='  # a comment; what tells a spreadsheet its separator
BYTE_ORDER_MARK = '\ufeff'
Rows = tuple[str, list[str], list[tuple[str, dict[str, str]]]]
UNITS = {'': 1.0, '_m': 1.0, '_mm': 1e-3, '_rad': 1.0, '_deg': math.pi / 180.0}


def read_table(path: Path, required: Sequence[str], optional: Sequence[str] = ()) -> np.ndarray:
    """
    Read columns of a CSV file, ``-`` for what is typed.

    A column is named plainly, in m, rad or s, or with its unit: ``x_mm``, ``theta_deg``; one that
    begins like these but has another unit is rejected by its name. Where columns are optional, so
    is every other one, but for goals (``goal_x``) and notes (``note_…``): it may be a misspelt
    one. Between columns is a comma, or a semicolon as some spreadsheets write it, with decimal
    commas then.

    Returns SI units, shape (n, len(required) + len(optional)), NaN where nothing is written: cells
    of optional columns may be empty. Raises a CalibrationError that names file, line and column.
    """
    name, header, rows = read_rows(path)
    columns = [_column(name, header, column, column in required)
               for column in (*required, *optional)]
    _check_titles(
        name, header, (*required, *optional), dict(filter(None, columns)), bool(optional))
    return np.array([[_cell(where, row, column, k < len(required))
                      for k, column in enumerate(columns)] for where, row in rows], float)


def read_rows(path: Path) -> Rows:
    """
    Return a table's name, its titles, and of each row where it stands and its cells by title.

    Raises a CalibrationError if there is no row, or the file cannot be read.
    """
    if path == TYPED:
        return _split('the table typed', sys.stdin)
    try:
        # spreadsheets write remarks in a code page of their own; numbers are the same in each
        with path.open(newline='', encoding='utf-8-sig', errors='replace') as file:
            return _split(str(path), file)
    except (OSError, csv.Error) as error:
        raise CalibrationError(f'{path} cannot be read: {error}') from error


def require_dense(name: str, stamps: np.ndarray, bound: float) -> None:
    """Raise a CalibrationError that names the longest gap between stamps beyond a bound [s]."""
    steps = np.diff(stamps)
    if steps.size and steps.max() > bound:
        gap = int(np.argmax(steps))
        raise CalibrationError(
            f'{name}: a gap of {steps[gap]:.2f} s, {stamps[gap] - stamps[0]:.2f} s after its '
            f'first measurement; bound {bound:g} s')


def at_times(table: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return what the columns after the first, the time, are at other times, shape (n, k)."""
    return np.column_stack([np.interp(times, table[:, 0], column) for column in table[:, 1:].T])


def _split(name: str, lines: Iterable[str]) -> Rows:
    lines = ['' if line.startswith(NO_ROW) else line.lstrip(BYTE_ORDER_MARK) for line in lines]
    delimiter = ';' if ';' in next(filter(str.strip, lines), '') else ','
    if delimiter == ';':
        lines = [line.replace(',', '.') for line in lines]
    reader = csv.reader(lines, delimiter=delimiter)
    filled = (row for row in reader if any(map(str.strip, row)))
    header = [column.strip() for column in next(filled, [])]
    if doubled := [title for title in header if title and header.count(title) > 1]:
        raise CalibrationError(f'{name} has the column {doubled[0]} twice; next: remove one')
    rows = [_row(f'{name}, row {number} (line {reader.line_num})', header, row)
            for number, row in enumerate(filled, 1)]
    if not rows:
        raise CalibrationError(f'{name} has no rows below its header')
    return name, header, rows


def _row(where: str, header: list[str], row: list[str]) -> tuple[str, dict[str, str]]:
    """Return where a row is and its cells by title; unquoted decimal commas make too many."""
    for number, cell in enumerate(row[len(header):], len(header) + 1):
        if cell.strip():
            raise CalibrationError(
                f'{where}: cell {number} = {cell!r} is beyond the last of {len(header)} columns; '
                'next: write decimal points, or semicolons between the columns')
    return where, dict(zip(header, row, strict=False))


def _check_titles(
    name: str, header: list[str], wanted: Sequence[str], read: Container[str], every: bool
) -> None:
    for title in header:
        meant = title.lower().partition('_')[0]
        if title not in read and (meant in wanted or title.lower() in wanted or (
                every and title and meant not in PASSED_OVER)):
            raise CalibrationError(
                f'{name}: column {title} is not understood; there are {", ".join(wanted)}, with '
                f'{", ".join(filter(None, UNITS))} for their unit, and note_… for a remark')


def _column(name: str, header: list[str], column: str, required: bool) -> tuple[str, float] | None:
    """Return how a column is called in a table, and its unit."""
    found = [column + unit for unit in UNITS if column + unit in header]
    if len(found) > 1:
        raise CalibrationError(f'{name} has {column} in two units: {", ".join(found)}')
    if not found and required:
        raise CalibrationError(
            f'{name} has no column {column}; its columns are {", ".join(header) or "none"}')
    return (found[0], UNITS[found[0][len(column):]]) if found else None


def _cell(
    where: str, row: dict[str, str], column: tuple[str, float] | None, required: bool
) -> float:
    if column is None:
        return math.nan
    title, unit = column
    text = (row.get(title) or '').strip()
    if not text and not required:
        return math.nan
    try:
        value = float(text) * unit
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise CalibrationError(
            f'{where}: {title} = {text!r} is not a number' if text else
            f'{where}: {title} is missing')
    return value
