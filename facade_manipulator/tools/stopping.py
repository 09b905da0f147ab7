"""
Executable ``stopping``: compute the distances that remain between carriages after a failure.

The tool reads parameter files as the driver does.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from facade_manipulator.command_line import above_zero, exit_status
from facade_manipulator.control_loop.loop_channel import LoopSetup
from facade_manipulator.drives.stopping_distances import StoppingAnalysis
from facade_manipulator.kinematics.planar import MM
from facade_manipulator.package_files import machine_files
from facade_manipulator.parameters import ParameterSource
from facade_manipulator.tools.parameter_files import announce, read_machine

COASTING_DECELERATION = (
    1.87  # m/s²; 67 mm from 0.5 m/s, with friction and masses of the prototype
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return 1 if the driver would reject the parameters."""
    parser = argparse.ArgumentParser(
        prog='stopping', description='Print the distances that remain after a failure.'
    )
    parser.add_argument(
        'parameters',
        type=Path,
        nargs='*',
        help='parameter files; later files override earlier ones (default manipulator.yaml); a '
        'machine.yaml in the folder of the first file is loaded after this file',
    )
    parser.add_argument(
        '--coasting',
        type=above_zero,
        default=COASTING_DECELERATION,
        metavar='M/S^2',
        help='mean deceleration without power (default: %(default)s)',
    )
    given = parser.parse_args(arguments)

    def run() -> None:
        files = machine_files(given.parameters)
        announce('stopping', files)
        print_table(read_analysis(files), given.coasting)

    return exit_status('stopping', run)


def read_analysis(paths: Sequence[Path]) -> StoppingAnalysis:
    """Return the stopping analysis of parameter files; raises a ParameterError like the driver."""
    values = read_machine(paths, 'driver')
    return LoopSetup.read(ParameterSource(values)).stopping


def print_table(analysis: StoppingAnalysis, coasting: float) -> None:
    """Print the distances that remain after failures and stops; raises as the driver does."""
    print(f'{"when":38}{"minimum distance":>16}{"safe from gap":>15}')
    for name, distance, gap in analysis.outcomes:
        print(f'{name:38}{MM * distance:13.1f} mm{MM * gap:12.1f} mm')
    print(
        f'\nCarriages touch at {MM * analysis.geometry.carriage_length:.1f} mm. The maximum '
        f'overshoot beyond the stroke is {MM * analysis.overshoot:.1f} mm.\n\n'
        f'{"speed":>8}  {"from distance":>15}{"approach from":>16}'
        f'{"left by SS1-t":>16}{"left by STO":>14}'
    )
    for row in analysis.table(coasting):
        print(
            f'{row.speed:4.2f} m/s  {MM * row.alone:12.1f} mm{MM * row.approach:13.1f} mm'
            f'{MM * row.left_by_ss1_t:13.1f} mm{MM * row.left_by_sto:11.1f} mm'
        )
    print(f'SS1-t: STO follows {analysis.sto_delay:.2f} s after the quick-stop inputs')
    analysis.check()


if __name__ == '__main__':
    raise SystemExit(main())
