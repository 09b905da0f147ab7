"""Executable ``commission``: from new drives to a machine that homes. It needs no ROS."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
import logging
from pathlib import Path
import sys
from typing import Any

from facade_manipulator.commands import INTERRUPTED
from facade_manipulator.drives.axis_settings import AXIS_NAMES
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.tools.commissioning import backup, measure, nodes, profile, stop_test
from facade_manipulator.tools.commissioning.context import Context, table

EPILOG = 'Without a command: which steps are done, and which is next.'
STEPS = {  # words of the record, and the command
    'scan': 'scan', 'assign': 'assign',
    **{f'{step} {axis}': command.format(axis) for step, command in (
        ('profile', 'profile --check {}'), ('backup', 'backup {}'),
        ('direction', 'direction {}'), ('jog', 'jog {} 20'), ('lead', 'lead {}'))
       for axis in AXIS_NAMES},
    'lag': 'lag', 'stop-test': 'stop-test'}
AXIS = 'axis', {'choices': AXIS_NAMES}
ALONE = '--alone', {
    'action': 'store_true', 'help': 'move only this carriage: the links are not joined to it'}


def _number(name: str, default: float, unit: str) -> tuple[str, dict[str, Any]]:
    return name, {'type': float, 'default': default, 'metavar': unit, 'help': f'({default:g})'}


LSS_TIMEOUT = _number('--lss-timeout', 0.1, 'S')
COMMANDS: dict[str, tuple[Callable[[Context], int | None], list[tuple[str, dict[str, Any]]]]] = {
    'scan': (nodes.run_scan, [LSS_TIMEOUT]),
    'assign': (nodes.run_assign, [LSS_TIMEOUT, ('--serials', {
        'type': int, 'nargs': len(AXIS_NAMES), 'metavar': AXIS_NAMES,
        'help': 'serial numbers of the drives; by default they are asked for'})]),
    'profile': (profile.run_profile, [
        ('axis', {'nargs': '?', 'choices': AXIS_NAMES, 'help': 'by default all'}),
        ('--check', {'action': 'store_true', 'required': True})]),
    'backup': (backup.run_backup, [
        AXIS, ('file', {'type': Path, 'nargs': '?', 'help': 'by default machine.AXIS.dcf'}),
        ('--eds', {'type': Path, 'help': 'EDS of the maker, which names more objects'})]),
    'restore': (backup.run_restore, [AXIS, ('file', {'type': Path})]),
    'direction': (measure.run_direction, [AXIS]),
    'jog': (measure.run_jog, [
        AXIS, ('distance', {'type': float, 'metavar': 'MM'}), _number('--speed', 10.0, 'MM/S'),
        ALONE]),
    'lead': (measure.run_lead, [
        AXIS, _number('--travel', 40.0, 'MM'), _number('--speed', 10.0, 'MM/S'), ALONE,
        ('--measured', {'metavar': 'MM', 'help': 'by default it is asked for'})]),
    'home-switch': (measure.run_home_switch, [
        AXIS, _number('--window', 50.0, 'MM'), _number('--speed', 5.0, 'MM/S'), ALONE,
        ('--towards', {'choices': '+-', 'default': '+', 'help': 'side of the switch (+)'}),
        ('--approaches', {'type': int, 'default': 10, 'choices': range(1, 101), 'metavar': 'N',
                          'help': '(10)'})]),
    'lag': (measure.run_lag, []),
    'stop-test': (stop_test.run_stop_test, [_number('--speed', 200.0, 'MM/S')]),
}


def main(arguments: Sequence[str] | None = None, **access: Any) -> int:
    """Run a command; return its exit status. `access` is how a context opens the bus."""
    options = _parser().parse_args(arguments)
    for name in ('can', 'canopen'):  # their errors are reported as errors of the command
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    context, status = Context(options, **access), 1
    try:
        return options.run(context) or 0
    except KeyboardInterrupt:
        message, status = 'interrupted', INTERRUPTED
    except (ManipulatorError, OSError) as error:
        message = str(error)
    written = ', '.join(context.written) or 'nothing'
    parts = (f'commission: {message}', context.state,
             f'Written into {context.overlay.path}: {written}')
    print('. '.join(filter(None, parts)), file=sys.stderr)
    return status


def run_status(context: Context) -> None:
    """Print the steps with the time at which they were done, and the next command."""
    done = context.overlay.steps()
    table((step, done.get(step, '-')) for step in {**STEPS, **done})
    commands = [command for step, command in STEPS.items() if step not in done]
    print(f'next: commission {commands[0]}' if commands else 'next: start the machine')


def _parser() -> argparse.ArgumentParser:
    common = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS)
    common.add_argument(
        '--parameters', type=Path, metavar='YAML',
        help='parameter file of the machine, by default manipulator.yaml, or the installed one; '
             'machine.yaml beside it gets the results')
    for name in ('interface', 'channel'):
        common.add_argument(f'--{name}', help='of the bus, instead of that of the parameter file')
    common.add_argument('--yes', action='store_true', help='ask nothing: the answer is yes')
    parser = argparse.ArgumentParser(
        prog='commission', description=__doc__, epilog=EPILOG, parents=[common])
    parser.set_defaults(run=run_status, parameters=None, interface=None, channel=None, yes=False,
                        alone=False)
    commands = parser.add_subparsers(metavar='COMMAND')
    for name, (run, added) in COMMANDS.items():
        text = str(run.__doc__)
        command = commands.add_parser(name, help=text, description=text, parents=[common])
        command.set_defaults(run=run)
        for flag, details in added:
            command.add_argument(flag, **details)
    return parser


if __name__ == '__main__':
    sys.exit(main())
