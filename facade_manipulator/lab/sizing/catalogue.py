"""Tables of motors and screws, which are their user's: one CSV file each, with makers' units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from facade_manipulator.errors import ParameterError
from facade_manipulator.lab.sizing.axis_drive import Motor
from facade_manipulator.lab.sizing.screw import BallScrew
from facade_manipulator.parameters import nearest
from facade_manipulator.tools.calibration import read_rows

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
    """Read a table of motors; raises a ManipulatorError that names file, line and column."""
    return _read(path, Motor, MOTORS)


def read_screws(path: Path) -> list[BallScrew]:
    """Read a table of ball screws; raises a ManipulatorError that names file, line and column."""
    return _read(path, BallScrew, SCREWS)


def _read(path: Path, kind: type[Kind], columns: Columns) -> list[Kind]:
    name, titles, rows = read_rows(path)
    _check_titles(name, titles, columns)
    return [_row(where, row, kind, columns) for where, row in rows]


def _check_titles(name: str, titles: Sequence[str], columns: Columns) -> None:
    known = (*WORDS, *columns)
    for title in titles:
        if title not in known:
            raise ParameterError(
                f'{name}: column {title} is not understood{nearest(title, known)}')
    for title in ('name', *columns):
        if title not in titles:
            raise ParameterError(f'{name} has no column {title}')


def _row(where: str, row: Mapping[str, str], kind: type[Kind], columns: Columns) -> Kind:
    values: dict[str, Any] = {name: row.get(name, '').strip() for name in WORDS}
    try:
        return kind(**values | {
            field: unit * _number(title, row.get(title, ''))
            for title, (field, unit) in columns.items()})
    except ParameterError as error:
        raise ParameterError(f'{where}: {error}') from error


def _number(title: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ParameterError(f'{title} = {text!r} is not a number') from None
