"""
Reproduction of the paper: the workspace, its conditioning, and the best link lengths.

Run it as ``workspace_study`` or ``python -m facade_manipulator.study``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict
import json
import math
import os
from pathlib import Path
import sys
from typing import Any

from rich.console import Console

from facade_manipulator.command_line import above_zero, exit_status
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.package_files import atomic_write
from facade_manipulator.study.optimum import OBJECTIVES, SWEEP_STEP
from facade_manipulator.study.paper import design, LENGTH_SUM, STROKE_LENGTH
from facade_manipulator.study.paper_tables import PARTS, progress, Study
from facade_manipulator.study.workspace_metrics import Good

REPORT = Path('workspace_report')


BAD_INPUT = 2


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; return the exit status."""
    options = _parser().parse_args(argv)
    return exit_status(
        'workspace_study',
        lambda: _run(options),
        BAD_INPUT,
        'interrupted, no numbers were written; next: start the study again',
    )


NO_FILE = Path(os.devnull)
WIDTH = 120  # columns of a table if the output is not a terminal


def _run(options: argparse.Namespace) -> None:
    """Check the options; compute, print and write the selected parts."""
    parts = [name for name in PARTS if getattr(options, name) is not None]
    if not parts and options.figures is None:
        parts = list(PARTS)
        options.figures = REPORT
        options.optimise = []
        options.json = options.json or REPORT / 'study.json'

    geometry = design(options.l, options.b, options.stroke, options.gap)
    good = Good(options.threshold, options.characteristic_length)
    study = Study(geometry, good)
    if options.figures:
        options.figures.mkdir(parents=True, exist_ok=True)
    content: dict[str, Any] = {'inputs': asdict(geometry) | good._asdict()}
    if options.json and options.json.is_dir():
        raise IsADirectoryError(f'{options.json} is a directory')

    file = atomic_write(options.json) if options.json else nullcontext(NO_FILE)
    with file as draft:
        draft.touch()  # a file that cannot be written is rejected before the computation
        console = Console(width=None if sys.stdout.isatty() else WIDTH)
        for name in parts:
            key, content[key], table = PARTS[name](study, options)
            console.print(table)
        if options.figures:
            _draw(options.figures, study)
        text = json.dumps(_without_nan(content), indent=2, allow_nan=False)
        draft.write_text(text + '\n', 'utf-8')
    if options.json:
        print(f'numbers written to {options.json}')


def _without_nan(value: Any) -> Any:
    """Return a value for JSON, which has no NaN: a share of an empty workspace becomes null."""
    if isinstance(value, dict):
        return {key: _without_nan(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_nan(inner) for inner in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def _draw(folder: Path, study: Study) -> None:
    """Draw the figures; name each figure that the design does not have, with the cause."""
    from matplotlib import style

    from facade_manipulator.study.drawing import STYLE
    from facade_manipulator.study.figures import FIGURES

    left_out = []
    with style.context(STYLE, after_reset=True):
        for name, draw in progress(FIGURES.items(), len(FIGURES), 'figures'):
            try:
                with atomic_write(folder / name) as draft:
                    draw(study).savefig(draft, format='png')
            except ManipulatorError as error:
                left_out.append(f'workspace_study: {name} is left out: {error}')
    print(*left_out, sep='\n', end='\n' if left_out else '', file=sys.stderr)
    print(f'figures written to {folder}/')


LENGTH_OPTIONS = {
    'l': (Geometry.link_length, 'length of the links'),
    'b': (Geometry.platform_half_length, 'half the length of the platform'),
    'stroke': (STROKE_LENGTH, 'length of the stroke Q'),
    'gap': (0.0, 'minimum distance of neighbouring carriages'),
}
EXAMPLES = """
examples:
  workspace_study                          everything, into workspace_report/
  workspace_study --table2                 Table 2 beside the numbers of the paper
  workspace_study --summary --gap 0.02     the workspace with 20 mm between carriages
  workspace_study --optimise --sum 0 --scheduler tcp://HOST:8786
                                           best in the whole box of Table 1, on a cluster

Lengths are in m and angles in rad. Wrong input ends with exit status 2.
"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='workspace_study',
        description='Reproduce the tables and figures of the paper.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parts = parser.add_argument_group('parts (default: all)')
    for name, part in PARTS.items():
        if name != 'optimise':
            parts.add_argument(
                f'--{name}', action='store_true', default=None, help=part.__doc__
            )
    parts.add_argument(
        '--optimise',
        nargs='*',
        choices=OBJECTIVES,
        metavar='OBJECTIVE',
        help=f'print the best l and b for {", ".join(OBJECTIVES)} (default all)',
    )
    parts.add_argument(
        '--figures',
        nargs='?',
        type=Path,
        const=REPORT,
        metavar='DIR',
        help=f'draw the figures into DIR (default {REPORT}/)',
    )
    parts.add_argument(
        '--json', type=Path, metavar='FILE', help='write the numbers to FILE'
    )
    lengths = parser.add_argument_group('the design and its good poses')
    for name, (default, words) in LENGTH_OPTIONS.items():
        lengths.add_argument(
            f'--{name}',
            type=float,
            default=default,
            metavar='M',
            help=f'{words} (default {default:g}) [m]',
        )
    lengths.add_argument(
        '--y',
        type=float,
        nargs='+',
        action='extend',
        metavar='M',
        help='distances from the rail for --ranges (default every 10 mm) [m]',
    )
    lengths.add_argument(
        '--threshold',
        type=above_zero,
        default=Good().threshold,
        metavar='INDEX',
        help='minimum conditioning index (default %(default)g)',
    )
    lengths.add_argument(
        '--characteristic-length',
        type=above_zero,
        metavar='M',
        default=Good().characteristic_length,
        help='unit of length of the index: 0.001 in the '
        'paper, 1 shows weak poses near the rail (default %(default)g) [m]',
    )
    search = parser.add_argument_group('the sweep of --optimise')
    search.add_argument(
        '--sum',
        type=float,
        default=LENGTH_SUM,
        metavar='M',
        help=('l + b; 0 sweeps the whole box of Table 1 (default %(default)g) [m]'),
    )
    search.add_argument(
        '--step',
        type=above_zero,
        default=SWEEP_STEP,
        metavar='M',
        help='step of l and b (default %(default)g) [m]',
    )
    search.add_argument(
        '--scheduler',
        metavar='ADDRESS',
        help=(
            'scheduler of dask.distributed (default: one process for each processor)'
        ),
    )
    return parser


if __name__ == '__main__':
    sys.exit(main())
