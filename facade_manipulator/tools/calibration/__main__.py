"""Calibrate the machine: its geometry, its estimator's mounting or sensors, the wall's place."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import math
from pathlib import Path
import sys
from typing import Any

import numpy as np

from facade_manipulator.errors import (
    above_zero,
    CalibrationError,
    exit_status,
    file_errors,
    ParameterError,
)
from facade_manipulator.estimation.settings import EstimatorSetup
from facade_manipulator.kinematics import Geometry
from facade_manipulator.messages import CARRIAGES
from facade_manipulator.parameter_file import (
    ALL_NODES,
    read_parameters,
    read_settings,
    write_parameters,
)
from facade_manipulator.prediction.estimate import EstimateSettings
from facade_manipulator.resources import MACHINE_FILE, or_installed
from facade_manipulator.tools.calibration import estimator_fit, geometry_fit, sensor_fit, wall_fit
from facade_manipulator.tools.calibration.design import Noise, plan
from facade_manipulator.tools.calibration.plan_file import read_measured, write_plan
from facade_manipulator.tools.calibration.recorded import (
    HEAD_ON_WALL,
    is_recording,
    read_estimator_recording,
    read_sensors,
    read_touches,
)
from facade_manipulator.tools.calibration.tables import read_table
from facade_manipulator.tools.calibration.target import Points, Sought, Target
from facade_manipulator.tools.calibration.unknowns import (
    AXES,
    BACKLASH,
    INSTRUMENT,
    screw_unknowns,
    UNKNOWNS,
    unknowns_named,
    with_instrument,
    with_screw_tables,
)
from facade_manipulator.tools.commissioning.operator import Operator

COMMISSIONED = '.node_id', '.serial_number', '.direction', '.lead', '.profile'
COMPENSATOR, SENSORS = 'compensator', 'disturbance_estimator'
EXAMPLES = """
examples:
  calibrate geometry --plan poses.csv --frame
  calibrate measure poses.csv --frame --topic
  calibrate geometry poses.csv --frame --output machine.yaml --picture accuracy.png
  calibrate estimator rosbag2_2026_11_22-08_30_00 --output machine.yaml
  calibrate sensors rosbag2_2026_11_22-09_00_00 --output machine.yaml
  calibrate wall touches.csv
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    options = _parser().parse_args(arguments)
    return exit_status('calibrate', lambda: options.run(options))


def calibrate_geometry(options: argparse.Namespace) -> None:
    """Plan the poses, or find the errors of the machine from its head."""
    sought = _sought(options)
    geometry, unknowns, target, _, _ = sought
    noise = sought.noise
    if options.plan is not None:
        count = write_plan(options.plan, sought, plan(
            geometry, unknowns, options.count, noise, target.axes.tolist()))
        print(f'{options.plan} has {count} poses, the first once more at the end; calibrate '
              f'measure {options.plan}, or fill in {", ".join(target.columns)} by hand')
        return
    if options.measurements is None:
        raise CalibrationError('name a file of measurements, - to type them, or --plan a file')
    measurements = read_measured(options.measurements, sought)
    geometry = sought.machine(*measurements)
    found = geometry_fit.identify(geometry, unknowns, measurements, noise)
    geometry_fit.check_accuracy(found, measurements, noise)
    held_out = geometry_fit.cross_check(geometry, unknowns, measurements, noise)
    print(*geometry_fit.report_geometry(found, held_out), sep='\n')
    if empty := np.flatnonzero(np.isnan(measurements.heads).all(axis=1)).tolist():
        print(f'rows without a measurement: {", ".join(str(row + 1) for row in empty)}')
    _check_outliers(found.outliers, options)
    if options.picture is not None:
        with file_errors(options.picture):
            geometry_fit.draw_accuracy(options.picture, geometry, found)
    _write(options, (ALL_NODES, 'geometry', {
        unknown.field: getattr(found.geometry, unknown.field) for unknown in found.unknowns
        if unknown not in INSTRUMENT}))


def measure_geometry(options: argparse.Namespace) -> None:
    """Go to the poses of a plan and fill in what is measured there."""
    from facade_manipulator.tools.calibration.measure import run  # needs ROS, alone here

    if options.topic and options.points:
        raise CalibrationError('a topic has the pose of the head: leave out --points, or --topic')
    mm, deg = options.enough
    run(options.plan, _sought(options), np.array([1e-3 * mm, 1e-3 * mm, math.radians(deg)]),
        options.namespace, options.topic, Operator(options.yes))


def _sought(options: argparse.Namespace) -> Sought:
    target = Points([1e-3 * value for value in options.points]) if options.points else Target(
        [name for name in AXES if name in options.measure])
    geometry, unknowns = target.seen_on(_geometry(options)), unknowns_named(options.find)
    if options.backlash:
        unknowns += BACKLASH
    if options.screws is not None:
        geometry = with_screw_tables(geometry, options.screws)
        unknowns += screw_unknowns(geometry)
    if options.frame:
        geometry, unknowns = with_instrument(geometry, unknowns)
    return Sought(geometry, unknowns, target, _noise(*options.noise), options.frame)


def _noise(mm: float, deg: float = 0.02) -> Noise:
    """Return how well the head is measured, as given in mm and degrees."""
    try:
        return Noise(1e-3 * mm, math.radians(deg))
    except ParameterError as error:
        raise ParameterError(f'--noise: {error}') from error


def calibrate_estimator(options: argparse.Namespace) -> None:
    """Find mounting, delay and axes of the estimator from a recording."""
    found = estimator_fit.fit_estimator(
        _geometry(options),
        read_estimator_recording(options.recording, options.head, options.namespace),
        options.find, _estimate(options))
    print(*estimator_fit.report_estimator(found), sep='\n')
    _write(options, (COMPENSATOR, 'estimate', {
        name: getattr(found.settings, name) for name in ('mounting', 'axes', 'delay')}))


def calibrate_sensors(options: argparse.Namespace) -> None:
    """Find where the raw sensors are, how late and by which factor, from a recording."""
    setup = EstimatorSetup.of(read_parameters([options.parameters], SENSORS))
    found = sensor_fit.fit_sensors(
        setup, read_sensors(options.recording, setup, options.namespace), options.find)
    print(*sensor_fit.report_sensors(found), sep='\n')
    _write(options, *((SENSORS, name, values)
                      for name, values in sensor_fit.changed_parameters(found).items()))


def calibrate_wall(options: argparse.Namespace) -> None:
    """Find the wall from places where the head touched it."""
    estimate = _estimate(options)
    points, forces = _touches(options, _geometry(options), estimate)
    found = wall_fit.fit_wall(points, _noise(options.noise).position, forces)
    print(*wall_fit.report_wall(found), sep='\n')
    if not is_recording(options.touches) or len(
            found.outliers) > geometry_fit.MOST_OUTLIERS * len(found.residuals):
        _check_outliers(found.outliers, options)  # of a recording nobody has measured each
    aligned, _ = wall_fit.along_wall(estimate, found)
    _write(options, (COMPENSATOR, 'estimate', {
        'mounting': aligned.mounting, 'axes': aligned.axes}))


def _geometry(options: argparse.Namespace) -> Geometry:
    return read_settings([options.parameters], ALL_NODES, 'geometry', Geometry)


def _estimate(options: argparse.Namespace) -> EstimateSettings:
    return read_settings([options.parameters], COMPENSATOR, 'estimate', EstimateSettings)


def _write(options: argparse.Namespace, *found: tuple[str, str, dict[str, Any]]) -> None:
    """Write a copy of the parameter file with what was found, by node and section, if wanted."""
    if options.output is None:
        return
    source = options.parameters
    for other in filter(Path.exists, (options.output, MACHINE_FILE)):
        _require_same_drives(source, other)
    for node, section, values in found:
        write_parameters(source, options.output, node, {section: values})
        source = options.output
    print(f'{options.output} is written')


def _require_same_drives(source: Path, other: Path) -> None:
    """Raise a CalibrationError where commissioning found out what a copy would lose."""
    here, there = ({name: value for name, value in read_parameters([path], 'driver').items()
                    if name.endswith(COMMISSIONED)} for path in (source, other))
    if here != there:
        names = ', '.join(sorted(
            name for name in here | there if here.get(name) != there.get(name)))
        raise CalibrationError(
            f'{other} describes the drives otherwise than {source} ({names}): nothing is written; '
            f'calibrate with --parameters {other} --output {other}')


def _touches(
    options: argparse.Namespace, geometry: Geometry, estimate: EstimateSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Return where the head touched and with which force, from a recording or a table."""
    path = options.touches
    if is_recording(path):
        recorded = read_touches(path, estimate, options.namespace)
        points = wall_fit.touched_points(geometry, recorded.carriages, recorded.rails)
        means = wall_fit.mean_by_second(recorded.times, np.column_stack([points, recorded.forces]))
        return means[:, :2], means[:, 2]
    table = read_table(path, CARRIAGES, ('rail_x', 'rail_y', 'rail_theta', 'force'))
    return wall_fit.touched_points(geometry, table[:, :3], table[:, 3:6]), table[:, 6]


def _check_outliers(outliers: Sequence[Any], options: argparse.Namespace) -> None:
    if outliers and not options.drop_outliers:
        raise CalibrationError(
            'some measurements contradict the rest: measure them again, or leave them out with '
            '--drop-outliers; nothing is written')


def _parser() -> argparse.ArgumentParser:
    """Return the command line's parser; what it parses has its command's function as `run`."""
    made = argparse.ArgumentParser(
        prog='calibrate', description=__doc__, epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = made.add_subparsers(required=True, metavar='WHAT')
    for name, run, add, text in (
            ('geometry', calibrate_geometry, _add_geometry,
             'errors of the machine from measurements of its head'),
            ('measure', measure_geometry, _add_measure,
             'go to the poses of a plan, and fill in what is measured there'),
            ('estimator', calibrate_estimator, _add_estimator,
             'mounting, delay and axes of the estimator from a recording'),
            ('sensors', calibrate_sensors, _add_sensors,
             'places, delays and scales of the raw sensors from a recording'),
            ('wall', calibrate_wall, _add_wall,
             'the wall from places where the head touched it')):
        command = commands.add_parser(name, help=text)
        command.set_defaults(run=run)
        add(command)
        command.add_argument('--parameters', type=Path, metavar='YAML',
                             default=or_installed(MACHINE_FILE),
                             help='parameter file of the machine (default machine.yaml, or the '
                                  'installed one)')
        command.add_argument('--output', type=Path, metavar='YAML',
                             help='write a copy of it with what was found')
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
    _add_sought(command)
    _add_outliers(command)
    command.add_argument('--picture', type=Path, metavar='PNG',
                         help='draw how far the head was off and how well it is known')


def _add_measure(command: argparse.ArgumentParser) -> None:
    command.add_argument('plan', type=Path, help='what calibrate geometry --plan has written')
    command.add_argument('--topic', nargs='?', const=HEAD_ON_WALL, metavar='NAME',
                         help='PoseStamped of an instrument that publishes the head (default '
                              f'{HEAD_ON_WALL}); without it somebody types')
    command.add_argument('--enough', nargs=2, type=above_zero, default=(0.1, 0.02),
                         metavar=('MM', 'DEG'),
                         help='end when the head is known to so much all over the workspace '
                              '(default 0.1 0.02)')
    _add_namespace(command)
    command.add_argument('--yes', action='store_true', help='ask nothing before the head moves')
    _add_sought(command)


def _add_sought(command: argparse.ArgumentParser) -> None:
    command.add_argument('--measure', nargs='+', choices=AXES, default=AXES,
                         help='what is measured of the head (default all)')
    command.add_argument(
        '--find', nargs='+', default=(), metavar='NAME',
        help=f'what to look for (default all): {", ".join(u.name for u in UNKNOWNS)}')
    command.add_argument('--frame', action='store_true',
                         help="look for x, y and angle of the instrument's frame too: frame rail "
                              'is then where the carriages show it')
    command.add_argument('--backlash', action='store_true',
                         help='look for the backlash of the screws too; the poses to plan say in '
                              'which direction to arrive')
    command.add_argument('--screws', type=int, metavar='ENTRIES',
                         help='look for the errors of the screws too, a table of so many entries: '
                              '2 to 100')
    command.add_argument('--noise', nargs=2, type=float, default=(0.1, 0.02),
                         metavar=('MM', 'DEG'),
                         help='standard deviation of the measurements (default 0.1 0.02)')
    command.add_argument('--points', nargs='+', type=float, metavar='MM',
                         help='points on the head are measured instead of its pose: x and y of '
                              'two or three in the frame of the head; columns x1, y1, x2, y2')


def _add_estimator(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        'recording', type=Path,
        help='rosbag2 folder, .mcap or .db3 file, with the head measured on the wall or with '
             'lateral_offset')
    _add_namespace(command)
    command.add_argument('--head', default=HEAD_ON_WALL, metavar='TOPIC',
                         help=f'topic of the head on the wall (default {HEAD_ON_WALL})')
    command.add_argument(
        '--find', nargs='+', default=estimator_fit.DEFAULT, metavar='NAME',
        help=f'what to look for of {", ".join(estimator_fit.SOUGHT)} (default '
             f'{" ".join(estimator_fit.DEFAULT)}); the rest stays as it is. axes need a second '
             'measurement along the axes of facade')


def _add_sensors(command: argparse.ArgumentParser) -> None:
    command.add_argument('recording', type=Path,
                         help='rosbag2 folder, .mcap or .db3 file: two minutes of sway with '
                              'pushes')
    _add_namespace(command)
    command.add_argument('--find', nargs='+', default=sensor_fit.FIND, metavar='NAME',
                         help=f'what to look for (default {" ".join(sensor_fit.FIND)})')


def _add_wall(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        'touches', type=Path,
        help='rosbag2 folder, .mcap or .db3 file recorded while the head pressed; or CSV with '
             'q1, q2, q3 at each touch, and rail_x, rail_y, rail_theta, the pose of the rail in '
             'facade then, empty for a rail at rest, and the force in N')
    _add_namespace(command)
    command.add_argument('--noise', type=float, default=1.0, metavar='MM',
                         help='standard deviation of a touch (default 1)')
    _add_outliers(command)


def _add_namespace(command: argparse.ArgumentParser) -> None:
    command.add_argument('--namespace', default='', help='namespace of the nodes')


def _add_outliers(command: argparse.ArgumentParser) -> None:
    command.add_argument('--drop-outliers', action='store_true',
                         help='write although some measurements contradict the rest')


if __name__ == '__main__':
    sys.exit(main())
