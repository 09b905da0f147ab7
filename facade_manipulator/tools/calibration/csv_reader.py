"""Reader of CSV tables from spreadsheets; the name of each column contains the unit."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
import csv
from pathlib import Path

import numpy as np

from facade_manipulator.errors import CalibrationError


def read_table(
    path: Path, required: Sequence[str], optional: Sequence[str] = ()
) -> np.ndarray:
    """
    Return the columns of a CSV file in SI units, shape (n, number of columns).

    The name of a column is plain (m, rad) or ends with a unit: ``x_mm``, ``theta_deg``. Columns
    are separated by commas, or by semicolons with decimal commas. Missing optional columns and
    cells become NaN. Columns that begin with ``goal`` or ``note`` are not read.

    Raises
    ------
    CalibrationError
        The message names the row, counted from 1 below the header, and the column.

    """
    # Spreadsheets write remarks in other encodings, in which digits are equal.
    text = path.read_text(encoding='utf-8-sig', errors='replace')
    lines = []
    for line in text.splitlines():
        if line.strip(';, ') and not line.startswith(('#', 'sep=')):
            lines.append(line)
    separator = ';' if ';' in ''.join(lines[:1]) else ','
    if separator == ';':
        lines = [line.replace(',', '.') for line in lines]
    reader = csv.DictReader(lines, delimiter=separator)
    header = [title for title in reader.fieldnames or () if title]
    columns = _columns(path, header, required, optional)

    table = np.full((len(lines), len(required) + len(optional)), np.nan)
    for number, cells in enumerate(reader, 1):
        for title, (column, factor) in columns.items():
            with suppress(ValueError):  # an optional cell may be empty
                table[number, column] = float(cells[title] or '') * factor

        filled = [title for title in columns if (cells[title] or '').strip()]
        is_finite = np.isfinite(table[number])
        if (
            None in cells
            or len(filled) != is_finite.sum()
            or not is_finite[: len(required)].all()
        ):
            raise CalibrationError(
                f'{path} row {number} rejected: {", ".join(map(str, cells.values()))} are not '
                f'{len(header)} finite numbers; next: complete it, with decimal points'
            )
    return table[1:]


LENGTH_SUFFIXES = {'': 1.0, '_m': 1.0, '_mm': 1e-3}
ANGLE_SUFFIXES = {'': 1.0, '_rad': 1.0, '_deg': np.pi / 180.0}
ANGLES = ('theta',)  # the other columns are lengths


def _columns(
    path: Path, header: Sequence[str], required: Sequence[str], optional: Sequence[str]
) -> dict[str, tuple[int, float]]:
    """
    Return, for each title that is read, its column and the factor to SI units.

    Raises a CalibrationError for a title that is unknown, missing or double.
    """
    names = (*required, *optional)
    possible = {}
    for column, name in enumerate(names):
        suffixes = ANGLE_SUFFIXES if name in ANGLES else LENGTH_SUFFIXES
        for unit, factor in suffixes.items():
            possible[name + unit] = (column, factor)

    titles = [title for title in header if not title.startswith(('goal', 'note'))]
    unknown = [title for title in titles if title not in possible]
    read = [title for title in header if title in possible]
    found = [possible[title][0] for title in read]
    wrong = []
    for column, name in enumerate(names):
        is_missing = name in required and column not in found
        if is_missing or found.count(column) > 1:
            wrong.append(name)
    if unknown or wrong:
        hints = []
        for suffixes, is_angle in ((LENGTH_SUFFIXES, False), (ANGLE_SUFFIXES, True)):
            if of_kind := [name for name in names if (name in ANGLES) == is_angle]:
                units = ' or '.join(filter(None, suffixes))
                hints.append(f'{", ".join(of_kind)} with {units}')
        raise CalibrationError(
            f'{path} rejected: column {(unknown + wrong)[0]} is '
            f'{"unknown" if unknown else "missing or duplicate"}; next: use '
            f'{", ".join(hints)}, and note_… for a remark'
        )
    return {title: possible[title] for title in read}
