"""Reader of CSV tables from spreadsheets, with the unit in the name of each column."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
import csv
from pathlib import Path

import numpy as np

from facade_manipulator.errors import CalibrationError

UNITS = {'': 1.0, '_m': 1.0, '_mm': 1e-3, '_rad': 1.0, '_deg': np.pi / 180.0}


def read_table(
    path: Path, required: Sequence[str], optional: Sequence[str] = ()
) -> np.ndarray:
    """
    Return columns of a CSV file in SI units, shape (n, number of columns).

    A column has its plain name (m, rad) or a unit at its end: ``x_mm``, ``theta_deg``. Columns are
    separated by commas, or by semicolons with decimal commas. Missing optional columns and cells
    become NaN. Columns that begin with ``goal`` or ``note`` are not read.

    Raises
    ------
    CalibrationError
        The message names the row, counted from 1 below the header, and the column.

    """
    # Spreadsheets write remarks in other encodings, in which digits are equal.
    text = path.read_text(encoding='utf-8-sig', errors='replace')
    lines = [
        line
        for line in text.splitlines()
        if line.strip(';, ') and not line.startswith(('#', 'sep='))
    ]
    separator = ';' if ';' in ''.join(lines[:1]) else ','
    if separator == ';':
        lines = [line.replace(',', '.') for line in lines]
    reader = csv.DictReader(lines, delimiter=separator)
    names, header = (*required, *optional), [*filter(None, reader.fieldnames or ())]
    meanings = {
        name + unit: (names.index(name), factor)
        for name in names
        for unit, factor in UNITS.items()
    }
    found = [meanings[title][0] for title in header if title in meanings]
    unknown = [
        title
        for title in header
        if title not in meanings and not title.startswith(('goal', 'note'))
    ]
    wrong = [
        name
        for k, name in enumerate(names)
        if found.count(k) > 1 or (name in required and k not in found)
    ]
    if unknown or wrong:
        raise CalibrationError(
            f'{path} rejected: column {(unknown + wrong)[0]} is '
            f'{"unknown" if unknown else "missing or double"}; next: use {", ".join(names)} with '
            f'one of the units {", ".join(filter(None, UNITS))}, and note_… for a remark'
        )
    table = np.full((len(lines), len(names)), np.nan)
    for number, cells in enumerate(reader, 1):
        for title, (k, factor) in meanings.items():
            with suppress(ValueError):  # an optional cell may be empty
                table[number, k] = float(cells.get(title) or '') * factor
        filled = sum(
            bool((cells[title] or '').strip()) for title in header if title in meanings
        )
        if (
            None in cells
            or filled != np.isfinite(table[number]).sum()
            or not np.isfinite(table[number, : len(required)]).all()
        ):
            raise CalibrationError(
                f'{path} row {number} rejected: {", ".join(map(str, cells.values()))} are not '
                f'{len(header)} finite numbers; next: complete it, with decimal points'
            )
    return table[1:]
