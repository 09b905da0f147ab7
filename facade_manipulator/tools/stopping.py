"""
What is left between the carriages when something fails, with the parameters of a file.

No node: it reads the files as the driver would, and prints.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from facade_manipulator.drives.cia402 import axis_defaults, AxisSettings
from facade_manipulator.drives.controller import ControllerSettings
from facade_manipulator.errors import exit_status
from facade_manipulator.kinematics import Geometry
from facade_manipulator.loop import Outcome, StoppingAnalysis
from facade_manipulator.motion import MotionLimits
from facade_manipulator.parameter_file import read_settings
from facade_manipulator.resources import config_path

MILLIMETRES = 1e3
SPEEDS = 5  # of the table


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the analysis; return 1 if the driver would not start with these parameters."""
    parser = argparse.ArgumentParser(prog='stopping', description=__doc__.split('\n\n')[0].strip())
    parser.add_argument(
        'parameters', type=Path, nargs='*',
        help='parameter files, of which later ones beat earlier ones; default: manipulator.yaml')
    files = parser.parse_args(arguments).parameters or [config_path('manipulator.yaml')]
    return exit_status('stopping', lambda: _say(files))


def _say(files: Sequence[Path]) -> None:
    geometry, analysis = read_analysis(files)
    for line in report(geometry, analysis):
        print(line)
    analysis.check()


def read_analysis(files: Sequence[Path]) -> tuple[Geometry, StoppingAnalysis]:
    """
    Return the mechanism and the analysis of parameter files.

    Raises
    ------
    ParameterError
        A file is no parameter file, or names what the driver does not know.

    """
    read = partial(read_settings, files, 'driver')
    geometry = read('geometry', Geometry)
    axes = tuple(read(name, AxisSettings, **defaults)
                 for name, defaults in axis_defaults(geometry.stroke).items())
    return geometry, StoppingAnalysis(
        geometry, read('limits', MotionLimits), axes, read('controller', ControllerSettings))


def report(geometry: Geometry, analysis: StoppingAnalysis) -> list[str]:
    """Return the analysis as lines."""
    gap, touching = (
        MILLIMETRES * value for value in (geometry.carriage_gap, geometry.carriage_length))
    beyond = MILLIMETRES * max(analysis.overshoots)
    heading = f'{"":38}{"distance [mm]":>14}{"up to [m/s]":>13}{"gap [mm]":>10}'
    fastest = analysis.limits.speed
    speeds = [fastest * (number + 1) / SPEEDS for number in range(SPEEDS)]
    distances = [MILLIMETRES * analysis.separation.distance(speed) for speed in speeds]
    return [
        f'Neighbours are commanded {gap:.1f} mm apart or more, and touch at {touching:.1f} mm.',
        'Their least distance at full speed, and up to which speed or with which carriage_gap',
        'they do not touch, where drives brake by themselves:',
        '', heading, *map(_row, analysis.outcomes),
        '', 'So that none meets a neighbour that stands dead, carriages are this fast only from',
        'this distance on:',
        '', f'  {"speed [m/s]":16}' + ''.join(f'{speed:8.2f}' for speed in speeds),
        f'  {"distance [mm]":16}' + ''.join(f'{distance:8.1f}' for distance in distances),
        '', f'Beyond the stroke a carriage stops at most {beyond:.1f} mm.']


def _row(outcome: Outcome) -> str:
    return (f'  {outcome.name:36}{MILLIMETRES * outcome.distance:14.1f}{outcome.speed:13.2f}'
            f'{MILLIMETRES * outcome.gap:10.1f}')


if __name__ == '__main__':
    raise SystemExit(main())
