"""Tables of the study, each as values for JSON and as text for a terminal."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
import math
from typing import Any, Literal, NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from rich.text import Text

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.kinematics.maps import x_intervals
from facade_manipulator.study import optimum, paper, workspace_metrics
from facade_manipulator.study.workspace_metrics import Good, PAPER_GOOD

#: key and content of the JSON file, table for the terminal
Part = tuple[str, Any, Table]


class Study(NamedTuple):
    """Subject of the study: a design, and the criterion for a good pose."""

    geometry: Geometry
    good: Good = PAPER_GOOD

    def title(self, subject: str) -> str:
        """Return a title that contains the lengths of the design."""
        stroke = _mm(self.geometry.stroke_length)
        gap = _mm(self.geometry.carriage_gap)
        return f'{subject}, {lengths(self.geometry)}, Q = {stroke} mm, gap {gap} mm'


class Quantity(NamedTuple):
    """One row of the summary."""

    key: str  #: of the JSON file
    words: str
    value: float
    unit: str


def lengths(geometry: Geometry) -> str:
    """Return the lengths of links and half platform as text for a title."""
    length = _mm(geometry.link_length)
    half = _mm(geometry.platform_half_length)
    return f'l = {length} mm, b = {half} mm'


def progress(items: Iterable[Any], total: int, title: str = 'designs') -> Iterable[Any]:
    """Yield items with a progress bar on standard error if it is a terminal."""
    console = Console(stderr=True)
    return track(
        items,
        title,
        total,
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


AREA_NOTE = (
    'The ratios agree with the paper to its three digits. The areas do not: the paper states '
    'neither the stroke nor the definition of its area. Section and union are areas for one '
    'common stroke, without any tuning.'
)
CASE_COLUMNS = (
    'l [mm]',
    'b [mm]',
    'ratio',
    'paper',
    'diff.',
    'section',
    'union',
    'paper',
    'ratio x section',
    'paper',
)


def table_of_cases(study: Study, options: argparse.Namespace) -> Part:
    """Print the computed Table 2 next to the values of the paper."""
    stroke = study.geometry.stroke_length
    rows = paper.table2(stroke)
    title = f'Table 2 with Q = {_mm(stroke)} mm: good-condition ratio and areas [m2]'
    table = _table(title, CASE_COLUMNS, map(_case, rows), AREA_NOTE)
    return 'table2', rows, table


def _case(row: dict[str, Any]) -> tuple[str, ...]:
    """Return the cells for a row of Table 2."""
    ratio = row['ratio']
    printed = row['paper']
    ratios = (
        f'{ratio:.4f}',
        f'{printed["ratio"]:.3f}',
        f'{ratio - printed["ratio"]:+.4f}',
    )
    areas = (
        f'{row["area_section"]:.4f}',
        f'{row["area_union"]:.4f}',
        f'{printed["area"]:.3f}',
    )
    good_areas = (f'{row["good_area_section"]:.4f}', f'{printed["good_area"]:.3f}')
    return (_mm(row['l']), _mm(row['b']), *ratios, *areas, *good_areas)


THETA_MAX = 'maximum theta at any y, before N = 0'
GOOD_SECTION = 'area of good poses at theta = 0'


def summary(study: Study, options: argparse.Namespace) -> Part:
    """Print ranges, areas, volume and shares of the design."""
    geometry, good = study
    lower, upper = workspace_metrics.section_bounds(geometry)
    volume, ratio, beyond_share = workspace_metrics.measure(geometry, good)
    if not volume > 0.0:
        raise ParameterError(
            f'the workspace is empty: stroke {geometry.stroke_length:g} m and carriage_gap '
            f'{geometry.carriage_gap:g} m leave no pose; next: set a longer stroke'
        )
    _, theta_max = workspace_metrics.theta_peak(geometry)
    section = workspace_metrics.section_area(geometry)
    good_section = workspace_metrics.section_area(geometry, good)
    union = workspace_metrics.union_area(geometry)
    rows = (
        Quantity('y_min', 'minimum y at theta = 0', lower, 'm'),
        Quantity('y_max', 'maximum y at theta = 0', upper, 'm'),
        Quantity('theta_max', THETA_MAX, theta_max, 'rad'),
        Quantity('area_section', 'area at theta = 0', section, 'm2'),
        Quantity('good_area_section', GOOD_SECTION, good_section, 'm2'),
        Quantity('area_union', 'area over all theta', union, 'm2'),
        Quantity('volume', 'volume over x, y and theta', volume, 'm2 rad'),
        Quantity('good_volume', 'volume of good poses', ratio * volume, 'm2 rad'),
        Quantity('ratio', 'good-condition ratio', ratio, ''),
        Quantity('beyond_parallel_singularity', 'share beyond N = 0', beyond_share, ''),
    )

    content = {}
    cells = []
    for row in rows:
        content[row.key] = row.value
        cells.append((row.words, f'{row.value:.5g}', row.unit))
    table = _table(study.title('Workspace'), ('quantity', 'value', 'unit'), cells)
    return 'summary', content, table


RANGE_COLUMNS = ('y [mm]', 'theta max [deg]', 'x max at theta = 0 [mm]')


def ranges(study: Study, options: argparse.Namespace) -> Part:
    """Print the maximum θ and x for every y."""
    workspace_metrics.require_section(study.geometry)
    lower, upper = workspace_metrics.section_bounds(study.geometry)
    y = np.array(options.y or _every_centimetre(lower, upper))
    _, ends = x_intervals(study.geometry, y, 0.0)
    is_outside = np.isnan(ends) | (
        y < 0.0
    )  # the equations contain only the square of y
    if is_outside.any():
        raise ParameterError(
            f'y = {y[is_outside][0]:g} m rejected: at theta = 0 the head reaches from '
            f'{lower:.4g} m to {upper:.4g} m; next: set --y within this range'
        )

    turns = workspace_metrics.theta_limits(study.geometry, y)
    rows = []
    cells = []
    for place, turn, end in zip(y.tolist(), turns.tolist(), ends.tolist(), strict=True):
        rows.append({'y': place, 'theta_max': turn, 'x_max': end})
        angle = math.degrees(turn)
        cells.append((f'{place * 1e3:.1f}', f'{angle:.2f}', f'{end * 1e3:.1f}'))
    return 'ranges', rows, _table(study.title('Ranges'), RANGE_COLUMNS, cells)


def _every_centimetre(lower: float, upper: float) -> list[float]:
    """Return the multiples of 0.01 m between two values [m]."""
    places = []
    for number in range(int(100.0 * upper) + 1):
        place = number / 100.0
        if lower < place < upper:
            places.append(place)
    return places


# l of --singularity [m]
STUDIED_LENGTHS = (0.15, 0.2, 0.25, 0.3, 0.34, 0.349, 0.35, 0.352)


def singularity(study: Study, options: argparse.Namespace) -> Part:
    """Print the share beyond N = 0 of a given design, by default of some with l + b = 700 mm."""
    geometry = study.geometry
    studied = [(geometry.link_length, geometry.platform_half_length)]
    if studied[0] == paper.CASES[-1][:2]:
        studied = []
        for length in STUDIED_LENGTHS:
            studied.append((length, round(paper.LENGTH_SUM - length, 9)))

    rows = []
    cells = []
    for length, half in studied:
        one = replace(geometry, link_length=length, platform_half_length=half)
        share = workspace_metrics.measure(one).beyond_share
        rows.append({'l': length, 'b': half, 'share': share})
        cells.append((_mm(length), _mm(half), f'{100.0 * share:.1f}'))
    title = (
        'Workspace beyond the parallel singularity N = 0, which the paper misses, '
        f'Q = {_mm(geometry.stroke_length)} mm'
    )
    table = _table(title, ('l [mm]', 'b [mm]', 'share [%]'), cells)
    return 'beyond_parallel_singularity', rows, table


OPTIMUM_COLUMNS = (
    'objective',
    'designs',
    'count',
    'l [mm]',
    'b [mm]',
    'value',
    'unit',
    'beyond N = 0 [%]',
)


def optima(study: Study, options: argparse.Namespace) -> Part:
    """Print the best design of a sweep of l and b for each objective."""
    geometry, good = study
    designs = optimum.designs(options.sum, options.step)
    with optimum.executor_of(options.scheduler) as executor:
        merits = optimum.sweep(designs, geometry, good, executor, progress)
    rows = optimum.best(merits, options.optimise or optimum.OBJECTIVES)

    cells = []
    for row in rows:
        which = (row['objective'], row['designs'], str(row['count']))
        design = (_mm(row['link_length']), _mm(row['platform_half_length']))
        value = (f'{row["value"]:.4f}', optimum.OBJECTIVES[row['objective']])
        share = f'{100.0 * row["beyond_share"]:.1f}'
        cells.append((*which, *design, *value, share))
    stroke = _mm(geometry.stroke_length)
    gap = _mm(geometry.carriage_gap)
    title = f'Optimum with Q = {stroke} mm, gap {gap} mm'
    return 'optimum', rows, _table(title, OPTIMUM_COLUMNS, cells)


# The docstrings serve as help texts of the options.
PARTS: dict[str, Callable[[Study, argparse.Namespace], Part]] = {
    'table2': table_of_cases,
    'summary': summary,
    'ranges': ranges,
    'singularity': singularity,
    'optimise': optima,
}


# columns of words instead of numbers
WORDS = ('quantity', 'unit', 'objective', 'designs')


def _table(
    title: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    caption: str | None = None,
) -> Table:
    """Return a table for the terminal; align words left and numbers right."""
    # Texts instead of plain strings, because rich would interpret the units as its markup.
    made = Table(
        title=Text(title, no_wrap=True, overflow='ignore'),
        title_justify='left',
        caption=caption,
        caption_justify='left',
    )
    for name in columns:
        side: Literal['left', 'right'] = 'left' if name in WORDS else 'right'
        made.add_column(Text(name), justify=side)
    for row in rows:
        made.add_row(*map(Text, row))
    return made


def _mm(length: float) -> str:
    return f'{length * 1e3:g}'
