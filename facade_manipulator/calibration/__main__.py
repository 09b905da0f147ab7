"""Calibrate the machine: its geometry, the estimator's mounting, the place of the wall."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import csv
from pathlib import Path
import sys

import numpy as np

from facade_manipulator.calibration.arguments import parser
from facade_manipulator.calibration.design import Noise, plan
from facade_manipulator.calibration.estimator_fit import (
    EstimatorRecording,
    fit_estimator,
    report_estimator,
)
from facade_manipulator.calibration.findings import (
    check_accuracy,
    cross_check,
    draw_accuracy,
    report,
)
from facade_manipulator.calibration.geometry_fit import identify, Measurements, MOST_OUTLIERS
from facade_manipulator.calibration.recorded import (
    read_estimator_recording,
    read_touches,
)
from facade_manipulator.calibration.tables import parse_table, read_table
from facade_manipulator.calibration.unknowns import (
    BACKLASH,
    heads,
    screw_unknowns,
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
from facade_manipulator.errors import CalibrationError, exit_status, file_errors
from facade_manipulator.files import atomic_write
from facade_manipulator.kinematics import Geometry
from facade_manipulator.parameter_file import ALL_NODES, read_settings, write_parameters
from facade_manipulator.prediction import EstimateSettings
from facade_manipulator.resources import config_path

CARRIAGES, HEAD = ('q1', 'q2', 'q3'), ('x', 'y', 'theta')
COMPENSATOR, RECORDED = '/**/compensator', '.mcap'


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    options = parser(geometry=calibrate_geometry, estimator=calibrate_estimator,
                     wall=calibrate_wall).parse_args(arguments)
    return exit_status('calibrate', lambda: options.run(options))


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
        with file_errors(options.picture):
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
    found = fit_wall(points, Noise(position=options.noise * 1e-3).position, forces)
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
    with (file_errors(path), atomic_write(path) as draft,
          draft.open('w', newline='', encoding='utf-8') as file):
        rows = csv.writer(file)
        rows.writerow([*CARRIAGES, *directions, *(f'goal_{name}' for name in HEAD), *HEAD])
        for q, goal in zip(carriages, heads(geometry, carriages), strict=True):
            rows.writerow([f'{value:.6f}' for value in (*q, *goal)] + [''] * len(HEAD))
    print(f'{path} has {len(carriages)} poses; fill in x, y and theta, or what you measure')


if __name__ == '__main__':
    sys.exit(main())
