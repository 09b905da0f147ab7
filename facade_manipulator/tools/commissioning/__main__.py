"""Executable ``commission``: set up new drives until the machine can home, without ROS."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
import logging
from pathlib import Path
import re
import sys
from typing import Any

from facade_manipulator.command_line import exit_status
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.tools.commissioning import (
    carriage_measurements,
    drive_ids,
    drive_settings,
    stop_test,
)
from facade_manipulator.tools.commissioning.procedure import Context
from facade_manipulator.tools.parameter_files import announce


def main(arguments: Sequence[str] | None = None, **access: Any) -> int:
    """Run a command; return its exit status. `access` provides bus and clock for the context."""
    words = sys.argv[1:] if arguments is None else arguments
    options = _parser().parse_args(_with_decimal_points(words))
    for name in ('can', 'canopen'):  # the command reports errors of both
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    context = Context(options, **access)

    def run() -> None:
        announce('commission', context.files)
        options.run(context)

    if status := exit_status('commission', run):
        written = f'Written into {context.overlay.path}: {context.written}'
        print(*filter(None, (context.state, written)), sep='\n', file=sys.stderr)
    return status


_MILLIMETRES = re.compile(r'([-+]?\d+)(?:[.,](\d+))?(?: ?mm)?')


def _with_decimal_points(words: Sequence[str]) -> list[str]:
    """Return the words of a command; argparse would take -39,8 or -40mm for an option."""
    result = []
    for word in words:
        if number := _MILLIMETRES.fullmatch(word):
            whole, fraction = number.groups()
            word = f'{whole}.{fraction}' if fraction else whole
        result.append(word)
    return result


STEPS = [
    'scan',
    'assign',
    *(
        f'{command} {axis}'
        for command in ('profile --check', 'backup', 'direction', 'jog', 'lead')
        for axis in AXIS_NAMES
    ),
    'lag',
    'stop-test',
]


def run_status(context: Context) -> None:
    """Print the completed steps with their times, followed by the next command."""
    done = context.overlay.steps()
    for step in dict.fromkeys([*STEPS, *done]):
        print(f'{step:20}{done.get(step, "-")}')
    left = [step for step in STEPS if step not in done]
    print(f'next: commission {left[0]}' if left else 'next: start the machine')


def _length(
    least: float, most: float, default: str, unit: str = 'MM'
) -> dict[str, Any]:
    """Return the settings of an argument in mm or mm/s, stored in SI units; 0 is rejected."""

    def length(text: str) -> float:
        value = float(text)
        if not least <= value <= most or not value:
            raise argparse.ArgumentTypeError(
                f'{text} is 0 or not between {least:g} and {most:g}'
            )
        return 1e-3 * value

    return {
        'type': length,
        'default': default,
        'metavar': unit,
        'help': f'at most {most:g} (default {default})',
    }


def _common() -> argparse.ArgumentParser:
    """Return new options for every command, because shared options would share defaults."""
    common = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS)
    common.add_argument(
        '--parameters',
        type=Path,
        metavar='YAML',
        help='parameter file of the machine (default '
        'manipulator.yaml, or the installed one); machine.yaml in its folder receives the results',
    )
    common.add_argument(
        '--yes', action='store_true', help='answer yes to every question'
    )
    return common


AXIS: dict[str, dict[str, Any]] = {'axis': {'choices': AXIS_NAMES}}
MOVED = AXIS | {
    '--speed': _length(1, 50, '10', 'MM/S'),
    '--alone': {
        'action': 'store_true',
        'help': 'move only this carriage: the links are not joined to it',
    },
}
LSS_TIMEOUT: dict[str, dict[str, Any]] = {
    '--lss-timeout': {
        'type': float,
        'default': 0.1,
        'metavar': 'S',
        'help': 'timeout [s] (default 0.1)',
    }
}
SUBCOMMANDS: dict[str, tuple[Callable[[Context], None], dict[str, dict[str, Any]]]] = {
    'scan': (drive_ids.run_scan, LSS_TIMEOUT),
    'assign': (
        drive_ids.run_assign,
        LSS_TIMEOUT
        | {
            '--serials': {
                'type': int,
                'nargs': len(AXIS_NAMES),
                'metavar': AXIS_NAMES,
                'help': 'serial numbers of the drives; default: the command asks',
            }
        },
    ),
    'profile': (
        drive_settings.run_profile,
        {
            'axis': {'nargs': '?', 'choices': AXIS_NAMES, 'help': 'otherwise all'},
            '--check': {'action': 'store_true', 'required': True},
        },
    ),
    'backup': (
        drive_settings.run_backup,
        AXIS
        | {
            'file': {'type': Path, 'nargs': '?', 'help': 'default: machine.AXIS.dcf'},
            '--eds': {
                'type': Path,
                'help': 'EDS of the maker, which lists more objects',
            },
        },
    ),
    'restore': (drive_settings.run_restore, AXIS | {'file': {'type': Path}}),
    'direction': (carriage_measurements.run_direction, AXIS),
    'jog': (
        carriage_measurements.run_jog,
        MOVED | {'distance': _length(-200, 200, '20') | {'nargs': '?'}},
    ),
    'lead': (
        carriage_measurements.run_lead,
        MOVED
        | {
            '--travel': _length(-200, 200, '40'),
            '--measured': {'metavar': 'MM', 'help': 'default: the command asks for it'},
        },
    ),
    'home-switch': (
        carriage_measurements.run_home_switch,
        MOVED
        | {
            '--window': _length(0, 200, '50'),
            '--towards': {
                'choices': '+-',
                'default': '+',
                'help': 'side of the switch (+)',
            },
            '--approaches': {
                'type': int,
                'default': 10,
                'choices': range(1, 101),
                'metavar': 'N',
                'help': 'at most 100 (default 10)',
            },
        },
    ),
    'lag': (carriage_measurements.run_lag, {}),
    'stop-test': (stop_test.run_stop_test, {'--speed': _length(1, 300, '200', 'MM/S')}),
}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='commission',
        description=__doc__,
        parents=[_common()],
        epilog='Without a command: print the completed steps and the next step.',
    )
    parser.set_defaults(run=run_status, parameters=None, yes=False, alone=False)
    commands = parser.add_subparsers(metavar='COMMAND')
    for name, (run, added) in SUBCOMMANDS.items():
        text = str(run.__doc__)
        command = commands.add_parser(
            name, help=text, description=text, parents=[_common()]
        )
        command.set_defaults(run=run)
        for flag, details in added.items():
            command.add_argument(flag, **details)
    return parser


if __name__ == '__main__':
    sys.exit(main())
