"""Calibrate the machine: its geometry, the estimator's mounting, the place of the wall."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import csv
from pathlib import Path
import sys

import numpy as np

from facade_manipulator.calibration.design import Noise, plan
from facade_manipulator.calibration.estimator_fit import (
    DEFAULT,
    EstimatorRecording,
    fit_estimator,
    report_estimator,
    SOUGHT,
)
from facade_manipulator.calibration.findings import (
    check_accuracy,
    cross_check,
    draw_accuracy,
    report,
)
from facade_manipulator.calibration.geometry_fit import identify, Measurements, MOST_OUTLIERS
from facade_manipulator.calibration.recorded import (
    HEAD_ON_WALL,
    read_estimator_recording,
    read_touches,
)
from facade_manipulator.calibration.tables import parse_table, read_table
from facade_manipulator.calibration.unknowns import (
    BACKLASH,
    heads,
    screw_unknowns,
    UNKNOWNS,
    unknowns_named,
    with_screw_tables,
)
from facade_manipulator.calibration.wall_fit import (
    along_wall,
    fit_wall,
    mean_by_second,
    report_wall,
    touched_points,
)
from facade_manipulator.errors import CalibrationError, ManipulatorError, missing_package
from facade_manipulator.files import atomic_write
from facade_manipulator.kinematics import Geometry
from facade_manipulator.parameter_file import ALL_NODES, read_settings, write_parameters
from facade_manipulator.prediction import EstimateSettings
from facade_manipulator.resources import config_path

CARRIAGES, HEAD = ('q1', 'q2', 'q3'), ('x', 'y', 'theta')
COMPENSATOR, RECORDED = '/**/compensator', '.mcap'
EXAMPLES = """
examples:
  calibrate geometry --plan poses.csv
  calibrate geometry measured.csv --output calibrated.yaml --picture accuracy.png
  calibrate estimator blackbox_000007_20261122T083000Z.mcap --output calibrated.yaml
  calibrate estimator --disturbance disturbance.csv --joints joints.csv --wall wall.csv
  calibrate wall touches.csv
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    options = _parser().parse_args(arguments)
    try:
        options.run(options)
    except (ManipulatorError, FileNotFoundError) as error:
        print(f'calibrate: {error}', file=sys.stderr)
        return 1
    except ModuleNotFoundError as error:
        print(f'calibrate: {missing_package(error)}', file=sys.stderr)
        return 1
    return 0


def calibrate_geometry(options: argparse.Namespace) -> None:
    """Plan the poses, or find the errors of the machine from its head."""
    source = options.parameters or config_path('manipulator.yaml')
    geometry, unknowns = _geometry(source), unknowns_named(options.find)
    if options.backlash:
        unknowns += BACKLASH
    if options.screws is not None:
        geometry = with_screw_tables(geometry, options.screws)
        unknowns += screw_unknowns(geometry)
    noise = Noise(position=options.noise[0] * 1e-3, angle=np.deg2rad(options.noise[1]))
    if options.plan is not None:
        measured = [name in options.measure for name in HEAD]
        _write_plan(options.plan, geometry, plan(
            geometry, unknowns, options.count, noise, measured))
        return
    measurements = _measurements(options.measurements)
    found = identify(geometry, unknowns, measurements, noise)
    check_accuracy(found, unknowns, measurements, noise)
    for line in report(found, unknowns, cross_check(geometry, unknowns, measurements, noise)):
        print(line)
    _check_outliers(found.outliers, options)
    if options.picture is not None:
        with _writing(options.picture):
            draw_accuracy(options.picture, geometry, found, unknowns)
    if options.output is not None:
        fields = dict.fromkeys(unknown.field for unknown in unknowns)
        write_parameters(source, options.output, ALL_NODES, {
            'geometry': {name: getattr(found.geometry, name) for name in fields}})
        print(f'{options.output} is written')


def calibrate_estimator(options: argparse.Namespace) -> None:
    """Find mounting, delay and axes of the estimator from a recording."""
    source = options.parameters or config_path('manipulator.yaml')
    found = fit_estimator(
        _geometry(source), _estimator_recording(options), options.find,
        read_settings(source, COMPENSATOR, 'estimate', EstimateSettings))
    for line in report_estimator(found):
        print(line)
    if options.output is not None:
        write_parameters(source, options.output, COMPENSATOR, {'estimate': {
            name: getattr(found.settings, name) for name in ('mounting', 'axes', 'delay')}})
        print(f'{options.output} is written')


def calibrate_wall(options: argparse.Namespace) -> None:
    """Find the wall from places where the head touched it."""
    source = options.parameters or config_path('manipulator.yaml')
    estimate = read_settings(source, COMPENSATOR, 'estimate', EstimateSettings)
    points, forces = _touches(options.touches, _geometry(source), estimate)
    found = fit_wall(points, options.noise * 1e-3, forces)
    for line in report_wall(found):
        print(line)
    if options.touches.suffix != RECORDED or len(
            found.outliers) > MOST_OUTLIERS * len(found.residuals):
        _check_outliers(found.outliers, options)  # of a recording nobody has measured each
    if options.output is not None:
        distance = found.distance
        if options.align:
            estimate, distance = along_wall(estimate, found)
        write_parameters(source, options.output, '/**/ik_service', {
            'linkage': {'wall_distance': distance}})
        if options.align:
            write_parameters(options.output, options.output, COMPENSATOR, {'estimate': {
                'mounting': estimate.mounting, 'axes': estimate.axes}})
        print(f'{options.output} is written')


def _touches(
    path: Path, geometry: Geometry, estimate: EstimateSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Return where the head touched and with which force, from a recording or a table."""
    if path.suffix == RECORDED:
        recorded = read_touches(path, estimate)
        points = touched_points(geometry, recorded.carriages, recorded.rails)
        means = mean_by_second(recorded.times, np.column_stack([points, recorded.forces]))
        return means[:, :2], means[:, 2]
    table = read_table(path, CARRIAGES, ('rail_x', 'rail_y', 'rail_theta', 'force'))
    return touched_points(geometry, table[:, :3], table[:, 3:6]), table[:, 6]


def _geometry(source: Path) -> Geometry:
    return read_settings(source, ALL_NODES, 'geometry', Geometry)


def _estimator_recording(options: argparse.Namespace) -> EstimatorRecording:
    tables = options.disturbance, options.joints, options.wall
    if options.recording is not None and not any(tables):
        return read_estimator_recording(options.recording, options.head)
    if options.recording is not None or not all(tables):
        raise CalibrationError(
            'name a file of the recorder, or three tables with --disturbance, --joints and --wall')
    return EstimatorRecording(
        read_table(options.disturbance, ('time', *HEAD)),
        read_table(options.joints, ('time', *CARRIAGES)),
        read_table(options.wall, ('time',), HEAD))


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as error:  # matplotlib's of a file name without a known ending
        raise CalibrationError(
            f'{path} cannot be written: {getattr(error, "strerror", None) or error}') from error


def _check_outliers(outliers: Sequence, options: argparse.Namespace) -> None:
    if outliers and not options.drop_outliers:
        raise CalibrationError(
            'some measurements contradict the rest: measure them again, or leave them out with '
            '--drop-outliers; nothing is written')


def _measurements(path: Path | None) -> Measurements:
    if path is None:
        raise CalibrationError('name a file of measurements, - to type them, or --plan a file')
    optional = (*HEAD, 'direction')
    if str(path) == '-':
        table = parse_table('the table typed', sys.stdin, CARRIAGES, optional)
    else:
        table = read_table(path, CARRIAGES, optional)
    directions = np.nan_to_num(table[:, 6:])
    wrong = np.flatnonzero(~np.isin(directions, (-1.0, 0.0, 1.0)))
    if len(wrong):
        raise CalibrationError(
            f'row {wrong[0] + 1}: direction = {directions[wrong[0], 0]:g} is none of 1, -1 and 0')
    return Measurements(np.hstack([table[:, :3], directions]), table[:, 3:6])


def _write_plan(path: Path, geometry, carriages: np.ndarray) -> None:
    """Write where to measure, with empty cells for what is measured."""
    directions = ['direction'] * (carriages.shape[1] - len(CARRIAGES))
    with (_writing(path), atomic_write(path) as draft,
          draft.open('w', newline='', encoding='utf-8') as file):
        rows = csv.writer(file)
        rows.writerow([*CARRIAGES, *directions, *(f'goal_{name}' for name in HEAD), *HEAD])
        for q, goal in zip(carriages, heads(geometry, carriages), strict=True):
            rows.writerow([f'{value:.6f}' for value in (*q, *goal)] + [''] * len(HEAD))
    print(f'{path} has {len(carriages)} poses; fill in x, y and theta, or what you measure')


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='calibrate', description=__doc__, epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True, metavar='WHAT')
    _add_geometry(commands)
    _add_estimator(commands)
    _add_wall(commands)
    return parser


def _add_geometry(commands: argparse._SubParsersAction) -> None:
    command = commands.add_parser(
        'geometry', help='errors of the machine from measurements of its head')
    command.set_defaults(run=calibrate_geometry)
    command.add_argument(
        'measurements', nargs='?', type=Path,
        help='CSV with q1, q2, q3 as commanded and x, y, theta of the head in frame rail, in m '
             'and rad or named with their unit (x_mm, theta_deg); cells may be empty; - reads '
             'what is typed')
    command.add_argument('--plan', type=Path, metavar='CSV',
                         help='write the poses that show most, and measure there')
    command.add_argument('--count', type=int, default=24, help='poses to plan (default 24)')
    command.add_argument('--measure', nargs='+', choices=HEAD, default=HEAD,
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


def _add_estimator(commands: argparse._SubParsersAction) -> None:
    command = commands.add_parser(
        'estimator', help='mounting, delay and axes of the estimator from a recording')
    command.set_defaults(run=calibrate_estimator)
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


def _add_wall(commands: argparse._SubParsersAction) -> None:
    command = commands.add_parser('wall', help='the wall from places where the head touched it')
    command.set_defaults(run=calibrate_wall)
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


if __name__ == '__main__':
    sys.exit(main())
