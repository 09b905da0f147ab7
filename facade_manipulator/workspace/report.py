"""The study's results as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import math

from rich.table import Table
from rich.text import Text

from facade_manipulator.workspace.accuracy import Worth
from facade_manipulator.workspace.objectives import OBJECTIVES
from facade_manipulator.workspace.optimise import Optimum

AREA_NOTE = (
    'The ratios are those of the paper to its three digits. Its areas are not: it states neither '
    'the stroke nor what its area is. Section and union are areas for one common stroke, tuned '
    'to nothing.')


def table2_table(rows: Sequence[dict], stroke_length: float) -> Table:
    """Table 2: paper, ours and the difference."""
    table = _table(
        f'Table 2 with Q = {stroke_length * 1e3:g} mm: good-condition ratio and areas [m2]',
        ('l [mm]', 'b [mm]', 'ratio', 'paper', 'diff.', 'section', 'union', 'paper',
         'section diff.', 'union diff.'), (_table2_row(row, row['paper']) for row in rows))
    table.caption = AREA_NOTE
    return table


def _table2_row(row: dict, paper: dict) -> tuple[str, ...]:
    ratio, section, union = row['ratio'], row['area_section'], row['area_union']
    return (_mm(row['l']), _mm(row['b']), f'{ratio:.4f}', f'{paper["ratio"]:.3f}',
            f'{ratio - paper["ratio"]:+.4f}', f'{section:.4f}', f'{union:.4f}',
            f'{paper["area"]:.3f}', f'{section - paper["area"]:+.4f}',
            f'{union - paper["area"]:+.4f}')


def ranges_table(rows: Sequence[dict], title: str) -> Table:
    """How far the head turns and travels at every distance."""
    return _table(title, ('y [mm]', 'theta max [deg]', 'x max at theta = 0 [mm]'), (
        (f'{row["y"] * 1e3:.1f}', f'{math.degrees(row["theta_max"]):.2f}',
         f'{row["x_max"] * 1e3:.1f}') for row in rows))


def accuracy_table(rows: Sequence[Worth], title: str) -> Table:
    """Return what the poses at every distance are worth."""
    table = _table(
        title, ('y [mm]', 'x +- [mm]', 'y +- [mm]', 'theta +- [deg]', 'kx [N/um]', 'ky [N/um]',
                'press [N]', 'speed [m/s]', 'force [N]'), map(_accuracy_row, rows))
    table.caption = ('speed and force: half axes of the ellipses in the plane, without turning '
                     'and without moment; press: force on the wall that the drives hold for long')
    return table


def _accuracy_row(row: Worth) -> tuple[str, ...]:
    x, y, theta = row.errors
    return (f'{row.y * 1e3:.0f}', f'{x * 1e3:.3f}', f'{y * 1e3:.3f}',
            f'{math.degrees(theta):.3f}', f'{row.stiffness[0] * 1e-6:.2f}',
            f'{row.stiffness[1] * 1e-6:.2f}', f'{row.pressing:.0f}',
            *(f'{most:.3g} x {least:.3g}' for most, least, _ in (row.speeds, row.forces)))


WORDS = ('objective', 'quantity', 'unit', 'active')  # columns of words, not of numbers
SUMMARY = (  # key, words, factor, unit
    ('y_min', 'least y at theta = 0', 1e3, 'mm'),
    ('y_max', 'greatest y at theta = 0', 1e3, 'mm'),
    ('theta_max', 'greatest theta at any y, before N = 0', math.degrees(1.0), 'deg'),
    ('area_section', 'area at theta = 0', 1.0, 'm2'),
    ('good_area_section', 'of it with a good index', 1.0, 'm2'),
    ('area_union', 'area over all theta', 1.0, 'm2'),
    ('volume', 'volume over x, y and theta', 1.0, 'm2 rad'),
    ('good_volume', 'of it with a good index', 1.0, 'm2 rad'),
    ('ratio', 'good-condition ratio', 1.0, ''),
    ('beyond_parallel_singularity', 'share beyond N = 0', 1.0, ''),
)


def summary_table(summary: dict[str, float], title: str) -> Table:
    """One design in a dozen numbers."""
    return _table(title, ('quantity', 'value', 'unit'), (
        (words, f'{summary[key] * factor:.5g}', unit) for key, words, factor, unit in SUMMARY))


def singularity_table(rows: Sequence[dict]) -> Table:
    """Share of every design's workspace beyond N = 0."""
    return _table(
        'Workspace beyond the parallel singularity N = 0, which the paper misses',
        ('l [mm]', 'b [mm]', 'share [%]'),
        ((_mm(row['l']), _mm(row['b']), f'{100.0 * row["share"]:.1f}') for row in rows))


def optimum_table(optima: Sequence[Optimum]) -> Table:
    """Best design for every objective, and what holds it there."""
    return _table(
        'Optimum', ('objective', 'l [mm]', 'b [mm]', 'value', 'unit', 'designs', 'active'),
        ((one.objective, f'{one.link_length * 1e3:.2f}', f'{one.platform_half_length * 1e3:.2f}',
          f'{one.value:.4f}', OBJECTIVES[one.objective].unit, f'{one.designs}',
          '; '.join(one.active) or 'none: an inner optimum') for one in optima))


def _table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    # As texts: in plain strings rich would take the units for its markup.
    table = Table(title=Text(title, no_wrap=True, overflow='ignore'), title_justify='left',
                  caption_justify='left')
    for name in columns:
        table.add_column(Text(name), justify='left' if name in WORDS else 'right')
    for row in rows:
        table.add_row(*row)
    return table


def _mm(length: float) -> str:
    return f'{length * 1e3:.0f}'
