"""Executable ``calibrate``: fit the machine's geometry, or an estimator's mounting and delay."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
import math
from pathlib import Path
import sys
from typing import Any

import numpy as np

from facade_manipulator.command_line import above_zero, exit_status
from facade_manipulator.kinematics import Geometry
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.package_files import machine_files
from facade_manipulator.parameters import ParameterSource
from facade_manipulator.prediction.estimate import EstimateSettings
from facade_manipulator.tools.calibration import estimator_fit, geometry_fit
from facade_manipulator.tools.calibration.csv_reader import read_table
from facade_manipulator.tools.calibration.geometry_fit import (
    HEAD_AXES,
    HEAD_UNITS,
    in_units,
)
from facade_manipulator.tools.calibration.recording import read_estimator_recording
from facade_manipulator.tools.parameter_files import announce, read_machine
from facade_manipulator.topics import HEAD_ON_WALL


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return its exit status."""
    options = _parser().parse_args(arguments)

    def run() -> None:
        options.parameters = machine_files(options.parameters)
        announce('calibrate', options.parameters)
        print(*options.run(options), sep='\n')

    return exit_status('calibrate', run)


def plan_poses(options: argparse.Namespace) -> Iterator[str]:
    """Yield a table of carriage positions to measure, with empty cells for the head poses."""
    drawing = _geometry(options)
    carriages = geometry_fit.spread_carriages(drawing, options.count)
    yield 'goal_x,goal_y,goal_qz,goal_qw,q1_mm,q2_mm,q3_mm,x_mm,y_mm,theta_deg'
    x, y, theta = geometry_fit.head_poses(drawing, carriages).T
    sine = np.sin(theta / 2)
    cosine = np.cos(theta / 2)
    for row in np.column_stack([x, y, sine, cosine, 1e3 * carriages]):
        yield ','.join(f'{value:.5f}' for value in row) + ',,,'


def calibrate_geometry(options: argparse.Namespace) -> Iterator[str]:
    """Yield the geometric errors of the machine, then lines for the parameter file."""
    drawing = _geometry(options)
    table = read_table(options.table, AXIS_NAMES, HEAD_AXES)
    measurements = geometry_fit.Measurements(table[:, :3], table[:, 3:])
    noise = np.take(options.noise, [0, 0, 1]) * [1e-3, 1e-3, math.radians(1.0)]
    found = geometry_fit.fit_geometry(drawing, measurements, noise, options.frame)

    for k, value, deviation in zip(
        found.sought, found.values, found.deviations, strict=True
    ):
        name, _, unit = geometry_fit.GEOMETRY_ERRORS[k]
        yield _line(name, value, deviation, unit)
    for combination in found.unidentified:
        yield f'The poses do not determine {combination}.'
    for row in np.flatnonzero(found.outliers):
        yield (
            f'Row {row + 1} contradicts the others ({in_units(found.residuals[row])}) and is '
            'left out; next: measure it again.'
        )
    yield f'The rows scatter by {found.scatter:.2f} times the stated noise.'
    yield f'The maximum standard deviation of the head is {in_units(found.head_deviation)}.'

    errors = geometry_fit.held_out_errors(drawing, measurements, noise, found)
    before, after = map(in_units, errors)
    yield (
        f'The rows left out of the fit have an RMS error of {before} before the fit, '
        f'and of {after} after it.'
    )

    values = {name: getattr(found.geometry, name) for name in geometry_fit.FIELDS}
    yield from _parameters('/**', 'geometry', values)


def calibrate_estimator(options: argparse.Namespace) -> Iterator[str]:
    """Yield mounting and delay of the estimator, then lines for the parameter file."""
    recording = read_estimator_recording(
        options.recording, options.head, options.namespace
    )
    source = _source(options)
    machine = source.read(Geometry, 'geometry')
    present = source.read(EstimateSettings, 'estimate')
    found = estimator_fit.fit_estimator(machine, recording, present)

    mounting = found.settings.mounting
    delay = found.settings.delay
    for name, value, deviation, unit in zip(
        estimator_fit.SOUGHT,
        (*mounting, delay),
        found.deviations,
        (*HEAD_UNITS, ('ms', 1e3)),
        strict=True,
    ):
        yield _line(name, value, deviation, unit)
    yield (
        f'The stamps of the instrument are {1e3 * found.late:+.1f} ms late; '
        f'{in_units(found.residual)} remain.'
    )
    values = {'mounting': mounting, 'delay': delay}
    yield from _parameters('/**/compensator', 'estimate', values)


def _source(options: argparse.Namespace) -> ParameterSource:
    return ParameterSource(read_machine(options.parameters, 'compensator'))


def _geometry(options: argparse.Namespace) -> Geometry:
    return _source(options).read(Geometry, 'geometry')


def _line(name: str, value: float, deviation: float, unit: tuple[str, float]) -> str:
    symbol, factor = unit
    return f'{name:43s} {value * factor:+9.3f} +- {deviation * factor:.3f} {symbol}'


def _parameters(section: str, group: str, values: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of a parameter file."""
    yield f'\nLines for the parameter file:\n{section}:\n  ros__parameters:\n    {group}:'
    for name, value in values.items():
        yield f'      {name}: {np.round(value, 7).tolist()}'  # to 0.1 um and 0.1 urad


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='calibrate', description=__doc__)
    files = argparse.ArgumentParser(add_help=False)
    files.add_argument(
        '--parameters',
        nargs='+',
        type=Path,
        metavar='YAML',
        default=[],
        help='parameter files; later files override earlier ones (default manipulator.yaml); a '
        'machine.yaml in the folder of the first file is loaded after this file',
    )
    commands = parser.add_subparsers(required=True, metavar='COMMAND')

    poses = commands.add_parser(
        'poses', parents=[files], help='print poses to measure at, as a CSV table'
    )
    poses.set_defaults(run=plan_poses)
    poses.add_argument(
        '--count',
        type=int,
        default=20,
        choices=range(4, 201),
        metavar='N',
        help='number of poses, from 4 to 200 (default 20)',
    )

    errors = commands.add_parser(
        'geometry', parents=[files], help='find the errors of the machine from a table'
    )
    errors.set_defaults(run=calibrate_geometry)
    errors.add_argument(
        'table',
        type=Path,
        help='CSV with columns q1, q2, q3 and x, y, theta of '
        'the head, with units in their names: q1_mm, theta_deg',
    )
    errors.add_argument(
        '--noise',
        nargs=2,
        type=above_zero,
        default=(0.1, 0.02),
        metavar=('MM', 'DEG'),
        help='standard deviation (default 0.1 0.02)',
    )
    errors.add_argument(
        '--frame', action='store_true', help="find the instrument's frame too"
    )

    mounting = commands.add_parser(
        'estimator', parents=[files], help='find mounting and delay from a recording'
    )
    mounting.set_defaults(run=calibrate_estimator)
    mounting.add_argument(
        'recording', type=Path, help='rosbag2 folder, .mcap or .db3 file'
    )
    mounting.add_argument(
        '--head',
        default=HEAD_ON_WALL.name,
        metavar='TOPIC',
        help=f'pose of the head on the wall (default {HEAD_ON_WALL.name})',
    )
    mounting.add_argument('--namespace', default='', help='namespace of the nodes')
    return parser


if __name__ == '__main__':
    sys.exit(main())
