"""The study's tables: what each computes, for JSON, and how it looks in a terminal."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import asdict, replace
import math
from typing import Any, NamedTuple

from rich.table import Table

from facade_manipulator.errors import LimitError, ParameterError
from facade_manipulator.kinematics import Geometry, mechanism_of, Pose, x_intervals
from facade_manipulator.lab.study.accuracy import DriveTrain, Worth, worth_rows
from facade_manipulator.lab.study.gcw import STROKE_LENGTH, table2
from facade_manipulator.lab.study.optimise import OBJECTIVES, optimise, sweep_size
from facade_manipulator.lab.study.output import progress_bar, table
from facade_manipulator.lab.study.reach import theta_max
from facade_manipulator.lab.study.requirements import Requirements, theta_peak
from facade_manipulator.lab.study.section import section_area, section_bounds
from facade_manipulator.lab.study.singularities import beyond_share
from facade_manipulator.lab.study.sweep import executor_of, Sweep
from facade_manipulator.lab.study.volume import measure, union_area

AREA_NOTE = (
    'The ratios are those of the paper to its three digits. Its areas are not: it states neither '
    'the stroke nor what its area is. Section and union are areas for one common stroke, tuned '
    'to nothing.')
STUDIED_SUM = 0.7  # l + b of the paper's cases [m]
STUDIED_LENGTHS = (0.15, 0.2, 0.25, 0.3, 0.34, 0.349, 0.35, 0.352)
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
Part = tuple[str, Any, Table]  # key and content of the JSON file, and what is shown


class Study(NamedTuple):
    """What is studied: a design, what is required of it and called good, what carries the head."""

    geometry: Geometry
    need: Requirements = Requirements()
    train: DriveTrain = DriveTrain()

    def title(self, what: str) -> str:
        """Return a title with the lengths of the design."""
        return (f'{what} of {lengths(self.geometry)}, Q = {_mm(self.geometry.stroke_length)} mm, '
                f'gap {_mm(self.geometry.carriage_gap)} mm')


def lengths(geometry: Geometry) -> str:
    """Return the lengths of a mechanism, for a title."""
    return f'l = {_mm(geometry.link_length)} mm, b = {_mm(geometry.platform_half_length)} mm'


def table_of_cases(study: Study, options: argparse.Namespace) -> Part:
    """Table 2 of the paper beside its figures."""
    stroke_length = study.geometry.stroke_length if 'stroke' in options else STROKE_LENGTH
    rows = table2(stroke_length)
    return 'table2', rows, table(
        f'Table 2 with Q = {_mm(stroke_length)} mm: good-condition ratio and areas [m2]',
        ('l [mm]', 'b [mm]', 'ratio', 'paper', 'diff.', 'section', 'union', 'paper',
         'ratio x section', 'paper'), (_case(row, row['paper']) for row in rows), AREA_NOTE)


def _case(row: dict[str, Any], paper: dict[str, Any]) -> tuple[str, ...]:
    ratio, section, union = row['ratio'], row['area_section'], row['area_union']
    return (_mm(row['l']), _mm(row['b']), f'{ratio:.4f}', f'{paper["ratio"]:.3f}',
            f'{ratio - paper["ratio"]:+.4f}', f'{section:.4f}', f'{union:.4f}',
            f'{paper["area"]:.3f}', f'{row["good_area_section"]:.4f}',
            f'{paper["good_area"]:.3f}')


def summary(study: Study, options: argparse.Namespace) -> Part:
    """Ranges, areas, volume and shares of one design."""
    found = summarise(study.geometry, study.need.threshold, study.need.characteristic_length)
    return 'summary', found, table(study.title('Workspace'), ('quantity', 'value', 'unit'), (
        (words, f'{found[key] * factor:.5g}', unit) for key, words, factor, unit in SUMMARY))


def summarise(
    geometry: Geometry, threshold: float, characteristic_length: float
) -> dict[str, float]:
    """
    Measure one design, in m, m², m² rad and rad; `SUMMARY` says what each number is.

    Raises a ParameterError if the workspace is empty.
    """
    lower, upper = section_bounds(geometry)
    of = measure(geometry, threshold, characteristic_length, theta_nodes=512, y_cells=256)
    if not of.volume > 0.0:
        raise ParameterError(
            f'the workspace is empty: stroke {geometry.stroke_length:g} m and carriage_gap '
            f'{geometry.carriage_gap:g} m leave no pose')
    return {
        'y_min': float(lower), 'y_max': float(upper),
        'theta_max': float(theta_peak(geometry)),
        'area_section': float(section_area(geometry)),
        'good_area_section': float(section_area(geometry, threshold, characteristic_length)),
        'area_union': union_area(geometry), 'volume': of.volume, 'good_volume': of.good,
        'ratio': of.ratio, 'beyond_parallel_singularity': of.beyond_share,
    }


def ranges(study: Study, options: argparse.Namespace) -> Part:
    """Greatest theta and x over y."""
    rows = [_range(study.geometry, y) for y in options.y or _distances(study.geometry)]
    return 'ranges', rows, table(
        study.title('Ranges'), ('y [mm]', 'theta max [deg]', 'x max at theta = 0 [mm]'), (
            (f'{row["y"] * 1e3:.1f}', f'{math.degrees(row["theta_max"]):.2f}',
             f'{row["x_max"] * 1e3:.1f}') for row in rows))


def _range(geometry: Geometry, y: float) -> dict[str, float]:
    try:
        turn = theta_max(geometry, y)
    except LimitError as error:
        raise ParameterError(f'y = {y:g} m is out of the workspace: {error}') from error
    (lower,), (upper,) = x_intervals(geometry, y, 0.0)
    if math.isnan(lower):
        raise ParameterError(
            f'y = {y:g} m is out of the workspace: a stroke of {geometry.stroke_length:g} m is '
            'too short there')
    return {'y': y, 'theta_max': turn, 'x_max': float(max(-lower, upper))}


def _distances(geometry: Geometry) -> list[float]:
    """Return every 10 mm that the head reaches at θ = 0."""
    lower, upper = section_bounds(geometry)
    steps = range(int(lower * 100.0) + 1, int(upper * 100.0) + 1)
    distances = [step / 100.0 for step in steps if lower < step / 100.0 < upper]
    if not distances:
        raise ParameterError(
            f'the workspace is empty at every 10 mm of y between {lower:.4g} m and {upper:.4g} m: '
            'give --y, a longer stroke or a smaller gap')
    return distances


def accuracy(study: Study, options: argparse.Namespace) -> Part:
    """Error, stiffness, pressing force, and speed and force in the plane over y."""
    head = mechanism_of(study.geometry).head
    rows = worth_rows(
        study.geometry,
        options.y or [head(Pose(0.0, y, 0.0)).y for y in _distances(study.geometry)], study.train)
    if not rows:
        raise ParameterError('the machine reaches none of these y')
    return 'accuracy', [row._asdict() | {
        'speeds': row.speeds._asdict(), 'forces': row.forces._asdict()} for row in rows], table(
        study.title('Worth at theta = 0'),
        ('y [mm]', 'x +- [mm]', 'y +- [mm]', 'theta +- [deg]', 'kx [N/um]', 'ky [N/um]',
         'press [N]', 'speed [m/s]', 'force [N]'), map(_worth, rows),
        'speed and force: along x, along y, and in whichever direction, without turning and '
        'without moment; press: force on the wall that the drives hold for long')


def _worth(row: Worth) -> tuple[str, ...]:
    x, y, theta = row.errors
    return (f'{row.y * 1e3:.0f}', f'{x * 1e3:.3f}', f'{y * 1e3:.3f}',
            f'{math.degrees(theta):.3f}', f'{row.stiffness[0] * 1e-6:.2f}',
            f'{row.stiffness[1] * 1e-6:.2f}', f'{row.pressing:.0f}',
            *(f'{x:.3g} {y:.3g} {least:.3g}' for x, y, least, _ in (row.speeds, row.forces)))


def singularity(study: Study, options: argparse.Namespace) -> Part:
    """Share of the workspace beyond N = 0; of one design with --l and --b."""
    geometry = study.geometry
    chosen = 'link_length' in options or 'platform_half_length' in options
    designs = [geometry] if chosen else [
        replace(geometry, link_length=length, platform_half_length=round(STUDIED_SUM - length, 9))
        for length in STUDIED_LENGTHS]
    rows = [{'l': design.link_length, 'b': design.platform_half_length,
             'share': beyond_share(design)} for design in designs]
    return 'beyond_parallel_singularity', rows, table(
        'Workspace beyond the parallel singularity N = 0, which the paper misses',
        ('l [mm]', 'b [mm]', 'share [%]'),
        ((_mm(row['l']), _mm(row['b']), f'{100.0 * row["share"]:.1f}') for row in rows))


def optimum(study: Study, options: argparse.Namespace) -> Part:
    """Best design for every objective, and what holds it there."""
    optima = []
    with executor_of(options.scheduler) as executor:
        measured = Sweep(study.need, executor, options.results)
        for objective in options.optimise or OBJECTIVES:
            with progress_bar(f'optimise {objective}', sweep_size(objective, study.need)) as tick:
                optima.append(optimise(objective, study.need, tick, measured))
    need = {'requirements': asdict(study.need)}
    return 'optimum', [asdict(one) | need for one in optima], table(
        'Optimum', ('objective', 'l [mm]', 'b [mm]', 'value', 'unit', 'designs', 'active'),
        ((one.objective, f'{one.link_length * 1e3:.2f}', f'{one.platform_half_length * 1e3:.2f}',
          f'{one.value:.4f}', OBJECTIVES[one.objective].unit, f'{one.designs}',
          '; '.join(one.active) or 'none: an inner optimum') for one in optima))


# their docstrings are the options' help
PARTS: dict[str, Callable[[Study, argparse.Namespace], Part]] = {
    'table2': table_of_cases,
    'summary': summary,
    'ranges': ranges,
    'accuracy': accuracy,
    'singularity': singularity,
    'optimise': optimum,
}


def _mm(length: float) -> str:
    return f'{length * 1e3:g}'
