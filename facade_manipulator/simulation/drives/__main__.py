"""
Executable ``drive_simulator``: three simulated drives on any python-can bus. It needs no ROS.

The driver of the machine talks to them over CAN as it does to real ones.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import Field, fields
import logging
import signal
import sys
from typing import Any

from facade_manipulator.drives.canopen.link import BusSettings, open_bus
from facade_manipulator.drives.cia402.settings import AxisSettings, DEFAULT_AXES
from facade_manipulator.drives.cia402.units import AxisScale
from facade_manipulator.errors import BusError, ManipulatorError
from facade_manipulator.parameters import METADATA_KEY, settings_from
from facade_manipulator.simulation.drives.drive import simulated_drives, SimulatedDrive
from facade_manipulator.simulation.drives.lss import UNCONFIGURED
from facade_manipulator.simulation.drives.motor import SimulationSettings
from facade_manipulator.simulation.drives.simulator import DriveSimulator

USAGE_ERROR, BUS_ERROR = 2, 3

# settings that the options give for each drive, or that its profile knows
_NO_OPTIONS = {'direction', 'lead', 'velocity_unit', 'profile_counts', 'acceleration_unit'}
STOP_SIGNALS = signal.SIGINT, signal.SIGTERM
_NEW_SERIALS = (4711, 4712, 4713)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM; return the exit status."""
    options = _parser().parse_args(_without_ros(sys.argv[1:] if arguments is None else arguments))
    # what python-can logs about an interface is said once, in a message of ours
    logging.getLogger('can').setLevel(logging.CRITICAL)
    # they wait until they are asked for: a handler in the way of a lock would wait for itself
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        _simulate(options)
    except ManipulatorError as error:
        print(f'drive_simulator: {error}', file=sys.stderr)
        return BUS_ERROR if isinstance(error, BusError) else USAGE_ERROR
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return 0


def _simulate(options: argparse.Namespace) -> None:
    drives = make_drives(options)
    bus = settings_from(BusSettings, vars(options))
    with DriveSimulator(lambda: open_bus(bus), drives):
        nodes = ', '.join(str(drive.node_id) for drive in drives)
        print(f'drive_simulator: nodes {nodes} on {bus.interface} {bus.channel}', flush=True)
        signal.sigwait(STOP_SIGNALS)


def make_drives(options: argparse.Namespace) -> list[SimulatedDrive]:
    """Make the drives of the options; raises a ManipulatorError if one is out of range."""
    chosen, count = vars(options), len(options.node_ids)
    settings = settings_from(SimulationSettings, chosen)
    drives = simulated_drives([
        settings_from(
            AxisSettings, chosen, node_id=node_id, direction=direction, lead=lead,
            serial_number=serial, home_position=start, lower_limit=settings.lower_stop,
            upper_limit=settings.upper_stop)
        for node_id, direction, lead, serial, start in zip(
            options.node_ids,
            _one_each('directions', options.directions, count),
            _one_each('leads', options.leads, count),
            _one_each('serial-numbers', _serial_numbers(options), count),
            _one_each('start-positions', options.start_positions, count), strict=True)
    ], settings)
    for drive in drives if options.new else ():
        drive.lss.stored = options.new
        drive.reboot()
    return drives


def _serial_numbers(options: argparse.Namespace) -> Sequence[int]:
    others = _NEW_SERIALS if options.new else options.node_ids
    return getattr(options, 'serial_numbers', others)


def _one_each(name: str, values: Sequence[Any], count: int) -> Sequence[Any]:
    if len(values) == 1:
        return [values[0]] * count
    if len(values) != count:
        raise ManipulatorError(f'--{name} has {len(values)} values for {count} node ids')
    return values


def _without_ros(arguments: Sequence[str]) -> list[str]:
    """Drop what launch files append: from ``--ros-args`` to ``--`` or the end."""
    kept: list[str] = []
    is_ros = False
    for argument in arguments:
        if argument in ('--ros-args', '--'):
            is_ros = argument == '--ros-args'
        elif not is_ros:
            kept.append(argument)
    return kept


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='drive_simulator', description='Simulated CiA 402 drives on a CAN bus.',
        formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    add = parser.add_argument
    add('--profile', default='simulated', help='drive type: a file of config/drives')
    add('--node-ids', type=int, nargs='+', default=[1, 2, 3],
        help='one drive each; what follows has one value for each, or one for all')
    add('--start-positions', type=float, nargs='+',
        default=[axis.home_position for axis in DEFAULT_AXES],
        help='where the carriages stand [m]')
    add('--directions', type=int, nargs='+', default=[1],
        help='-1: positive counts move the carriage to negative q')
    add('--leads', type=float, nargs='+', default=[AxisScale().lead],
        help='travel of the carriage per revolution of the screw [m]')
    add('--serial-numbers', type=_number, nargs='+', default=argparse.SUPPRESS,
        help='serial numbers (default: the node ids)')
    add('--new', type=int, nargs='?', const=1, default=0, choices=(1, UNCONFIGURED),
        help=f'as from the box: all are node 1, or with {UNCONFIGURED} have no node id, until LSS '
             'gives them one')
    add('--vendor-id', type=_number, default=0, help='vendor of all drives')
    add('--product-code', type=_number, default=0, help='product code of all drives')
    for settings in (BusSettings, AxisScale, SimulationSettings):
        _add_settings(parser, settings)
    parser.set_defaults(interface='socketcan', channel='vcan0')
    return parser


def _number(text: str) -> int:
    return int(text, 0)


def _add_settings(parser: argparse.ArgumentParser, settings: type) -> None:
    for item in fields(settings):
        if item.name not in _NO_OPTIONS:
            info = item.metadata[METADATA_KEY]
            unit = f' [{info.unit}]' if info.unit else ''
            parser.add_argument(
                '--' + item.name.replace('_', '-'), help=info.description + unit,
                default=item.default, **_value_type(item))


def _value_type(item: Field[Any]) -> dict[str, Any]:
    if isinstance(item.default, tuple):
        return {'type': _number, 'nargs': '*'}
    if isinstance(item.default, bool):
        return {'action': 'store_true'}
    return {'type': type(item.default)}


if __name__ == '__main__':
    sys.exit(main())
