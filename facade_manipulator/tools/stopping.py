"""
What is left between the carriages when something fails, with the parameters of a file.

No node: it reads the file as the driver would, without a namespace, and prints.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from facade_manipulator.drives.cia402 import axis_defaults, AxisSettings
from facade_manipulator.drives.controller import ControllerSettings
from facade_manipulator.errors import exit_status, ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.loop import Outcome, StoppingAnalysis
from facade_manipulator.motion import MotionLimits
from facade_manipulator.parameters import given_parameters, parameter_fields, settings_from
from facade_manipulator.resources import config_path

NODES = ('**', 'driver')  # whose sections the driver reads
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
    values: dict[str, Any] = {}
    for path in files:
        try:
            content = yaml.safe_load(path.read_text(encoding='utf-8'))
            values.update((name, value) for node, name, value in given_parameters(content)
                          if node.rpartition('/')[2] in NODES)
        except (yaml.YAMLError, AttributeError) as error:
            raise ParameterError(f'{path} is no parameter file: {error}') from error
    geometry = _settings(Geometry, values, 'geometry')
    axes = tuple(_settings(AxisSettings, values, name, **defaults)
                 for name, defaults in axis_defaults(geometry.stroke).items())
    return geometry, StoppingAnalysis(
        geometry, _settings(MotionLimits, values, 'limits'), axes,
        _settings(ControllerSettings, values, 'controller'))


def _settings(cls: type, values: dict[str, Any], prefix: str, **defaults: Any) -> Any:
    known = parameter_fields(cls)
    for name in values:
        section, _, field = name.partition('.')
        if section == prefix and field not in known:
            raise ParameterError(f'{name} is no parameter of the driver')
    return settings_from(cls, values, prefix, **defaults)


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
