"""
Executable ``drive_simulator``: three simulated drives on any python-can bus. It needs no ROS.

The driver of the machine talks to them over CAN as it does to real ones.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import cycle
import logging
import signal
import sys
from typing import Any

from facade_manipulator.canopen.link import BusSettings, open_bus
from facade_manipulator.drives.axis_settings import AxisSettings, DEFAULT_AXES
from facade_manipulator.errors import BusError, ManipulatorError
from facade_manipulator.parameters import parameter_fields, settings_from
from facade_manipulator.simulation.drives.drive import SimulatedDrive
from facade_manipulator.simulation.drives.lss import UNCONFIGURED
from facade_manipulator.simulation.drives.motor import SimulationSettings
from facade_manipulator.simulation.drives.simulator import DriveSimulator

USAGE_ERROR, BUS_ERROR = 2, 3
STOP_SIGNALS = signal.SIGINT, signal.SIGTERM
_NEW_SERIALS = (4711, 4712, 4713)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM; return the exit status."""
    options = _parser().parse_args(arguments)
    for name in ('can', 'canopen'):  # their messages repeat errors of this process or the master
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    # the signals wait until they are asked for: a handler would interrupt the thread's lock
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        drives, bus = make_drives(options), settings_from(BusSettings, vars(options))
        with DriveSimulator(lambda: open_bus(bus), drives):
            nodes = ', '.join(str(drive.node_id) for drive in drives)
            print(f'drive_simulator: nodes {nodes} on {bus.interface} {bus.channel}', flush=True)
            signal.sigwait(STOP_SIGNALS)
    except ManipulatorError as error:
        print(f'drive_simulator: {error}', file=sys.stderr)
        return BUS_ERROR if isinstance(error, BusError) else USAGE_ERROR
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return 0


def make_drives(options: argparse.Namespace) -> list[SimulatedDrive]:
    """Make the drives of the options; raises a ManipulatorError if one is out of range."""
    settings = settings_from(SimulationSettings, vars(options))
    serials = options.serial_numbers or (_NEW_SERIALS if options.new else [0])
    each = zip(options.node_ids, *map(cycle, (
        options.start_positions, options.directions, options.leads, serials)), strict=False)
    drives = [SimulatedDrive(AxisSettings(
        node_id=node_id, home_position=start, direction=direction, lead=lead,
        serial_number=serial, profile=options.profile), settings)
        for node_id, start, direction, lead, serial in each]
    for drive in drives if options.new else ():
        drive.lss.stored = options.new
        drive.reboot()
    return drives


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='drive_simulator', description='Simulated CiA 402 drives on a CAN bus. Options that '
        'take several values have one for each drive; fewer values are repeated.',
        formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    add = parser.add_argument
    add('--profile', default='simulated', help='drive type: a file of config/drives')
    add('--node-ids', type=int, nargs='+', default=[1, 2, 3], help='one drive each')
    add('--new', type=int, nargs='?', const=1, default=0, choices=(1, UNCONFIGURED),
        help=f'as from the box: all are node 1, or with {UNCONFIGURED} have no node id, until LSS '
             'gives them one')
    add('--start-positions', type=float, nargs='+', help='position of the carriages [m]',
        default=[axis.home_position for axis in DEFAULT_AXES])
    add('--directions', type=int, nargs='+', default=[1],
        help='-1: positive counts move the carriage to negative q')
    add('--leads', type=float, nargs='+', default=[DEFAULT_AXES[0].lead],
        help='travel per revolution of the screw [m]')
    add('--serial-numbers', type=int, nargs='+', help='without them: the node ids')
    described = parameter_fields(BusSettings) | parameter_fields(SimulationSettings)
    for name, info in described.items():
        kind = type(info.default)
        value: dict[str, Any] = {'type': kind}
        if kind is tuple:
            value = {'type': lambda text: int(text, 0), 'nargs': '*'}
        elif kind is bool:
            value = {'action': 'store_true'}
        add('--' + name.replace('_', '-'), default=info.default, **value, help=info.text)
    parser.set_defaults(interface='socketcan', channel='vcan0')
    return parser


if __name__ == '__main__':
    sys.exit(main())
