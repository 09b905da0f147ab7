"""Command `report`: one page of the machine, what was found, what is missing before production."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import datetime
from typing import Any

from facade_manipulator.drives import cia402
from facade_manipulator.errors import BusError, file_errors
from facade_manipulator.files import atomic_write, checksum
from facade_manipulator.maintenance import kept_counters, ServiceSettings
from facade_manipulator.parameters import parameter_fields
from facade_manipulator.resources import version, written_folder
from facade_manipulator.tools.commissioning.context import Context
from facade_manipulator.tools.commissioning.machine import Machine
from facade_manipulator.tools.commissioning.scan import Node, scan

# what must have been done, once or for each axis, in this order, and by which command
ONCE = {'scan'}
CHECKS = {'scan': 'scan', 'assign': 'assign', 'profile': 'profile --check {}',
          'backup': 'backup {}', 'direction': 'direction {}', 'lead': 'lead {}', 'jog': 'jog {}',
          'home-switch': 'home-switch {}', 'lag': 'lag', 'stop-test': 'stop-test'}
_HERE = (35, 37)  # homing methods that look for nothing
_FROM_PAPER = {'gear_ratio', 'home_position', 'rated_torque'}


def add_commands(add: Callable[..., Any]) -> None:
    """Add the command to the tool."""
    add('report', run_report, 'One page of the machine, beside its parameter file.')


def next_command(context: Context) -> list[str]:
    """Say what is done, what is next and why; return the next command, empty for none."""
    machine, say = context.machine, context.operator.say
    done = [check for check in CHECKS if any(
        entry['check'] == check and entry['passed'] for entry in machine.journal)]
    missing = list(open_points(machine, []))
    say(f'Done on {machine.path}, at least in part: {", ".join(done) or "nothing yet"}; '
        f'{len(missing)} points are open.')
    if not missing:
        return []
    command, _, why = missing[0].removeprefix('commission ').partition(': ')
    order = [entry['check'] for entry in machine.journal]
    if command == 'scan' and 'commission assign' in why and order[-1:] == ['scan']:
        command = 'assign'
    say(f'Next: commission {command}, because {why}.')
    return command.split()


def run_report(context: Context) -> int:
    """Write the page; return 1 while something is missing."""
    machine = context.machine
    try:
        with context.bus() as bus:
            nodes, absent = scan(bus), ''
    except BusError as error:
        nodes, absent = [], str(error)
    text = '\n'.join(page(machine, nodes, absent)) + '\n'
    path = machine.beside('.report.md')
    with file_errors(path), atomic_write(path) as draft:
        draft.write_text(text, 'utf-8')
    missing = list(open_points(machine, nodes))
    for item in missing:
        context.operator.say(f'! {item}')
    context.operator.say(f'{path} is written; {len(missing)} points are open.')
    return 1 if missing else 0


def page(machine: Machine, nodes: list[Node], absent: str) -> Iterator[str]:
    """Yield the lines of the page, in Markdown."""
    now = datetime.now().isoformat(' ', 'seconds')
    parameters = f'{machine.path.name} {checksum(machine.source.read_bytes())}'
    profiles = cia402.profile_checksums(axis.profile for axis in machine.axes.values())
    yield from (f'# {machine.path.stem}', '', f'{now}, version {version()}',
                f'Checksums: {parameters}, {profiles}', '', '## Drives', '')
    yield from [f'The bus was not there: {absent}'] if absent else _table(
        ('node', 'serial number', 'name', 'firmware', 'profile'),
        [(node.node_id, ', '.join(map(str, node.serials)), node.name, node.firmware, node.profile)
         for node in nodes])
    yield from ('', '## Parameters of the axes', '')
    yield from _table(('parameter', *cia402.AXIS_NAMES, 'origin'), list(_parameters(machine)))
    yield from ('', '## Checks', '')
    yield from _table(
        ('date', 'user', 'check', 'axis', '', 'result'),
        [(entry['date'], entry['user'], entry['check'], entry['axis'],
          'passed' if entry['passed'] else '**open**', entry['result'])
         for entry in machine.journal])
    yield from ('', '## Counters', '')
    yield from _counters(machine.service)
    yield from ('', '## Missing before production', '')
    yield from [f'- {item}' for item in open_points(machine, nodes)] or ['Nothing.']


def _counters(service: ServiceSettings) -> Iterator[str]:
    folder = written_folder(service.folder)
    kept = kept_counters(str(folder))
    if not kept:
        yield f'None in {folder}: the drives have not had power yet, or elsewhere.'
    for name, counters in kept.items():
        yield from _table(
            (name, ''), [*counters.lines(), ('service', counters.due(service) or 'not due'), (
                'intervals', f'{service.hours:g} h, {service.travel:g} km; 0: never')])


def _table(head: tuple[Any, ...], rows: list[tuple[Any, ...]]) -> Iterator[str]:
    yield '| ' + ' | '.join(head) + ' |'
    yield '|' + '---|' * len(head)
    for row in rows:
        yield '| ' + ' | '.join(str(cell).replace('|', '/') for cell in row) + ' |'


def _parameters(machine: Machine) -> Iterator[tuple[Any, ...]]:
    axes = machine.axes
    written = ' '.join(entry['result'] for entry in machine.journal
                       if entry['check'] == 'written')
    given = machine.parameters
    for item in parameter_fields(cia402.AxisSettings).values():
        origin = 'default'
        if any(f'{name}.{item.name}:' in written for name in cia402.AXIS_NAMES):
            origin = 'measured'
        elif any(f'{name}.{item.name}' in given for name in cia402.AXIS_NAMES):
            origin = 'paper' if item.name in _FROM_PAPER else 'parameter file'
        yield (item.name, *(getattr(axes[name], item.name) for name in cia402.AXIS_NAMES), origin)


def open_points(machine: Machine, nodes: list[Node]) -> Iterator[str]:
    """Yield what is missing: checks never made or last failed, drives that are not as written."""
    latest = {(entry['check'], entry['axis']): entry for entry in machine.journal}
    axes = machine.axes
    yield from _open_checks(latest, axes)
    yield from (
        f'{name}: its profile {axis.profile} makes no drive stop when this computer falls '
        'silent (1016h and a reaction such as 6007h, both required)'
        for name, axis in axes.items()
        if not cia402.load_profile(axis.profile).stops_without_master)
    serials = {node.node_id: node.serials for node in nodes}
    for name, axis in axes.items():
        if nodes and serials.get(axis.node_id) != (axis.serial_number,):
            yield (f'{name}: node {axis.node_id} has serial number '
                   f'{", ".join(map(str, serials.get(axis.node_id, ()))) or "none"}, the '
                   f'parameter file {axis.serial_number}')


def _open_checks(
    latest: dict[tuple[str, str], dict[str, Any]], axes: dict[str, cia402.AxisSettings]
) -> Iterator[str]:
    for check, command in CHECKS.items():
        for axis in cia402.AXIS_NAMES if check not in ONCE else ('',):
            entry = latest.get((check, axis))
            if entry is None and check == 'home-switch' and axes[axis].homing_method in _HERE:
                continue
            if entry is None or not entry['passed']:
                of = f' ({axis})' if axis and '{' not in command else ''
                result = 'never done' if entry is None else entry['result']
                yield f'commission {command.format(axis)}: {result}{of}'
