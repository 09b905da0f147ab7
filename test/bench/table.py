"""The bench's result: rows, a table for people, bench.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
import json
from pathlib import Path

from facade_manipulator.files import atomic_write

GOAL_HEADS = ('name', 'ours', 'competitor', 'ratio', 'goal', 'met')
FACTORS = {'us': 1e6, '%': 100.0}


@dataclass(frozen=True)
class Row:
    """
    One comparison.

    `ratio` is ours ÷ competitor where the goal is a cost (``<= 1.2``), competitor ÷ ours where it
    is a speed (``>= 50``).
    """

    name: str
    goal_id: str
    ours: float
    competitor: float
    unit: str
    ratio: float
    goal: str
    met: bool


def compare(
    name: str, ours: float, competitor: float | None, unit: str, goal_id: str, goal: str,
) -> Row | None:
    """Make a row of two figures in SI; None if the competitor could not run."""
    if competitor is None:
        return None
    ratio = competitor / ours if goal.startswith('>=') else ours / competitor
    factor = FACTORS[unit]
    return Row(name, goal_id, factor * ours, factor * competitor, unit, ratio, goal,
               fulfils(ratio, goal))


def fulfils(value: float, goal: str) -> bool:
    """Tell whether a value meets ``'>= bound'`` or ``'<= bound'``."""
    sign, bound = goal.split()
    return value >= float(bound) if sign == '>=' else value <= float(bound)


def show(rows: list[Row], before: Mapping[str, float]) -> None:
    """Print the table, with the ratios of an earlier one in a column of their own."""
    lines = [GOAL_HEADS, *(_cells(row) for row in rows)]
    if before:
        lines = [(*lines[0], 'before'), *(
            (*line, f'{before[row.name]:.3g}' if row.name in before else '')
            for line, row in zip(lines[1:], rows, strict=True))]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        cells = [line[0].ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(line[1:], widths[1:], strict=True)]
        print('  '.join(cells).rstrip())


def _cells(row: Row) -> tuple[str, ...]:
    return (f'{row.goal_id} {row.name}', f'{row.ours:.4g} {row.unit}',
            f'{row.competitor:.4g} {row.unit}', f'{row.ratio:.3g}', row.goal,
            'yes' if row.met else 'NO')


def write(rows: list[Row], folder: Path) -> Path:
    """Write bench.json whole or not at all; return its path."""
    path = folder / 'bench.json'
    with atomic_write(path) as draft:
        draft.write_text(json.dumps([asdict(row) for row in rows], indent=2) + '\n')
    return path


def ratios(path: Path) -> dict[str, float]:
    """Return the ratios of a bench.json by their rows' names."""
    return {row['name']: row['ratio'] for row in json.loads(path.read_text())}
