"""Executable ``commission``: from a box of new drives to a machine that homes. It needs no ROS."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
import logging
from pathlib import Path
import sys
from typing import Any

from facade_manipulator.drives.axis_settings import AXIS_NAMES
from facade_manipulator.errors import exit_status
from facade_manipulator.resources import MACHINE_FILE
from facade_manipulator.tools.commissioning import (
    assign,
    keep,
    lag,
    measuring,
    moving,
    one_drive,
    scan,
    stop_test,
)
from facade_manipulator.tools.commissioning.context import Context
from facade_manipulator.tools.commissioning.machine import Machine
from facade_manipulator.tools.commissioning.operator import Operator

EPILOG = """
The order for new drives: scan, assign, scan, profile --check, backup, direction, lead, jog,
home-switch, lag, stop-test. Each command says what it will do and asks before anything moves or is
stored. Have the emergency stop at hand: no software replaces it.
"""
ROOMS = (scan, assign, keep, measuring, moving, lag, stop_test, one_drive)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return its exit status."""
    options = _parser().parse_args(arguments)
    logging.getLogger('can').setLevel(logging.CRITICAL)  # said once, in a message of ours
    logging.getLogger('canopen').setLevel(logging.CRITICAL)
    context = Context(Machine(options.parameters), Operator(options.yes), options)
    return exit_status(f'commission {options.command}', lambda: options.run(context),
                       interrupted='stopped by Ctrl-C')


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='commission', description=__doc__, epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True, dest='command', metavar='COMMAND')
    for room in ROOMS:
        room.add_commands(partial(_command, commands))
    return parser


def _command(
    commands: argparse._SubParsersAction[Any], name: str, run: Callable[..., Any], text: str,
    has_axis: bool = False,
) -> argparse.ArgumentParser:
    """Add a command with the options that all have; return its parser for more of them."""
    command = commands.add_parser(name, help=text, description=text)
    command.set_defaults(run=run)
    add = command.add_argument
    if has_axis:
        add('axis', choices=AXIS_NAMES)
    add('--parameters', type=Path, default=MACHINE_FILE, metavar='YAML',
        help='parameter file of this machine; made of the installed one when something is written '
             '(default machine.yaml)')
    add('--interface', help='kind of CAN interface; default: that of the parameter file')
    add('--channel', help='CAN interface; default: that of the parameter file')
    add('--bitrate', type=int, help='bit/s; default: that of the parameter file')
    add('--yes', action='store_true', help='ask nothing: the answer is yes')
    return command


if __name__ == '__main__':
    sys.exit(main())
