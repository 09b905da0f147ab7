"""
Command `assign`: node ids by LSS, for all drives (fastscan) or for one that is alone.

References
----------
CiA 305, Layer setting services and protocols.

"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
import time
from typing import Any

from canopen.lss import LssError, LssMaster

from facade_manipulator.canopen.nmt import NmtCommand
from facade_manipulator.drives.axis_settings import AXIS_NAMES
from facade_manipulator.drives.profile import fitting_profile
from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning.bus import (
    BOOT_TIMEOUT,
    NODE_IDS,
    number_or_none,
    stating,
    ToolBus,
)
from facade_manipulator.tools.commissioning.context import Context
from facade_manipulator.tools.commissioning.scan import (
    fast_scanned,
    Found,
    has_unconfigured,
    is_drive,
    scan,
    SERIAL,
)

UNCONFIGURED = 255
STORING_TIME = 3.0  # s; CiA 305 has no bound; 0.3 s and more were seen
_NO_LSS = (
    "no drive answers LSS (CiA 305): set the node id in the maker's tool (or by the switches on "
    'the drive), one drive at a time, store it there, switch the power off and on, and scan')


def add_commands(add: Callable[..., Any]) -> None:
    """Add the command to the tool."""
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


def run_assign(context: Context) -> None:
    """Give node ids, store them, and write ids and serial numbers into the parameter file."""
    assign(context, lambda found: _axis_of(found, context), context.options.only)


def assign(context: Context, axis_of: Callable[[Found], str], only: str | None = None) -> None:
    """Give node ids to all drives, or to one that is alone; write them down."""
    machine, operator = context.machine, context.operator
    machine.check_writable()
    node_ids = {name: axis.node_id for name, axis in machine.axes.items()}
    with context.bus() as bus:
        if only:
            _require_alone(bus)
            node_ids = {only: node_ids[only]}
        operator.agree(
            'All drives on this bus that know LSS lose their node id; each gets the one of its '
            'carriage (' + ', '.join(f'{name}: {node_id}' for name, node_id in node_ids.items())
            + ') and stores it. Nothing moves.')
        given = assign_all(
            Assignment(bus, context.options.lss_timeout, bool(only)), node_ids,
            (lambda found: only) if only else axis_of)
    machine.write({
        name: {'node_id': node_ids[name], 'serial_number': found.serial_number,
               'profile': _profile(context, name, found)}
        for name, found in given.items()})
    for name, found in given.items():
        operator.say(f'{name}: node {node_ids[name]}, serial number {found.serial_number}')
    operator.say(f'{machine.path} is written.')


def _profile(context: Context, name: str, found: Found) -> str:
    """Return the profile that fits a drive; one of the user's own stays."""
    present = context.machine.axis(name).profile
    return present if present.endswith('.yaml') else fitting_profile(
        found.vendor_id, found.product_code)


def _require_alone(bus: ToolBus) -> None:
    nodes = scan(bus)
    if len(nodes) > 1 or any(len(node.serials) != 1 for node in nodes):
        raise CommissioningError(
            '--only wants one drive alone on the bus, found '
            f'{sum(max(1, len(node.serials)) for node in nodes)}: nothing was done; unplug the '
            'others')
    if nodes and not is_drive(nodes[0].device_type):
        raise CommissioningError(f'node {nodes[0].node_id} is not a drive (1000h): nothing was '
                                 'done')


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


class Assignment:
    """
    Node ids for the drives of a bus, each of which may take a time to answer [s].

    One that is alone on the bus needs neither fastscan nor selection.
    """

    def __init__(self, bus: ToolBus, timeout: float, is_alone: bool = False) -> None:
        self._bus = bus
        self._lss = bus.lss(timeout)
        self._is_alone = is_alone

    def find(self, spare: Iterator[int]) -> Iterator[Found]:
        """
        Take all node ids, and yield the drives one after the other, each under a spare one.

        Nothing is stored. Raises a CommissioningError if none knows LSS, for one whose identity
        is not found, or that takes no node id.
        """
        self._lss.send_switch_state_global(LssMaster.CONFIGURATION_STATE)
        self._configure(UNCONFIGURED)
        self._take_effect()
        time.sleep(0.5)
        if self._is_alone:
            self._lss.send_switch_state_global(LssMaster.CONFIGURATION_STATE)
            node_id = next(spare)
            if is_drive(self._lend(node_id)):
                drive = self._bus.objects(node_id)
                yield Found(*(drive.read_number(0x1018, number) for number in range(1, 5)))
            return
        seen: set[Found] = set()
        while one := next((one for one in fast_scanned(self._lss) if one not in seen), None):
            seen.add(one)
            self._select(one)
            if is_drive(self._lend(next(spare))):
                yield one
        is_left = has_unconfigured(self._bus)
        self._lss.send_switch_state_global(LssMaster.WAITING_STATE)
        if is_left:
            raise CommissioningError(
                'a node without a node id answers, but its identity is not found: repeat with '
                '--lss-timeout 0.5, or connect it alone and use --only')

    def _select(self, found: Found) -> None:
        """Let nobody but one node be configured; raises a CommissioningError if it is silent."""
        self._lss.send_switch_state_global(
            LssMaster.CONFIGURATION_STATE if self._is_alone else LssMaster.WAITING_STATE)
        try:
            if self._is_alone or self._lss.send_switch_state_selective(*found):
                return
        except LssError:
            pass
        raise CommissioningError(f'the drive {found.serial_number} does not answer any more: '
                                 'nothing is stored in it')

    def _lend(self, node_id: int) -> int | None:
        """Give the selected node an id that is not stored; return its device type (1000h)."""
        self._configure(node_id)
        self._take_effect()
        return self._number(node_id, 0x1000)

    def _number(self, node_id: int, *key: int) -> int | None:
        """Return a number of a node that comes up; None if it does not."""
        drive, found = self._bus.objects(node_id), None
        end = time.monotonic() + BOOT_TIMEOUT
        while found is None and time.monotonic() < end:
            found = number_or_none(drive, *key)
        return found

    def give(self, node_id: int, found: Found) -> None:
        """
        Give a drive a node id, store it, and see that it is stored.

        Raises a CommissioningError if it is not; the message says in what state the drive is.
        """
        self._select(found)
        self._configure(node_id)
        timeout = self._lss.RESPONSE_TIMEOUT
        self._lss.RESPONSE_TIMEOUT = max(timeout, STORING_TIME)
        try:
            self._lss.store_configuration()
        except LssError as error:
            raise CommissioningError(
                f'the drive took node id {node_id} but did not store it ({error}): it has its old '
                'one again after its power was off and on; do that, then assign again') from error
        finally:
            self._lss.RESPONSE_TIMEOUT = timeout
        self._take_effect()
        self._verify(node_id, found.serial_number)

    def _take_effect(self) -> None:
        """End the configuration of all; some take their node id only when they are reset."""
        self._lss.send_switch_state_global(LssMaster.WAITING_STATE)
        self._bus.command(NmtCommand.RESET_COMMUNICATION)

    def _configure(self, node_id: int) -> None:
        try:
            self._lss.configure_node_id(node_id)
        except LssError as error:
            if str(error).startswith('No LSS'):
                raise CommissioningError(_NO_LSS) from error
            raise CommissioningError(
                f'a drive rejects node id {node_id} ({error}): nothing is stored; it has its old '
                'one again after its power was off and on') from error

    def _verify(self, node_id: int, serial_number: int) -> None:
        """Reset a drive and read what it has stored; a CommissioningError if it is elsewhere."""
        for command, what in ((NmtCommand.RESET_COMMUNICATION, 'before'),
                              (NmtCommand.RESET_NODE, 'after')):
            self._bus.command(command, node_id)
            if (serial := self._number(node_id, *SERIAL)) != serial_number:
                who = 'no drive' if serial is None else f'the drive {serial}'
                raise CommissioningError(
                    f'{who} answers as node {node_id} instead of {serial_number} {what} a reset: '
                    'switch its power off and on, then scan')


def assign_all(
    assignment: Assignment, node_ids: dict[str, int], axis_of: Callable[[Found], str]
) -> dict[str, Found]:
    """
    Give all drives on the bus their node ids by axis; return which drive is which axis.

    `axis_of` says which axis a drive moves, empty for none; what is not a drive is not asked for.
    Each node gets an id that is not stored first, so that none answers for another. Raises a
    CommissioningError with the state in which the drives are.
    """
    given: dict[str, Found] = {}
    spare = (number for number in reversed(NODE_IDS) if number not in node_ids.values())
    with stating(lambda: _state(given, node_ids)):
        for found in assignment.find(spare):
            axis = axis_of(found)
            if axis in given:
                raise CommissioningError(f'two drives for {axis}')
            if axis:
                assignment.give(node_ids[axis], found)
                given[axis] = found
    missing = node_ids.keys() - given.keys()
    if missing:
        raise CommissioningError(
            f'no drive was found for {", ".join(sorted(missing))} (fastscan). '
            f'{_state(given, node_ids)}. A drive that knows LSS but no fastscan: connect it alone '
            'and use --only')
    return given


def _state(given: dict[str, Found], node_ids: dict[str, int]) -> str:
    done = ', '.join(f'{axis} is node {node_ids[axis]} (serial number {found.serial_number})'
                     for axis, found in given.items()) or 'No drive has stored a new node id'
    return f'{done}; the others have their old ones again after their power was off and on'
