"""
Study of the design: where the head can go, how well, and which link lengths are best.

Run it as ``workspace_study`` or ``python -m facade_manipulator.workspace.study``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict, fields
from pathlib import Path
import sys
from typing import NamedTuple

from rich.console import Console

from facade_manipulator.errors import exit_status, LimitError, ParameterError
from facade_manipulator.kinematics import Geometry, mechanism_of, Pose
from facade_manipulator.parameter_file import ALL_NODES, read_settings
from facade_manipulator.parameters import METADATA_KEY
from facade_manipulator.workspace import report
from facade_manipulator.workspace.accuracy import DriveTrain, worth_rows
from facade_manipulator.workspace.limits import theta_max, x_interval
from facade_manipulator.workspace.objectives import OBJECTIVES, Requirements
from facade_manipulator.workspace.optimise import optimise, sweep_size
from facade_manipulator.workspace.output import folder, json_file
from facade_manipulator.workspace.progress import progress_bar
from facade_manipulator.workspace.section import section_bounds
from facade_manipulator.workspace.singularities import beyond_share, studied_designs
from facade_manipulator.workspace.summary import summarise
from facade_manipulator.workspace.table2 import STROKE_LENGTH, table2

REPORT = Path('workspace_report')
BAD_INPUT = 2
EXAMPLES = """
examples:
  workspace_study                          everything, into workspace_report/
  workspace_study --table2                 Table 2 of the paper beside its figures
  workspace_study --summary --gap 0.02 --stroke 1 --threshold 0.1 --characteristic-length 1
                                           the machine's workspace, good from an index of 0.1
  workspace_study --ranges --gap 0.02      ranges of the design with 20 mm between carriages
  workspace_study --ranges --y 0.15 0.25   the same at two distances from the rail
  workspace_study --optimise area ratio    best l and b along l + b = 0.7 m
  workspace_study --optimise area --sum 0 --min-theta 0.3
                                           best in the whole box of Table 1 that turns 0.3 rad
  workspace_study --singularity --l 0.25 --b 0.45 --json share.json
  workspace_study --figures report --stroke 1.2
  workspace_study --accuracy --drive-force 59 --carriage-error 0.0001

Lengths are in m and angles in rad. Wrong input ends with exit status 2 and writes nothing.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; return the exit status."""
    options = _parser().parse_args(argv)
    return exit_status('workspace_study', lambda: _run(options), BAD_INPUT,
                       'interrupted, nothing was written')


def _run(options: argparse.Namespace) -> None:
    """Check every input, then compute, show and write the parts that were asked for."""
    parts = [name for name in PARTS if getattr(options, name) is not None]
    if not parts and options.figures is None:
        parts, options.figures = list(PARTS), REPORT
        options.optimise = []
        options.json = options.json or REPORT / 'study.json'
    of = _Inputs(options, _geometry(options), _requirements(options))
    with ExitStack() as stack:
        draft = stack.enter_context(folder(options.figures)) if options.figures else None
        content = stack.enter_context(json_file(options.json)) if options.json else {}
        content['inputs'] = {**asdict(of.geometry), 'threshold': of.need.threshold,
                             'characteristic_length': of.need.characteristic_length}
        # Wide enough for every column where the output is no terminal.
        console = Console(width=None if sys.stdout.isatty() else 120)
        for name in parts:
            key, data, table = PARTS[name](of)
            content[key] = data
            console.print(table)
        if draft:
            _draw(draft, of)
    if options.figures:
        print(f'figures are in {options.figures}/')
    if options.json:
        print(f'numbers are in {options.json}')


class _Inputs(NamedTuple):
    """What every part works with."""

    options: argparse.Namespace
    geometry: Geometry
    need: Requirements

    @property
    def train(self) -> DriveTrain:
        """What --accuracy assumes."""
        return DriveTrain(**{
            item.name: getattr(self.options, item.name) for item in fields(DriveTrain)})

    def title(self, what: str) -> str:
        """Return a title with the lengths of the design."""
        of = self.geometry
        return (f'{what} of l = {of.link_length * 1e3:g} mm, '
                f'b = {of.platform_half_length * 1e3:g} mm, '
                f'Q = {of.stroke_length * 1e3:g} mm, gap {of.carriage_gap * 1e3:g} mm')


def _table2_part(of: _Inputs) -> tuple:
    stroke_length = of.geometry.stroke_length if of.options.stroke else STROKE_LENGTH
    rows = table2(stroke_length)
    return 'table2', rows, report.table2_table(rows, stroke_length)


def _summary_part(of: _Inputs) -> tuple:
    summary = summarise(of.geometry, of.need.threshold, of.need.characteristic_length)
    return 'summary', summary, report.summary_table(summary, of.title('Workspace'))


def _ranges_part(of: _Inputs) -> tuple:
    rows = [_range(of.geometry, y) for y in of.options.y or _distances(of.geometry)]
    return 'ranges', rows, report.ranges_table(rows, of.title('Ranges'))


def _singularity_part(of: _Inputs) -> tuple:
    chosen = of.options.l is not None or of.options.b is not None
    designs = [of.geometry] if chosen else studied_designs(
        of.geometry.stroke, of.geometry.carriage_gap)
    rows = [{'l': design.link_length, 'b': design.platform_half_length,
             'share': beyond_share(design)} for design in designs]
    return 'beyond_parallel_singularity', rows, report.singularity_table(rows)


def _accuracy_part(of: _Inputs) -> tuple:
    head = mechanism_of(of.geometry).head
    distances = of.options.y or [head(Pose(0.0, y, 0.0)).y for y in _distances(of.geometry)]
    rows = worth_rows(of.geometry, distances, of.train)
    if not rows:
        raise ParameterError('the machine reaches none of these y')
    return 'accuracy', [row._asdict() for row in rows], report.accuracy_table(
        rows, of.title('Worth at theta = 0'))


def _optimise_part(of: _Inputs) -> tuple:
    optima = []
    for objective in of.options.optimise or OBJECTIVES:
        with progress_bar(f'optimise {objective}', sweep_size(objective, of.need)) as tick:
            optima.append(optimise(objective, of.need, tick))
    return 'optimum', [asdict(optimum) for optimum in optima], report.optimum_table(optima)


PARTS: dict[str, Callable[[_Inputs], tuple]] = {
    'table2': _table2_part,
    'summary': _summary_part,
    'ranges': _ranges_part,
    'accuracy': _accuracy_part,
    'singularity': _singularity_part,
    'optimise': _optimise_part,
}


def _draw(draft: Path, of: _Inputs) -> None:
    from facade_manipulator.workspace.drawing import Study, style
    from facade_manipulator.workspace.figures import FIGURES

    study = Study(of.geometry, of.need.threshold, of.need.characteristic_length, of.train)
    with style(), progress_bar('figures', len(FIGURES)) as tick:
        for name, draw in FIGURES.items():
            draw(study).savefig(draft / name)
            tick()


def _range(geometry: Geometry, y: float) -> dict[str, float]:
    """Return how far the head turns and, at θ = 0, travels at the distance y."""
    try:
        interval = x_interval(geometry, y)
        return {'y': y, 'theta_max': theta_max(geometry, y), 'x_max': max(map(abs, interval))}
    except LimitError as error:
        raise ParameterError(f'y = {y:g} m is out of the workspace: {error}') from error


def _distances(geometry: Geometry) -> list[float]:
    """Return every 10 mm that the head reaches at θ = 0."""
    lower, upper = section_bounds(
        geometry.link_length, geometry.platform_half_length, geometry.stroke_length,
        geometry.carriage_gap)
    steps = range(int(lower * 100.0) + 1, int(upper * 100.0) + 1)
    distances = [step / 100.0 for step in steps if lower < step / 100.0 < upper]
    if not distances:
        raise ParameterError(
            f'the workspace is empty at every 10 mm of y between {lower:.4g} m and {upper:.4g} m: '
            'give --y, a longer stroke or a smaller gap')
    return distances


def _geometry(options: argparse.Namespace) -> Geometry:
    if options.parameters is not None:
        if any(given is not None for given in (options.l, options.b, options.stroke)):
            raise ParameterError('--parameters has the lengths: --l, --b and --stroke have no use')
        return read_settings(options.parameters, ALL_NODES, 'geometry', Geometry)
    design = Geometry()
    return Geometry(
        design.link_length if options.l is None else options.l,
        design.platform_half_length if options.b is None else options.b,
        _stroke(options.stroke), options.gap)


def _stroke(values: list[float] | None) -> tuple[float, float]:
    """Return the stroke from its length, about zero, or from its two ends."""
    if not values:
        return Geometry().stroke
    if len(values) > 2:
        raise ParameterError(f'--stroke has {len(values)} values: give its length, or both ends')
    if len(values) == 1 and not values[0] > 0.0:
        raise ParameterError(f'stroke = {values[0]:g} m is not a positive length')
    return (-0.5 * values[0], 0.5 * values[0]) if len(values) == 1 else tuple(values)


def _requirements(options: argparse.Namespace) -> Requirements:
    good = {'threshold': options.threshold, 'characteristic_length': options.characteristic_length}
    if options.optimise is None:
        return Requirements(**good)
    return Requirements(
        tuple(options.link_range), tuple(options.platform_range), options.sum,
        _geometry(options).stroke_length, options.gap, options.min_y_travel, options.min_theta,
        options.min_conditioning, **good)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='workspace_study', description=__doc__.strip().splitlines()[0], epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = parser.add_argument_group('what to study (everything, if none is given)')
    for name, text in (
            ('table2', 'Table 2 of the paper beside its figures'),
            ('summary', 'ranges, areas, volume and shares of one design'),
            ('ranges', 'greatest theta and x over y'),
            ('accuracy', 'error, stiffness, pressing force and ellipses over y'),
            ('singularity',
             'share of the workspace beyond N = 0; of one design with --l and --b')):
        parts.add_argument(f'--{name}', action='store_true', default=None, help=text)
    parts.add_argument('--optimise', nargs='*', metavar='OBJECTIVE',
                       help=f'best l and b for {", ".join(OBJECTIVES)} (all, if none is named)')
    parts.add_argument('--figures', nargs='?', type=Path, const=REPORT, metavar='DIR',
                       help=f'draw the figures into DIR (default {REPORT}/)')
    parts.add_argument('--json', type=Path, metavar='FILE', help='write the numbers to FILE')
    _add_inputs(parser.add_argument_group('the design'))
    _add_drive_train(parser.add_argument_group('what --accuracy assumes'))
    _add_requirements(parser.add_argument_group('what --optimise requires'))
    return parser


def _add_inputs(group: argparse._ArgumentGroup) -> None:
    for name, default, text in (
            ('--l', None, 'length of the links [m] (default 0.352)'),
            ('--b', None, 'half the length of the platform [m] (default 0.348)'),
            ('--gap', 0.0, "least distance of the carriages [m] (default 0, the paper's; the "
                           'machine has 0.02)'),
            ('--threshold', 0.001, 'least conditioning index of a good pose (default 0.001)'),
            ('--characteristic-length', 0.001, 'unit of length of the index [m] (default 0.001, '
                                               "the paper's; 1 shows weak poses at the rail)")):
        group.add_argument(name, type=float, default=default, help=text)
    group.add_argument('--parameters', type=Path, metavar='YAML',
                       help='parameter file of a machine, for all of these lengths; --accuracy '
                            'goes by its errors too')
    group.add_argument('--stroke', type=float, nargs='+', metavar='M',
                       help='stroke of the carriages [m]: its length, or both ends (default 1; '
                            '--table2: 1.005)')
    group.add_argument('--y', type=float, nargs='+', action='extend',
                       help='distances from the rail for --ranges and --accuracy [m] '
                            '(default every 10 mm)')


def _add_drive_train(group: argparse._ArgumentGroup) -> None:
    for item in fields(DriveTrain):
        info = item.metadata[METADATA_KEY]
        name = 'drive_' + item.name if item.name in ('force', 'speed') else item.name
        group.add_argument(
            '--' + name.replace('_', '-'), dest=item.name, type=float, default=item.default,
            metavar=info.unit.upper(),
            help=f'{info.description} [{info.unit}] (default {item.default:g})')


def _add_requirements(group: argparse._ArgumentGroup) -> None:
    group.add_argument('--sum', type=float, default=0.7,
                       help='l + b [m]; 0 leaves it free (default 0.7)')
    for name, default in (('--link-range', (0.15, 0.40)), ('--platform-range', (0.30, 0.55))):
        group.add_argument(name, type=float, nargs=2, default=default, metavar=('MIN', 'MAX'),
                           help=f'[m] (default {default[0]:g} {default[1]:g}, Table 1)')
    for name, text in (('--min-y-travel', 'range of y at theta = 0 [m]'),
                       ('--min-theta', 'theta at some y [rad]'),
                       ('--min-conditioning', 'index over that range of y')):
        group.add_argument(name, type=float, default=0.0, help=f'least {text} (default 0)')


if __name__ == '__main__':
    sys.exit(main())
