"""
What is left between the carriages when something fails, with the parameters of a file.

No node: it reads the files as the driver would, and prints.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from facade_manipulator.control_loop.stopping_analysis import Outcome, StoppingAnalysis
from facade_manipulator.drives.axis_settings import axis_defaults, AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.errors import exit_status
from facade_manipulator.kinematics import Geometry, inverse_kinematics, Pose
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.parameters import read_parameters, settings_from
from facade_manipulator.resources import config_path
from facade_manipulator.tools.emergency_stop import (
    COASTING,
    emergency_stops,
    EmergencyStop,
    HEADS,
    LOADS,
    matrix,
    sampled_gaps,
    SAMPLES,
    sto_delay,
    TAIL,
)

MILLIMETRES = 1e3
SPEEDS = 5  # of the table


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the analysis; return 1 if the driver would not start with these parameters."""
    parser = argparse.ArgumentParser(
        prog='stopping', description='Print the gaps that are left between the carriages when '
        'something fails, with the parameters of a file.')
    parser.add_argument(
        'parameters', type=Path, nargs='*',
        help='parameter files, of which later ones beat earlier ones; default: manipulator.yaml')
    parser.add_argument(
        '--coasting', type=float, default=COASTING,
        help='mean deceleration without power in m/s^2, as measured (default: %(default)s)')
    given = parser.parse_args(arguments)
    files = given.parameters or [config_path('manipulator.yaml')]
    return exit_status('stopping', lambda: _say(files, given.coasting))


def _say(files: Sequence[Path], coasting: float) -> None:
    analysis = read_driver(files)
    print(*report(analysis), *emergency_report(analysis, emergency_stops(analysis, coasting)),
          sep='\n')
    analysis.check()


def read_driver(paths: Sequence[Path]) -> StoppingAnalysis:
    """Return the stopping analysis of the driver; raises a ParameterError for a wrong file."""
    values = read_parameters(paths, 'driver')
    geometry = settings_from(Geometry, values, 'geometry')
    axes = tuple(settings_from(AxisSettings, values, name, **defaults)
                 for name, defaults in axis_defaults(geometry.stroke).items())
    return StoppingAnalysis(geometry, settings_from(MotionLimits, values, 'limits'), axes,
                            settings_from(ControllerSettings, values, 'controller'))


def report(analysis: StoppingAnalysis) -> list[str]:
    """Return the analysis as lines."""
    gap = MILLIMETRES * analysis.geometry.carriage_gap
    touching = MILLIMETRES * analysis.geometry.carriage_length
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


def emergency_report(analysis: StoppingAnalysis, stops: Sequence[EmergencyStop]) -> list[str]:
    """Return what is left as sampled, and how the emergency stop ends, as lines."""
    sampled = [(stop.name, sampled_gaps(analysis, stop)) for stop in stops]
    lag = analysis.controller.drive_lag
    return [
        '', f'Left between them, of {SAMPLES} samples of speeds, lag up to {MILLIMETRES * lag:g} '
        'ms, delay and', 'deceleration; below 0 they touch:', '',
        f'  {"":36}{"99.9 % [mm]":>14}{"worst [mm]":>13}',
        *(f'  {name:36}{MILLIMETRES * np.percentile(gaps, TAIL):14.1f}'
          f'{MILLIMETRES * gaps.min():13.1f}' for name, gaps in sampled),
        '', f'SS1-t: STO follows {sto_delay(analysis):.2f} s after the quick-stop inputs.',
        *(line for stop in stops[2:] for line in _matrix(analysis, stop))]


def _matrix(analysis: StoppingAnalysis, stop: EmergencyStop) -> list[str]:
    def distance_of(head: float) -> float:
        q1, q2, q3 = inverse_kinematics(analysis.geometry, Pose(0.0, head, 0.0))
        return min(q3 - q1, q2 - q3)

    rows = matrix(analysis, stop, distance_of)
    columns = ''.join(f'{f"{head:g}, {load:g}":>12}' for head in HEADS for load in LOADS)
    return [
        '', f'{stop.name}: least gap [mm] of two that run towards each other,',
        'by y of the head [m] and share of the deceleration that the load leaves:', '',
        f'  {"speed [m/s]":12}{columns}',
        *(f'  {speed:<12.2f}' + ''.join(f'{MILLIMETRES * one:12.1f}' for one in left)
          for speed, left in rows)]


def _row(outcome: Outcome) -> str:
    return (f'  {outcome.name:36}{MILLIMETRES * outcome.distance:14.1f}{outcome.speed:13.2f}'
            f'{MILLIMETRES * outcome.gap:10.1f}')


if __name__ == '__main__':
    raise SystemExit(main())
