"""
Executable ``drive_simulator``: three simulated drives on any python-can bus, without ROS.

The driver of the machine uses them over CAN like real drives.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import cycle
import logging
import signal
import sys
from typing import Any

from facade_manipulator.canopen.bus import open_bus
from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.canopen.lss import UNCONFIGURED
from facade_manipulator.command_line import exit_status
from facade_manipulator.drives.axis_settings import AxisSettings, DEFAULT_AXES
from facade_manipulator.parameters import parameter_fields, ParameterSource
from facade_manipulator.simulation.drives.drive import SimulatedDrive
from facade_manipulator.simulation.drives.motor import SimulationSettings
from facade_manipulator.simulation.drives.simulator import DriveSimulator

# settings of an axis by the option that has one value for each drive
_OF_EACH_DRIVE = {
    'node_ids': 'node_id',
    'start_positions': 'home_position',
    'directions': 'direction',
    'leads': 'lead',
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the simulated drives until SIGINT or SIGTERM; return the exit status."""
    options = _parser().parse_args(arguments)
    for name in (
        'can',
        'canopen',
    ):  # their messages repeat errors of this process or master
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    return exit_status('drive_simulator', lambda: _run(options))


_STOP_SIGNALS = signal.SIGINT, signal.SIGTERM


def _run(options: argparse.Namespace) -> None:
    drives = make_drives(options)
    bus = ParameterSource(vars(options)).read(BusSettings)
    opened = open_bus(bus)
    # the signals stay blocked until sigwait: a handler would interrupt the thread's lock
    signal.pthread_sigmask(signal.SIG_BLOCK, _STOP_SIGNALS)
    with DriveSimulator(opened, drives):
        nodes = ', '.join(str(drive.node_id) for drive in drives)
        print(
            f'drive_simulator: nodes {nodes} on {bus.interface} {bus.channel}',
            flush=True,
        )
        signal.sigwait(_STOP_SIGNALS)


_NEW_SERIALS = (4711, 4712, 4713)


def make_drives(options: argparse.Namespace) -> list[SimulatedDrive]:
    """Return the drives of the options; raises a ManipulatorError for an option out of range."""
    settings = ParameterSource(vars(options)).read(SimulationSettings)
    node_ids, *others = (getattr(options, name) for name in _OF_EACH_DRIVE)
    drives = [
        SimulatedDrive(
            AxisSettings(
                profile=options.profile,
                serial_number=serial,
                **dict(zip(_OF_EACH_DRIVE.values(), values, strict=True)),
            ),
            settings,
        )
        for serial, *values in zip(
            cycle(_NEW_SERIALS if options.new else [0]),
            node_ids,
            *map(cycle, others),
            strict=False,
        )
    ]
    for drive in drives if options.new else ():
        drive.lss.stored = options.new
        drive.reboot()
    return drives


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='drive_simulator',
        description='Simulated CiA 402 drives on a CAN bus. Options that '
        'take several values have one for each drive; fewer values are repeated.',
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    add = parser.add_argument
    add('--profile', default='simulated', help='drive type: a file of config/drives')
    add(
        '--new',
        type=int,
        nargs='?',
        const=1,
        default=0,
        choices=(1, UNCONFIGURED),
        help=f'factory state: all are node 1, or with {UNCONFIGURED} have no node id, until LSS '
        'gives them one',
    )
    of_axis = parameter_fields(AxisSettings)
    for name, setting in _OF_EACH_DRIVE.items():
        add(
            f'--{name.replace("_", "-")}',
            type=type(of_axis[setting].default),
            nargs='+',
            default=[getattr(axis, setting) for axis in DEFAULT_AXES],
            help=of_axis[setting].text,
        )
    described = parameter_fields(BusSettings) | parameter_fields(SimulationSettings)
    kinds: dict[type, dict[str, Any]] = {
        tuple: {'type': lambda text: int(text, 0), 'nargs': '*'},
        bool: {'action': 'store_true'},
    }
    for name, info in described.items():
        add(
            f'--{name.replace("_", "-")}',
            default=info.default,
            help=info.text,
            **kinds.get(type(info.default), {'type': type(info.default)}),
        )
    parser.set_defaults(interface='socketcan', channel='vcan0')
    return parser


if __name__ == '__main__':
    sys.exit(main())
