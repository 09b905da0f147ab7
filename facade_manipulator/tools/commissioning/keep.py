"""Commands `profile`, `backup`, `compare` and `restore`: what is in a drive, what should be."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
import shutil
from typing import Any

from facade_manipulator.canopen.eds import variables
from facade_manipulator.canopen.sdo import SdoChannel
from facade_manipulator.drives.axis_settings import AXIS_NAMES
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.states import decode_state, POWERED_STATES
from facade_manipulator.errors import CommissioningError, file_errors
from facade_manipulator.resources import config_path
from facade_manipulator.tools.commissioning.bus import number_or_none, stating, ToolBus
from facade_manipulator.tools.commissioning.context import Context
from facade_manipulator.tools.commissioning.drive_objects import (
    compare,
    IDENTITY,
    is_kept,
    label,
    read_dcf,
    restore,
    Snapshot,
    store,
    take_snapshot,
    write_dcf,
)
from facade_manipulator.tools.commissioning.drive_profile import differences, draft
from facade_manipulator.tools.commissioning.scan import only_drive

STATUSWORD = 0x6041


def add_commands(add: Callable[..., Any]) -> None:
    """Add the commands to the tool."""
    command = add('profile', run_profile, 'Draft a drive profile from an EDS, or check drives.')
    command.add_argument('eds', type=Path, nargs='?', help="the maker's EDS or DCF")
    command.add_argument('--check', nargs='*', metavar='AXIS',
                         help='hold these drives (default all) against their profiles')
    command.add_argument('--output', type=Path, metavar='YAML',
                         help='the profile to write (default: the name of the EDS)')
    command.add_argument('--give-up-dead-master-stop', action='store_true',
                         help='accept a drive that moves on when this computer falls silent')
    backup = add('backup', run_backup, 'Read all writable objects of a drive into a DCF.',
                 has_axis=True)
    backup.add_argument('file', type=Path, nargs='?', help='default: beside the parameter file')
    comparing = add('compare', run_compare, 'Say where two drives, or a drive and a file, differ.')
    comparing.add_argument('here', help='q1, q2, q3 or a DCF')
    comparing.add_argument('there', help='q1, q2, q3 or a DCF')
    restoring = add('restore', run_restore, 'Write a DCF into a drive, read it back, store it.',
                    has_axis=True)
    restoring.add_argument('file', type=Path)
    for command in (backup, comparing, restoring):
        command.add_argument(
            '--eds', type=Path, help="the maker's EDS, where the profile has a smaller one")


def run_profile(context: Context) -> int:
    """Draft or check; return 1 where a drive does not fit."""
    options = context.options
    if options.check is not None:
        return check_profiles(context, options.check or AXIS_NAMES)
    if options.eds is None:
        raise CommissioningError('name an EDS to draft a profile from, or --check')
    output = options.output or Path(options.eds.stem + '.yaml')
    operator = context.operator
    with file_errors(output):
        previous = output.read_text('utf-8') if output.exists() else ''
    found = draft(options.eds, context.machine.axes.values(), previous,
                  needs_stop=not options.give_up_dead_master_stop)
    operator.say('\n'.join([
        f'{options.eds.name}: {found.verdict}', *(f'!! {item}' for item in found.deadly),
        *(f'! {item}' for item in found.reservations),
        *(f'- {item}, optional' for item in found.without)]))
    if found.deadly:
        operator.say('Nothing is written.')
        return 1
    context.operator.agree(f'{output} is written, and the EDS beside it.')
    with file_errors(output):
        if options.eds.resolve().parent != output.resolve().parent:
            shutil.copy(options.eds, output.parent)
        output.write_text(found.text, 'utf-8')
    load_profile(str(output))  # as the driver will
    for line in found.text.splitlines():
        if '# ?' in line:
            context.operator.say(line.strip())
    context.operator.say(f'profile: {output.resolve()} names it in the parameter file.')
    return 1 if found.reservations else 0


def check_profiles(context: Context, names: Sequence[str]) -> int:
    """Hold drives against their profiles; return 1 where one does not fit."""
    wrong = 0
    with context.bus() as bus:
        for name in names:
            axis = context.machine.axis(name)
            found = differences(only_drive(bus, axis, name), load_profile(axis.profile), axis)
            for line in found:
                context.operator.say(f'! {name}: {line}')
            if not found:
                context.operator.say(f'{name}: the drive is as profile {axis.profile} says')
            wrong += len(found)
    return 1 if wrong else 0


def run_backup(context: Context) -> None:
    """Read and write down."""
    name = context.options.axis
    path = context.options.file or context.machine.beside(f'.{name}.dcf')
    with context.bus() as bus:
        snapshot = _of_drive(context, bus, name)
    write_dcf(snapshot, path)
    for line in _share(context, snapshot):
        context.operator.say(line)
    context.operator.say(f'{path} has {len(snapshot.values)} objects of {name}.')


def _share(context: Context, snapshot: Snapshot) -> Iterator[str]:
    """Yield how much of the drive is kept, and what is kept otherwise than described."""
    eds = _eds(context, snapshot.source)
    named = [(one.index, one.subindex) for one in variables(snapshot.dictionary) if is_kept(one)]
    yield (f'{len(snapshot.values.keys() & set(named))} of the {len(named)} writable objects that '
           f'{eds.name} names')
    if config_path('drives') in eds.parents:
        yield ('! What else the drive has (motor data, gains, inputs, brake) is not kept: give '
               "the maker's EDS with --eds.")
    if snapshot.sizes:
        yield '! Kept as they are, of another size than described: ' + ', '.join(
            f'{label(key)} ({size} bytes)' for key, size in snapshot.sizes.items())


def _eds(context: Context, name: str) -> Path:
    return context.options.eds or load_profile(context.machine.axis(name).profile).eds


def _of_drive(context: Context, bus: ToolBus, name: str) -> Snapshot:
    return take_snapshot(unpowered_drive(context, bus, name), _eds(context, name))


def unpowered_drive(context: Context, bus: ToolBus, name: str) -> SdoChannel:
    """Return a drive's objects; a CommissioningError if it has power: they are in use."""
    drive = only_drive(bus, context.machine.axis(name), name)
    status = number_or_none(drive, STATUSWORD)
    if status is not None and (state := decode_state(status)) in POWERED_STATES:
        raise CommissioningError(
            f'{name} has power ({state.value}): nothing was done; take it away, then try again')
    return drive


def _of_place(context: Context, *names: str) -> set[tuple[int, int]]:
    """Return the objects that belong to a drive's place on the bus."""
    return {key for name in names if name in AXIS_NAMES
            for key in load_profile(context.machine.axis(name).profile).of_place}


def run_compare(context: Context) -> int:
    """List the differences; return 1 if there are any."""
    with context.bus() as bus:
        here, there = (
            _of_drive(context, bus, name) if name in AXIS_NAMES else read_dcf(Path(name))
            for name in (context.options.here, context.options.there))
    of_place = _of_place(context, context.options.here, context.options.there)
    found = compare(here, there, of_place)
    if found:
        context.operator.table(('object', 'name', here.source, there.source),
                               [difference.row for difference in found])
    context.operator.say(
        f'{len(found)} differences between {here.source} and {there.source}.')
    return 1 if found else 0


def run_restore(context: Context) -> None:
    """Show what differs, ask, write, read back, store, reset, read again."""
    name, operator = context.options.axis, context.operator
    wanted = read_dcf(context.options.file)
    context.options.eds = context.options.eds or context.options.file  # which describes it all
    node_id = context.machine.axis(name).node_id
    with context.bus() as bus:
        present = _of_drive(context, bus, name)
        _check_type(wanted, present)
        of_place = _of_place(context, name)
        found = compare(wanted, present, of_place)
        if kept := [label(key) for key in sorted(of_place & wanted.values.keys())]:
            operator.say(f'{name} keeps what belongs to its place: {", ".join(kept)}')
        if not found:
            operator.say(f'{name} is as {wanted.source} says: nothing to do.')
            return
        operator.table(('object', 'name', wanted.source, f'{name} now'),
                       [difference.row for difference in found])
        operator.agree(f'{name} gets the values of {wanted.source}, stores them (1010h) and is '
                       'reset. It must have no power on its motor. Nothing moves.')
        count = restore(bus.objects(node_id, name), wanted, present, of_place)
        store(bus, node_id, name)
        with stating(lambda: f'{name} has stored what was written: commission compare {name} '
                     f'{context.options.file} says whether all of it'):
            remaining = compare(wanted, _of_drive(context, bus, name), of_place)
    lost = [label(one.key) for one in remaining if None not in (one.here, one.there)]
    if lost:
        raise CommissioningError(
            f'{name} took {", ".join(lost)} but has other values again after its reset: it does '
            'not store them; what needs them must write them at each start')
    operator.say(f'{name}: {count} objects written, stored, and the same after a reset.')


def _check_type(wanted: Snapshot, present: Snapshot) -> None:
    for key in IDENTITY[:2]:
        if wanted.values.get(key) not in (None, present.values.get(key)):
            raise CommissioningError(
                f'{wanted.source} is of another drive type ({key[0]:X}h:{key[1]:02X} = '
                f'{wanted.values[key]:X}h, the drive has {present.values.get(key, 0):X}h): '
                'nothing is written')
