"""
Study of the design: where the head can go, how well, and which link lengths are best.

Run it as ``workspace_study`` or ``python -m facade_manipulator.lab.study.study``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
import sys

from facade_manipulator.errors import exit_status, ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.lab.study.accuracy import DriveTrain
from facade_manipulator.lab.study.optimise import OBJECTIVES
from facade_manipulator.lab.study.options import add_settings
from facade_manipulator.lab.study.output import console, folder, json_file, progress_bar
from facade_manipulator.lab.study.requirements import Requirements
from facade_manipulator.lab.study.tables import PARTS, Study
from facade_manipulator.parameter_file import ALL_NODES, read_settings
from facade_manipulator.parameters import parameter_fields, settings_from

REPORT = Path('workspace_report')
BAD_INPUT = 2
GOOD = ('threshold', 'characteristic_length')  # what of the requirements says what is good
CARRIAGES = ('carriage_gap', 'carriage_length')
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
  workspace_study --optimise volume ratio --sum 0 --designs 100000 --results designs.jsonl
                                           many designs; interrupted, a rerun goes on from there
  workspace_study --singularity --l 0.25 --b 0.45 --json share.json
  workspace_study --figures report --stroke 1.2
  workspace_study --accuracy --drive-force 59 --carriage-error 0.0001

Lengths are in m and angles in rad. Wrong input ends with exit status 2 and writes nothing.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; return the exit status."""
    options = _parser().parse_args(argv)
    kept = f' but {options.results}' if options.results else ''
    return exit_status('workspace_study', lambda: _run(options), BAD_INPUT,
                       f'interrupted, nothing was written{kept}')


def _run(options: argparse.Namespace) -> None:
    """Check every input, then compute, show and write the parts that were asked for."""
    parts = [name for name in PARTS if getattr(options, name) is not None]
    if not parts and options.figures is None:
        parts, options.figures = list(PARTS), REPORT
        options.optimise = []
        options.json = options.json or REPORT / 'study.json'
    geometry = _geometry(options)
    study = Study(geometry, _requirements(options, geometry),
                  settings_from(DriveTrain, vars(options)))
    with ExitStack() as stack:
        draft = stack.enter_context(folder(options.figures)) if options.figures else None
        content = stack.enter_context(json_file(options.json)) if options.json else {}
        content['inputs'] = {**asdict(geometry), 'threshold': study.need.threshold,
                             'characteristic_length': study.need.characteristic_length}
        shown = console(120)
        for name in parts:
            key, data, table = PARTS[name](study, options)
            content[key] = data
            shown.print(table)
        if draft:
            _draw(draft, study)
    if options.figures:
        print(f'figures are in {options.figures}/')
    if options.json:
        print(f'numbers are in {options.json}')


def _draw(draft: Path, study: Study) -> None:
    from matplotlib import style

    from facade_manipulator.lab.study.drawing import STYLE
    from facade_manipulator.lab.study.figures import FIGURES

    with style.context(STYLE, after_reset=True), progress_bar('figures', len(FIGURES)) as tick:
        for name, draw in FIGURES.items():
            draw(study).savefig(draft / name)
            tick()


def _geometry(options: argparse.Namespace) -> Geometry:
    given = vars(options)
    if options.parameters is not None:
        if given.keys() & {'link_length', 'platform_half_length', 'stroke', *CARRIAGES}:
            raise ParameterError('--parameters has the lengths: --l, --b, --gap, '
                                 '--carriage-length and --stroke have no use')
        return read_settings([options.parameters], ALL_NODES, 'geometry', Geometry)
    if 'stroke' in given:
        given = given | {'stroke': _stroke(options.stroke)}
    return settings_from(Geometry, given, carriage_gap=0.0)


def _stroke(values: list[float]) -> tuple[float, ...]:
    """Return the stroke from its length, about zero, or from its two ends."""
    if len(values) > 2:
        raise ParameterError(f'--stroke has {len(values)} values: give its length, or both ends')
    if len(values) == 1 and not values[0] > 0.0:
        raise ParameterError(f'stroke = {values[0]:g} m is not a positive length')
    return (-0.5 * values[0], 0.5 * values[0]) if len(values) == 1 else tuple(values)


def _requirements(options: argparse.Namespace, geometry: Geometry) -> Requirements:
    given = vars(options)
    if options.optimise is None:
        return settings_from(Requirements, {name: given[name] for name in GOOD if name in given})
    return settings_from(Requirements, given | {
        'stroke_length': geometry.stroke_length, 'carriage_gap': geometry.carriage_gap})


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='workspace_study', epilog=EXAMPLES, description=(
            'Study of the design: where the head can go, how well, and which links are best.'),
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = parser.add_argument_group('what to study (everything, if none is given)')
    for name, part in PARTS.items():
        if name != 'optimise':
            parts.add_argument(f'--{name}', action='store_true', default=None, help=part.__doc__)
    parts.add_argument('--optimise', nargs='*', metavar='OBJECTIVE',
                       help=f'best l and b for {", ".join(OBJECTIVES)} (all, if none is named)')
    parts.add_argument('--figures', nargs='?', type=Path, const=REPORT, metavar='DIR',
                       help=f'draw the figures into DIR (default {REPORT}/)')
    parts.add_argument('--json', type=Path, metavar='FILE', help='write the numbers to FILE')
    design = parser.add_argument_group('the design')
    add_settings(design, Geometry, 'link_length', 'platform_half_length', 'carriage_length')
    add_settings(design, Requirements, 'carriage_gap', *GOOD)
    design.add_argument('--parameters', type=Path, metavar='YAML',
                        help='parameter file of a machine, for all of these lengths; --accuracy '
                             'goes by its errors too')
    design.add_argument('--stroke', type=float, nargs='+', metavar='M', default=argparse.SUPPRESS,
                        help='stroke of the carriages [m]: its length, or both ends (default 1; '
                             '--table2: 1.005)')
    design.add_argument('--y', type=float, nargs='+', action='extend',
                        help='distances from the rail for --ranges and --accuracy [m] '
                             '(default every 10 mm)')
    add_settings(parser.add_argument_group('what --accuracy assumes'), DriveTrain,
                 *parameter_fields(DriveTrain))
    add_settings(parser.add_argument_group('what --optimise requires'), Requirements,
                 'length_sum', 'link_range', 'platform_range', 'min_y_travel', 'min_theta',
                 'min_difference', 'designs', 'seed')
    work = parser.add_argument_group('how --optimise measures volumes and ratios')
    work.add_argument('--results', type=Path, metavar='FILE',
                      help='append each design measured to FILE, and measure none that it has')
    work.add_argument('--scheduler', metavar='ADDRESS',
                      help='of dask.distributed (default: one process for each processor)')
    return parser


if __name__ == '__main__':
    sys.exit(main())
