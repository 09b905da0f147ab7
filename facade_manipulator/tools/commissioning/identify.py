"""Commands `scan` and `assign`: who is on the bus, and which carriage each drive moves."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from facade_manipulator.drives.cia402 import AXIS_NAMES, fitting_profile
from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning.assign import assign_all, Assignment, Found
from facade_manipulator.tools.commissioning.bitrate import guess_bitrate
from facade_manipulator.tools.commissioning.bus import BOOT_TIMEOUT, ToolBus
from facade_manipulator.tools.commissioning.context import Context
from facade_manipulator.tools.commissioning.scan import (
    findings,
    has_unconfigured,
    is_drive,
    Node,
    scan,
)

_COLUMNS = ('node', 'serial', 'name', 'firmware', 'vendor', 'product', 'state', 'profile')


def add_commands(add: Callable) -> None:
    """Add the commands to the tool."""
    command = add('scan', run_scan, 'Who is on the bus.')
    command.add_argument('--guess-bitrate', action='store_true',
                         help='where nothing answers, try the usual bit rates (needs root)')
    command = add('assign', run_assign, 'Give each drive the node id of its carriage, by LSS.')
    command.add_argument(
        '--serials', type=lambda text: int(text, 0), nargs=len(AXIS_NAMES), metavar=AXIS_NAMES,
        help='serial numbers, on the labels, of the drives of q1, q2 and q3; default: asked for')
    command.add_argument('--only', choices=AXIS_NAMES,
                         help='there is one drive alone on the bus, and it moves this carriage')
    add_lss_timeout(command)


def add_lss_timeout(command: argparse.ArgumentParser) -> None:
    """Add what every command that gives node ids has."""
    command.add_argument('--lss-timeout', type=float, default=0.1, metavar='S',
                         help='how long a drive may take to answer (default 0.1)')


def run_scan(context: Context) -> int:
    """List the nodes; return 1 if something is not as it should be."""
    expected = {name: axis.node_id for name, axis in context.machine.axes.items()}
    with context.bus() as bus:
        nodes, unconfigured = scan(bus), has_unconfigured(bus)
        problems = list(findings(nodes, expected, unconfigured))
    operator = context.operator
    operator.table(_COLUMNS, [_row(node) for node in nodes])
    for node in nodes:
        if node.errors:
            operator.say(f'node {node.node_id} has had the errors (newest first) '
                         + ', '.join(f'{code:04X}h' for code in node.errors))
    for problem in problems:
        operator.say(f'! {problem}')
    if not nodes and not unconfigured:
        guess_bitrate(bus.settings, operator, may_change=context.options.guess_bitrate)
    context.machine.note('scan', '; '.join(problems) or f'{len(nodes)} drives', not problems)
    return 1 if problems else 0


def _row(node: Node) -> tuple:
    serials = ', '.join(str(serial) for serial in node.serials) or 'no answer'
    return (node.node_id, serials, node.name, node.firmware, _hex(node.vendor_id),
            _hex(node.product_code), node.state, node.profile)


def _hex(number: int | None) -> str:
    return '' if number is None else f'{number:X}h'


def run_assign(context: Context) -> None:
    """Give node ids, store them, and write ids and serial numbers into the parameter file."""
    assign(context, lambda found: _axis_of(found, context), context.options.only)


def assign(context: Context, axis_of: Callable[[Found], str], only: str | None = None) -> None:
    """Give node ids to all drives, or to one that is alone; write them down."""
    machine, operator = context.machine, context.operator
    machine.check_writable()
    node_ids = {name: axis.node_id for name, axis in machine.axes.items()}
    with context.bus() as bus:
        assignment = Assignment(bus, context.options.lss_timeout)
        if only:
            given = _assign_one(assignment, context, bus, node_ids)
        else:
            operator.agree(
                'All drives on this bus that know LSS lose their node id; each gets the one of '
                'its carriage (' + ', '.join(f'{name}: {node_id}' for name, node_id
                                            in node_ids.items()) + ') and stores it. Nothing '
                'moves.')
            given = assign_all(assignment, node_ids, axis_of)
    machine.write({
        name: {'node_id': node_ids[name], 'serial_number': found.serial_number,
               'profile': _profile(context, name, found)}
        for name, found in given.items()})
    for name, found in given.items():
        operator.say(f'{name}: node {node_ids[name]}, serial number {found.serial_number}')
        machine.note('assign', f'node {node_ids[name]}, serial number {found.serial_number}',
                     axis=name)
    operator.say(f'{machine.path} is written.')


def _profile(context: Context, name: str, found: Found) -> str:
    """Return the profile that fits a drive; one of the user's own stays."""
    present = context.machine.axis(name).profile
    return present if present.endswith('.yaml') else fitting_profile(found.vendor_id)


def _assign_one(
    assignment: Assignment, context: Context, bus: ToolBus, node_ids: dict[str, int]
) -> dict[str, Found]:
    name = context.options.only
    nodes = scan(bus)
    if len(nodes) > 1 or any(len(node.serials) != 1 for node in nodes):
        raise CommissioningError(
            '--only wants one drive alone on the bus, found '
            f'{sum(max(1, len(node.serials)) for node in nodes)}: nothing was done; unplug the '
            'others')
    if nodes and not is_drive(nodes[0].device_type):
        raise CommissioningError(f'node {nodes[0].node_id} is not a drive (1000h): nothing was '
                                 'done')
    context.operator.agree(
        f'The one drive on this bus becomes node {node_ids[name]} ({name}) and stores it.')
    assignment.give_alone(node_ids[name])
    drive = bus.objects(node_ids[name])
    bus.wait_for(lambda: 0x700 + node_ids[name] in bus.latest, BOOT_TIMEOUT)
    found = Found(*(drive.read_number(0x1018, n) for n in range(1, 5)))
    assignment.verify(node_ids[name], found.serial_number)
    return {name: found}


def _axis_of(found: Found, context: Context) -> str:
    serials = context.options.serials
    if serials:
        return dict(zip(serials, AXIS_NAMES, strict=True)).get(found.serial_number, '')
    answer = context.operator.ask(
        f'Drive with serial number {found.serial_number} (product {found.product_code:X}h): which '
        f'carriage does it move? [{"/".join(AXIS_NAMES)}, or nothing]', '--serials')
    if answer and answer not in AXIS_NAMES:
        raise CommissioningError(f'{answer} is not one of {", ".join(AXIS_NAMES)}')
    return answer
