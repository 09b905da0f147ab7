"""Tables of motors and screws, which are their user's: one CSV file each, with makers' units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import csv
from pathlib import Path
from typing import Any, TypeVar

from facade_manipulator.errors import ParameterError
from facade_manipulator.lab.sizing.axis_drive import Motor
from facade_manipulator.lab.sizing.screw import BallScrew
from facade_manipulator.parameters import nearest

Kind = TypeVar('Kind', Motor, BallScrew)
Columns = Mapping[str, tuple[str, float]]  # by title: the field, and its unit
MINUTE, MILLIMETRE = 1.0 / 60.0, 1e-3
MOTORS: Columns = {
    'rated_torque_Nm': ('rated_torque', 1.0), 'peak_torque_Nm': ('peak_torque', 1.0),
    'rated_speed_rpm': ('rated_speed', MINUTE), 'peak_speed_rpm': ('peak_speed', MINUTE),
    'inertia_kgm2': ('inertia', 1.0)}
SCREWS: Columns = {
    'diameter_mm': ('diameter', MILLIMETRE), 'core_mm': ('core', MILLIMETRE),
    'lead_mm': ('lead', MILLIMETRE), 'rating_N': ('rating', 1.0),
    'dn_mm_rpm': ('speed_factor', MILLIMETRE * MINUTE)}
WORDS = ('name', 'source')


def read_motors(path: Path) -> list[Motor]:
    """Read a table of motors; raises a ParameterError that names file, line and column."""
    return _read(path, Motor, MOTORS)


def read_screws(path: Path) -> list[BallScrew]:
    """Read a table of ball screws; raises a ParameterError that names file, line and column."""
    return _read(path, BallScrew, SCREWS)


def _read(path: Path, kind: type[Kind], columns: Columns) -> list[Kind]:
    try:
        lines = path.read_text(encoding='utf-8-sig').splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ParameterError(f'{path} cannot be read: {error}') from error
    filled = [(number, line) for number, line in enumerate(lines, 1)
              if line.strip() and not line.startswith('#')]
    reader = csv.DictReader(line for _, line in filled)
    _check_titles(path, reader.fieldnames or (), columns)
    found = [_row(f'{path}, line {filled[reader.line_num - 1][0]}', row, kind, columns)
             for row in reader]
    if not found:
        raise ParameterError(f'{path} has no rows below its header')
    return found


def _check_titles(path: Path, titles: Sequence[str], columns: Columns) -> None:
    known = (*WORDS, *columns)
    for title in titles:
        if title not in known:
            raise ParameterError(
                f'{path}: column {title} is not understood{nearest(title, known)}')
    for title in ('name', *columns):
        if title not in titles:
            raise ParameterError(f'{path} has no column {title}')


def _row(where: str, row: Mapping[str, Any], kind: type[Kind], columns: Columns) -> Kind:
    values: dict[str, Any] = {name: (row.get(name) or '').strip() for name in WORDS}
    try:
        return kind(**values | {
            field: unit * _number(title, row[title]) for title, (field, unit) in columns.items()})
    except ParameterError as error:
        raise ParameterError(f'{where}: {error}') from error


def _number(title: str, text: str | None) -> float:
    try:
        return float(text or '')
    except ValueError:
        raise ParameterError(f'{title} = {(text or "")!r} is not a number') from None
