"""
Executable ``drive_simulator``: three simulated drives on any python-can bus. It needs no ROS.

The driver of the machine talks to them over CAN as it does to real ones.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import Field, fields, replace
import logging
import signal
import sys
import threading
from typing import Any

import can

from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.simulated_bus import DriveSimulator
from facade_manipulator.drives.simulated_drive import Identity, SimulatedDrive
from facade_manipulator.drives.simulated_motor import SimulationSettings
from facade_manipulator.drives.units import AxisScale
from facade_manipulator.errors import BusError, ManipulatorError
from facade_manipulator.parameters import METADATA_KEY

HOME = (-0.1, 0.1, 0.0)  # m: q1, q2, q3 of the home pose, where the machine is parked
USAGE_ERROR, BUS_ERROR = 2, 3

_PER_DRIVE = {'start_position'}
_FROM_PROFILE = {'velocity_unit'}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM; return the exit status."""
    options = _parser().parse_args(_without_ros(sys.argv[1:] if arguments is None else arguments))
    # what python-can logs about an interface is said once, in a sentence of ours
    logging.getLogger('can').setLevel(logging.CRITICAL)
    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopping.set())
    try:
        _simulate(options, stopping)
    except BusError as error:
        return _refuse(str(error), BUS_ERROR)
    except ManipulatorError as error:
        return _refuse(str(error), USAGE_ERROR)
    return 0


def _refuse(sentence: str, status: int) -> int:
    print(f'drive_simulator: {sentence}', file=sys.stderr)
    return status


def _simulate(options: argparse.Namespace, stopping: threading.Event) -> None:
    drives = make_drives(options)
    simulator = DriveSimulator(open_bus(options), drives, reopen=lambda: _bus(options))
    try:
        with simulator:
            nodes = ', '.join(str(node_id) for node_id in options.node_ids)
            print(f'drive_simulator: nodes {nodes} on {options.interface} {options.channel}',
                  flush=True)
            stopping.wait()
    finally:
        simulator.bus.shutdown()


def _bus(options: argparse.Namespace) -> can.BusABC:
    return can.Bus(interface=options.interface, channel=options.channel)


def open_bus(options: argparse.Namespace) -> can.BusABC:
    """
    Open the bus.

    Raises
    ------
    BusError
        It does not exist or cannot be opened.

    """
    try:
        return _bus(options)
    except (can.CanError, OSError, ValueError) as error:
        raise BusError(
            f'the CAN channel {options.channel} of interface {options.interface} cannot be '
            f'opened: {error}') from None


def make_drives(options: argparse.Namespace) -> list[SimulatedDrive]:
    """
    Make the drives that the options describe.

    Raises
    ------
    ManipulatorError
        An option is out of range.

    """
    profile = load_profile(options.profile)
    scale = AxisScale(**_chosen(options, AxisScale))
    settings = SimulationSettings(**_chosen(options, SimulationSettings))
    count = len(options.node_ids)
    return [
        SimulatedDrive(
            node_id, profile, replace(scale, direction=direction),
            Identity(options.vendor_id, options.product_code, 1, serial),
            replace(settings, start_position=start))
        for node_id, direction, serial, start in zip(
            options.node_ids,
            _one_each('directions', options.directions, count),
            _one_each('serial-numbers', options.serial_numbers or options.node_ids, count),
            _one_each('start-positions', options.start_positions, count), strict=True)
    ]


def _one_each(name: str, values: Sequence[Any], count: int) -> Sequence[Any]:
    if len(values) == 1:
        return [values[0]] * count
    if len(values) != count:
        raise ManipulatorError(f'--{name} has {len(values)} values for {count} node ids')
    return values


def _chosen(options: argparse.Namespace, settings: type) -> dict[str, Any]:
    chosen = {item.name: getattr(options, item.name, item.default) for item in fields(settings)}
    return {name: tuple(value) if isinstance(value, list) else value
            for name, value in chosen.items()}


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
    add('--interface', default='socketcan', help='python-can interface')
    add('--channel', default='vcan0', help='channel of the interface')
    add('--profile', default='simulated', help='drive type: a file of config/drives')
    add('--node-ids', type=int, nargs='+', default=[1, 2, 3],
        help='one drive each; what follows has one value for each, or one for all')
    add('--start-positions', type=float, nargs='+', default=list(HOME),
        help='where the carriages stand [m]')
    add('--directions', type=int, nargs='+', default=[1],
        help='-1: positive counts move the carriage to negative q')
    add('--serial-numbers', type=_number, nargs='+', help='default: the node ids')
    add('--vendor-id', type=_number, default=0, help='vendor of all drives')
    add('--product-code', type=_number, default=0, help='product code of all drives')
    for settings in (AxisScale, SimulationSettings):
        _add_settings(parser, settings)
    return parser


def _number(text: str) -> int:
    return int(text, 0)


def _add_settings(parser: argparse.ArgumentParser, settings: type) -> None:
    for item in fields(settings):
        if item.name not in _PER_DRIVE | _FROM_PROFILE | {'direction'}:
            parser.add_argument(
                '--' + item.name.replace('_', '-'), help=_help(item), default=item.default,
                **_value_type(item))


def _help(item: Field[Any]) -> str:
    info = item.metadata[METADATA_KEY]
    return f'{info.description} [{info.unit}]' if info.unit else info.description


def _value_type(item: Field[Any]) -> dict[str, Any]:
    if isinstance(item.default, tuple):
        return {'type': _number, 'nargs': '*'}
    return {'type': type(item.default)}


if __name__ == '__main__':
    sys.exit(main())
