"""Commands `object`, `identify` and `replace`: one drive, and what is done to it alone."""

from __future__ import annotations

from collections.abc import Callable
import re
from typing import Any

from canopen.objectdictionary import ODVariable

from facade_manipulator.canopen.eds import read_dictionary, variables
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning import keep
from facade_manipulator.tools.commissioning.assign import add_lss_timeout, assign
from facade_manipulator.tools.commissioning.context import Context
from facade_manipulator.tools.commissioning.drive_objects import (
    decoded,
    encoded,
    is_kept,
    label,
    read_dcf,
    shown,
)
from facade_manipulator.tools.commissioning.scan import only_drive

_INDEX = re.compile('(0x)?([0-9a-f]{4})h?(:([0-9a-f]{1,2}))?', re.IGNORECASE)


def add_commands(add: Callable[..., Any]) -> None:
    """Add the commands to the tool."""
    command = add('object', run_object, 'Read or write one object of a drive.', has_axis=True)
    command.add_argument('object', help='such as 6065h, 607D:01, or its name in the EDS')
    command.add_argument('value', nargs='?', help='what to write: it is not stored')
    command.add_argument('--eds', help="the maker's EDS, where the profile has a smaller one")
    add('identify', run_identify, 'Let a drive blink.', has_axis=True)
    command = add('replace', run_replace, 'Make a new drive that of an axis: node id, objects of '
                  'its backup, profile.', has_axis=True)
    command.set_defaults(eds=None)  # all that the backup names
    add_lss_timeout(command)


def run_object(context: Context) -> None:
    """Show an object, or ask and write it."""
    name, options, operator = context.options.axis, context.options, context.operator
    eds = options.eds or load_profile(context.machine.axis(name).profile).eds
    variable = _variable(options.object, list(variables(read_dictionary(eds))))
    key = variable.index, variable.subindex
    title = f'{name}: {label(key)} {variable.name}'
    with context.bus() as bus:
        if options.value is None:
            drive = only_drive(bus, context.machine.axis(name), name)
            operator.say(f'{title} = {shown(decoded(variable, drive.read(*key)))}')
            return
        drive = keep.unpowered_drive(context, bus, name)
        if not is_kept(variable):
            raise CommissioningError(f'{title} is not a setting: nothing was written')
        before = drive.read(*key)
        data = _data(title, variable, options.value, len(before))
        operator.agree(f'{title} = {shown(decoded(variable, before))} becomes {options.value} '
                       'until the power is off (commission restore stores).')
        drive.write(*key, data)
        operator.say(f'{title} = {shown(decoded(variable, drive.read(*key)))}')


def _data(title: str, variable: ODVariable, text: str, size: int) -> bytes:
    """Return the bytes of what was typed; those of a number are as many as were read."""
    try:
        number = int(f'0x{text[:-1]}' if text.endswith('h') else text, 0)
        return encoded(variable, number, size)
    except (ValueError, OverflowError):
        raise CommissioningError(f'{title} has {size} bytes, which {text} is not a number of: '
                                 'nothing was written') from None


def _variable(text: str, known: list[ODVariable]) -> ODVariable:
    """Return the object of an index or a name; a CommissioningError if there is not just one."""
    if match := _INDEX.fullmatch(text):
        key = int(match[2], 16), int(match[4] or '0', 16)
        found = [one for one in known if (one.index, one.subindex) == key]
    else:
        found = [one for one in known if text.lower() in one.name.lower()]
        found = [one for one in found if one.name.lower() == text.lower()] or found
    if len(found) != 1:
        raise CommissioningError(
            f'{text} names {len(found)} objects of the EDS' + ''.join(
                f', {label((one.index, one.subindex))} {one.name}' for one in found[:5])
            + ": give index and subindex, or the maker's EDS with --eds")
    return found[0]


def run_identify(context: Context) -> None:
    """Let the drive blink until somebody has seen it."""
    name = context.options.axis
    axis = context.machine.axis(name)
    blinks = load_profile(axis.profile).blinks
    if not blinks:
        raise CommissioningError(
            f'profile {axis.profile} names nothing that blinks (blinks): look for the serial '
            f'number {axis.serial_number} on the labels')
    with context.bus() as bus:
        drive = only_drive(bus, axis, name)
        for key in blinks:
            drive.write(*key, b'\1')
        try:
            context.operator.ask(
                f'{name} (node {axis.node_id}) blinks. Enter ends it.', 'no --yes')
        finally:
            for key in blinks:
                drive.write(*key, b'\0')


def run_replace(context: Context) -> int:
    """Give a new drive everything that the one before had; return 1 if it does not fit."""
    name, machine = context.options.axis, context.machine
    context.options.file = machine.beside(f'.{name}.dcf')
    read_dcf(context.options.file)  # before anything is done
    known = {axis.serial_number: other for other, axis in machine.axes.items() if other != name}
    assign(context, lambda found: known.get(found.serial_number, name))
    keep.run_restore(context)
    status = keep.check_profiles(context, [name])
    context.operator.say(
        f'{name} has a new drive; next: commission direction {name}, then commission jog {name}')
    return status
