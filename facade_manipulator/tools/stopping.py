"""
Executable ``stopping``: compute the distances left between carriages after a failure.

The tool reads parameter files as the driver does. Without power (STO, stop category 0) carriages
coast. With SS1-t (stop category 1) all drives brake by their quick-stop inputs before they lose
power.

References
----------
IEC 60204-1 (stop categories), IEC 61800-5-2 (STO, SS1-t).

"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
import math
from pathlib import Path

from facade_manipulator.commands import above_zero, exit_status
from facade_manipulator.drives.axis_settings import read_axes
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.stopping import StoppingAnalysis
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.braking import starting_distance
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.parameters import settings_from
from facade_manipulator.resources import machine_files
from facade_manipulator.tools.parameter_files import announce, read_machine

COASTING = 1.87  # m/s²: 67 mm from 0.5 m/s, by friction and masses of the prototype
SCATTER = 0.2  # share of the coasting deceleration, up or down: friction varies along the rail
LOAD = (
    0.7  # deceleration with the heaviest load, as a share of that of an empty machine
)
INPUT_SPREAD = 0.005  # s, maximum time between the quick-stop inputs of three drives
RELAY_SPREAD = 0.01  # s, maximum time between their STO inputs
SPEEDS = 5  # number of speeds in the table
_MM = 1e3


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return 1 if the driver would reject these parameters."""
    parser = argparse.ArgumentParser(
        prog='stopping', description='Print the distances that remain after a failure.'
    )
    parser.add_argument(
        'parameters',
        type=Path,
        nargs='*',
        help='parameter files, later files override (default manipulator.yaml); machine.yaml '
        'beside the first file follows it',
    )
    parser.add_argument(
        '--coasting',
        type=above_zero,
        default=COASTING,
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
    geometry = settings_from(Geometry, values, 'geometry')
    axes = read_axes(partial(settings_from, values=values), geometry.stroke)
    return StoppingAnalysis(
        geometry,
        settings_from(MotionLimits, values, 'limits'),
        axes,
        settings_from(ControllerSettings, values, 'controller'),
    )


def remaining(
    analysis: StoppingAnalysis, speed: float, spread: float, deceleration: float
) -> float:
    """
    Return the remaining distance of two carriages that approach each other and stop [m].

    They start at the minimum distance that the driver allows at the speed [m/s]. They brake
    with a deceleration [m/s²] after the lag of the drives and the spread of their inputs [s].
    """
    geometry, delay = analysis.geometry, analysis.controller.drive_lag + spread
    start = max(
        analysis.separation.distance(speed),
        starting_distance(geometry.carriage_gap, analysis.limits, speed, -speed),
    )
    return (
        start - geometry.carriage_length - speed * (2.0 * delay + speed / deceleration)
    )


def print_table(analysis: StoppingAnalysis, coasting: float) -> None:
    """Print the distances after failures and stops; raises the ParameterErrors of the driver."""
    print(f'{"when":38}{"minimum distance":>16}{"safe from gap":>15}')
    for name, distance, gap in analysis.outcomes:
        print(f'{name:38}{_MM * distance:13.1f} mm{_MM * gap:12.1f} mm')
    print(
        f'\nCarriages touch at {_MM * analysis.geometry.carriage_length:.1f} mm. The maximum '
        f'overshoot beyond the stroke is {_MM * analysis.overshoot:.1f} mm.\n\n'
        f'{"speed":>8}  {"from distance":>15}{"left by SS1-t":>16}{"left by STO":>14}'
    )
    stops = (
        (INPUT_SPREAD, LOAD * analysis.separation.deceleration),
        (RELAY_SPREAD, (1.0 - SCATTER) * coasting),
    )
    for number in range(1, SPEEDS + 1):
        speed = analysis.limits.speed * number / SPEEDS
        left = [_MM * remaining(analysis, speed, *stop) for stop in stops]
        print(
            f'{speed:4.2f} m/s  {_MM * analysis.separation.distance(speed):12.1f} mm'
            f'{left[0]:13.1f} mm{left[1]:11.1f} mm'
        )
    print(f'SS1-t: STO follows {sto_delay(analysis):.2f} s after the quick-stop inputs')
    analysis.check()


def sto_delay(analysis: StoppingAnalysis) -> float:
    """Return the time from quick-stop inputs to STO [s]: all at rest with the heaviest load."""
    slowest = analysis.limits.speed / (LOAD * analysis.separation.deceleration)
    return (
        math.ceil(100.0 * (slowest + analysis.controller.drive_lag + INPUT_SPREAD))
        / 100.0
    )


if __name__ == '__main__':
    raise SystemExit(main())
