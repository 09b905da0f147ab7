"""
Executable ``drive_simulator``: three simulated drives on any python-can bus, without ROS.

The driver of the machine uses them over CAN like real drives. Lines on standard input push the
carriages by hand (`hand`).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import cycle
import logging
import os
import select
import signal
import sys
from typing import Any

from facade_manipulator.canopen import indices
from facade_manipulator.canopen.bus import open_bus
from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.canopen.lss import UNCONFIGURED
from facade_manipulator.command_line import exit_status
from facade_manipulator.drives.axis_settings import AxisSettings, DEFAULT_AXES
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.parameters import parameter_fields, ParameterSource
from facade_manipulator.simulation.drives import hand
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


class _StopSignal(Exception):
    """SIGINT or SIGTERM was received."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the simulated drives until SIGINT or SIGTERM; return the exit status."""
    options = _parser().parse_args(arguments)
    # their messages repeat errors of this process or master
    for name in ('can', 'canopen'):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    return exit_status('drive_simulator', lambda: _run(options))


_STOP_SIGNALS = signal.SIGINT, signal.SIGTERM


def _run(options: argparse.Namespace) -> None:
    drives = make_drives(options)
    bus = ParameterSource(vars(options)).read(BusSettings)
    opened = open_bus(bus)
    # The signals stay blocked: a handler would interrupt the thread's lock. With SIGTTIN blocked,
    # the read of a process in the background fails instead of stopping the process.
    signal.pthread_sigmask(signal.SIG_BLOCK, (*_STOP_SIGNALS, signal.SIGTTIN))
    with DriveSimulator(opened, drives) as simulator, suppress(_StopSignal):
        nodes = ', '.join(str(drive.node_id) for drive in drives)
        print(f'drive_simulator: nodes {nodes} on {bus.interface} {bus.channel}')
        labels = ', '.join(
            f'{name} {drive.objects.read((indices.IDENTITY, 4))}'
            for name, drive in _named(drives).items()
        )
        print(f'drive_simulator: carriages with serial numbers: {labels}')
        print(f'drive_simulator: {hand.USAGE}', flush=True)
        for line in _input_lines():
            _act(line, simulator)
        signal.sigwait(_STOP_SIGNALS)


def _named(drives: Sequence[SimulatedDrive]) -> dict[str, SimulatedDrive]:
    """Return the drives by the names of their carriages."""
    return {f'q{number}': drive for number, drive in enumerate(drives, start=1)}


def _act(line: str, simulator: DriveSimulator) -> None:
    """Carry out a line of the user, print the reply or the error, and wait for the hand."""
    with simulator.access() as drives:
        try:
            print(hand.act(line, _named(drives)), flush=True)
        except ManipulatorError as error:
            print(error, file=sys.stderr, flush=True)
    while any(drive.motor.is_pushed for drive in drives):
        _wait()


def _input_lines() -> Iterator[str]:
    """Yield the lines of standard input that are not empty, until its end or a stop signal."""
    if sys.stdin is None:  # closed by the process that started this process
        return
    unfinished = ''
    while True:
        _wait()
        if not select.select([sys.stdin], [], [], 0.0)[0]:
            continue
        try:
            data = os.read(sys.stdin.fileno(), 4096)
        except OSError:  # in the background of its terminal
            continue
        *lines, unfinished = (unfinished + data.decode(errors='replace')).split('\n')
        if not data:
            lines = [unfinished]
        yield from filter(None, map(str.strip, lines))
        if not data:
            return


_INPUT_PERIOD = 0.1  # s, between two looks at standard input


def _wait() -> None:
    """Wait between two looks at the input; raises a _StopSignal."""
    received = signal.sigtimedwait(_STOP_SIGNALS, _INPUT_PERIOD)
    # after a stop of the process (Ctrl-Z) Python returns a structure without a signal
    if received is not None and received.si_signo in _STOP_SIGNALS:
        raise _StopSignal


_NEW_SERIALS = (4711, 4712, 4713)


def make_drives(options: argparse.Namespace) -> list[SimulatedDrive]:
    """Return the drives for the options; raise a ManipulatorError for an invalid option."""
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
        help=f'factory state: every drive is node 1; with {UNCONFIGURED}, no drive has a '
        'node id until LSS assigns it',
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
