"""The command line of `calibrate`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from facade_manipulator.calibration.estimator_fit import DEFAULT, SOUGHT
from facade_manipulator.calibration.recorded import HEAD_ON_WALL
from facade_manipulator.calibration.unknowns import AXES, UNKNOWNS

Run = Callable[[argparse.Namespace], None]
DESCRIPTION = (
    "Calibrate the machine: its geometry, the estimator's mounting, the place of the wall.")
EXAMPLES = """
examples:
  calibrate geometry --plan poses.csv
  calibrate geometry measured.csv --output calibrated.yaml --picture accuracy.png
  calibrate estimator blackbox_000007_20261122T083000Z.mcap --output calibrated.yaml
  calibrate estimator --disturbance disturbance.csv --joints joints.csv --wall wall.csv
  calibrate wall touches.csv
"""


def parser(**runs: Run) -> argparse.ArgumentParser:
    """Return the command line's parser; what it parses has its command's function as `run`."""
    made = argparse.ArgumentParser(
        prog='calibrate', description=DESCRIPTION, epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = made.add_subparsers(required=True, metavar='WHAT')
    for name, add, text in (
            ('geometry', _add_geometry, 'errors of the machine from measurements of its head'),
            ('estimator', _add_estimator,
             'mounting, delay and axes of the estimator from a recording'),
            ('wall', _add_wall, 'the wall from places where the head touched it')):
        command = commands.add_parser(name, help=text)
        command.set_defaults(run=runs[name])
        add(command)
    return made


def _add_geometry(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        'measurements', nargs='?', type=Path,
        help='CSV with q1, q2, q3 as commanded and x, y, theta of the head in frame rail, in m '
             'and rad or named with their unit (x_mm, theta_deg); cells may be empty; - reads '
             'what is typed')
    command.add_argument('--plan', type=Path, metavar='CSV',
                         help='write the poses that show most, and measure there')
    command.add_argument('--count', type=int, default=24, help='poses to plan (default 24)')
    command.add_argument('--measure', nargs='+', choices=AXES, default=AXES,
                         help='what will be measured at the poses to plan (default all)')
    command.add_argument(
        '--find', nargs='+', default=(), metavar='NAME',
        help=f'what to look for (default all): {", ".join(u.name for u in UNKNOWNS)}')
    command.add_argument('--backlash', action='store_true',
                         help='look for the backlash of the screws too; the poses to plan say in '
                              'which direction to arrive')
    command.add_argument('--screws', type=int, metavar='ENTRIES',
                         help='look for the errors of the screws too, a table of so many entries')
    command.add_argument('--noise', nargs=2, type=float, default=(0.1, 0.02),
                         metavar=('MM', 'DEG'),
                         help='standard deviation of the measurements (default 0.1 0.02)')
    _add_outliers(command)
    _add_files(command)
    command.add_argument('--picture', type=Path, metavar='PNG',
                         help='draw how far the head was off and how well it is known')


def _add_estimator(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        'recording', nargs='?', type=Path,
        help='file of the recorder, with the head as measured on the wall or with lateral_offset')
    command.add_argument('--head', default=HEAD_ON_WALL, metavar='TOPIC',
                         help=f'topic of the head on the wall (default {HEAD_ON_WALL})')
    command.add_argument(
        '--find', nargs='+', default=DEFAULT, metavar='NAME',
        help=f'what to look for of {", ".join(SOUGHT)} (default {" ".join(DEFAULT)}); the rest '
             'stays as it is. axes need a second measurement along the axes of facade')
    for name, text in (
            ('disturbance', 'time, x, y, theta as published; the time is that of the stamps'),
            ('joints', 'time, q1, q2, q3 of joint_states'),
            ('wall', 'time, x, y, theta of the head on the wall; cells may be empty')):
        command.add_argument(f'--{name}', type=Path, metavar='CSV', help=text)
    _add_files(command)


def _add_wall(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        'touches', type=Path,
        help='file of the recorder (.mcap) while the head pressed; or CSV with q1, q2, q3 at each '
             'touch, and rail_x, rail_y, rail_theta, the pose of the rail in facade then, empty '
             'for a rail at rest, and the force in N')
    command.add_argument('--align', action='store_true',
                         help='turn facade so that its x lies along the wall: writes yaw and axes '
                              'of the estimator too')
    command.add_argument('--noise', type=float, default=1.0, metavar='MM',
                         help='standard deviation of a touch (default 1)')
    _add_outliers(command)
    _add_files(command)


def _add_outliers(command: argparse.ArgumentParser) -> None:
    command.add_argument('--drop-outliers', action='store_true',
                         help='write although some measurements contradict the rest')


def _add_files(command: argparse.ArgumentParser) -> None:
    command.add_argument('--parameters', type=Path, metavar='YAML',
                         help='parameter file of the machine (default the installed one)')
    command.add_argument('--output', type=Path, metavar='YAML',
                         help='write a copy of it with what was found')
