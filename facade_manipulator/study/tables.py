"""Tables of the study, each with its numbers for JSON and its form for a terminal."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
import math
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from rich.text import Text

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.kinematics.maps import x_intervals
from facade_manipulator.study import optimum, paper, workspace
from facade_manipulator.study.workspace import Good, PAPER_GOOD

AREA_NOTE = (
    'The ratios agree with the paper to its three digits. The areas do not: the paper states '
    'neither the stroke nor the definition of its area. Section and union are areas for one '
    'common stroke, without any tuning.'
)
STUDIED_LENGTHS = (
    0.15,
    0.2,
    0.25,
    0.3,
    0.34,
    0.349,
    0.35,
    0.352,
)  # l of --singularity [m]
WORDS = (
    'quantity',
    'unit',
    'objective',
    'designs',
)  # columns of words instead of numbers
Part = tuple[
    str, Any, Table
]  # key and content of the JSON file, table for the terminal


class Study(NamedTuple):
    """Subject of the study: a design, and the definition of a good pose."""

    geometry: Geometry
    good: Good = PAPER_GOOD

    def title(self, subject: str) -> str:
        """Return a title with the lengths of the design."""
        return (
            f'{subject}, {lengths(self.geometry)}, Q = {_mm(self.geometry.stroke_length)} '
            f'mm, gap {_mm(self.geometry.carriage_gap)} mm'
        )


def lengths(geometry: Geometry) -> str:
    """Return the lengths of the links and of half the platform, for a title."""
    return f'l = {_mm(geometry.link_length)} mm, b = {_mm(geometry.platform_half_length)} mm'


def progress(items: Iterable[Any], total: int, title: str = 'designs') -> Iterable[Any]:
    """Yield items with a progress bar on standard error, if this is a terminal."""
    console = Console(stderr=True)
    return track(
        items,
        title,
        total,
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


def table_of_cases(study: Study, options: argparse.Namespace) -> Part:
    """Print the computed Table 2 beside the numbers of the paper."""
    rows = paper.table2(study.geometry.stroke_length)
    return (
        'table2',
        rows,
        _table(
            f'Table 2 with Q = {_mm(study.geometry.stroke_length)} mm: good-condition ratio and '
            'areas [m2]',
            (
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
            ),
            map(_case, rows),
            AREA_NOTE,
        ),
    )


def _case(row: dict[str, Any]) -> tuple[str, ...]:
    ratio, printed = row['ratio'], row['paper']
    return (
        _mm(row['l']),
        _mm(row['b']),
        f'{ratio:.4f}',
        f'{printed["ratio"]:.3f}',
        f'{ratio - printed["ratio"]:+.4f}',
        f'{row["area_section"]:.4f}',
        f'{row["area_union"]:.4f}',
        f'{printed["area"]:.3f}',
        f'{row["good_area_section"]:.4f}',
        f'{printed["good_area"]:.3f}',
    )


def summary(study: Study, options: argparse.Namespace) -> Part:
    """Print ranges, areas, volume and shares of the design."""
    geometry, good = study
    lower, upper = workspace.section_bounds(geometry)
    volume, ratio, beyond_share = workspace.measure(geometry, good)
    if not volume > 0.0:
        raise ParameterError(
            f'the workspace is empty: stroke {geometry.stroke_length:g} m and carriage_gap '
            f'{geometry.carriage_gap:g} m leave no pose; next: set a longer stroke'
        )
    rows = (
        ('y_min', 'minimum y at theta = 0', lower, 'm'),
        ('y_max', 'maximum y at theta = 0', upper, 'm'),
        (
            'theta_max',
            'maximum theta at any y, before N = 0',
            workspace.theta_peak(geometry)[1],
            'rad',
        ),
        ('area_section', 'area at theta = 0', workspace.section_area(geometry), 'm2'),
        (
            'good_area_section',
            'area of good poses at theta = 0',
            workspace.section_area(geometry, good),
            'm2',
        ),
        ('area_union', 'area over all theta', workspace.union_area(geometry), 'm2'),
        ('volume', 'volume over x, y and theta', volume, 'm2 rad'),
        ('good_volume', 'volume of good poses', ratio * volume, 'm2 rad'),
        ('ratio', 'good-condition ratio', ratio, ''),
        ('beyond_parallel_singularity', 'share beyond N = 0', beyond_share, ''),
    )
    return (
        'summary',
        {key: value for key, _, value, _ in rows},
        _table(
            study.title('Workspace'),
            ('quantity', 'value', 'unit'),
            ((words, f'{value:.5g}', unit) for _, words, value, unit in rows),
        ),
    )


def ranges(study: Study, options: argparse.Namespace) -> Part:
    """Print the maximum θ and x for every y."""
    lower, upper = workspace.section_bounds(study.geometry)
    every = [step / 100.0 for step in range(int(100.0 * upper) + 1)]
    y = np.array(options.y or [at for at in every if lower < at < upper])
    _, ends = x_intervals(study.geometry, y, 0.0)
    if np.isnan(ends).any():
        raise ParameterError(
            f'y = {y[np.isnan(ends)][0]:g} m rejected: at theta = 0 the head reaches from '
            f'{lower:.4g} m to {upper:.4g} m; next: set --y within this range'
        )
    turns = workspace.theta_limits(study.geometry, y)
    rows = [
        {'y': at, 'theta_max': turn, 'x_max': end}
        for at, turn, end in zip(y.tolist(), turns.tolist(), ends.tolist(), strict=True)
    ]
    return (
        'ranges',
        rows,
        _table(
            study.title('Ranges'),
            ('y [mm]', 'theta max [deg]', 'x max at theta = 0 [mm]'),
            (
                (
                    f'{row["y"] * 1e3:.1f}',
                    f'{math.degrees(row["theta_max"]):.2f}',
                    f'{row["x_max"] * 1e3:.1f}',
                )
                for row in rows
            ),
        ),
    )


def singularity(study: Study, options: argparse.Namespace) -> Part:
    """Print the share beyond N = 0 of a given design, by default of some with l + b = 700 mm."""
    geometry = study.geometry
    studied = [(geometry.link_length, geometry.platform_half_length)]
    if studied[0] == paper.CASES[-1][:2]:
        studied = [
            (length, round(paper.LENGTH_SUM - length, 9)) for length in STUDIED_LENGTHS
        ]
    rows = [
        {
            'l': length,
            'b': half,
            'share': workspace.measure(
                replace(geometry, link_length=length, platform_half_length=half)
            ).beyond_share,
        }
        for length, half in studied
    ]
    return (
        'beyond_parallel_singularity',
        rows,
        _table(
            'Workspace beyond the parallel singularity N = 0, which the paper misses, '
            f'Q = {_mm(geometry.stroke_length)} mm',
            ('l [mm]', 'b [mm]', 'share [%]'),
            (
                (_mm(row['l']), _mm(row['b']), f'{100.0 * row["share"]:.1f}')
                for row in rows
            ),
        ),
    )


def optima(study: Study, options: argparse.Namespace) -> Part:
    """Print the best design of a sweep of l and b for every objective."""
    geometry, good = study
    designs = optimum.designs(options.sum, options.step)
    with optimum.executor_of(options.scheduler) as executor:
        merits = optimum.sweep(designs, geometry, good, executor, progress)
    rows = optimum.best(merits, options.optimise or optimum.OBJECTIVES)
    return (
        'optimum',
        rows,
        _table(
            f'Optimum with Q = {_mm(geometry.stroke_length)} mm, '
            f'gap {_mm(geometry.carriage_gap)} mm',
            (
                'objective',
                'designs',
                'count',
                'l [mm]',
                'b [mm]',
                'value',
                'unit',
                'beyond N = 0 [%]',
            ),
            (
                (
                    one['objective'],
                    one['designs'],
                    str(one['count']),
                    _mm(one['link_length']),
                    _mm(one['platform_half_length']),
                    f'{one["value"]:.4f}',
                    optimum.OBJECTIVES[one['objective']],
                    f'{100.0 * one["beyond_share"]:.1f}',
                )
                for one in rows
            ),
        ),
    )


# The docstrings serve as help texts of the options.
PARTS: dict[str, Callable[[Study, argparse.Namespace], Part]] = {
    'table2': table_of_cases,
    'summary': summary,
    'ranges': ranges,
    'singularity': singularity,
    'optimise': optima,
}


def _table(
    title: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    caption: str | None = None,
) -> Table:
    # Texts instead of plain strings, because rich would interpret the units as its markup.
    made = Table(
        title=Text(title, no_wrap=True, overflow='ignore'),
        title_justify='left',
        caption=caption,
        caption_justify='left',
    )
    for name in columns:
        made.add_column(Text(name), justify='left' if name in WORDS else 'right')
    for row in rows:
        made.add_row(*map(Text, row))
    return made


def _mm(length: float) -> str:
    return f'{length * 1e3:g}'
