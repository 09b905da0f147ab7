"""
Give node ids by LSS: one drive alone, or all of them by fastscan.

References
----------
CiA 305, Layer setting services and protocols.

"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import time
from typing import NamedTuple

from canopen.lss import LssError, LssMaster

from facade_manipulator.drives.canopen import NmtCommand
from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning.bus import (
    BOOT_TIMEOUT,
    NODE_IDS,
    number_or_none,
    ToolBus,
)
from facade_manipulator.tools.commissioning.scan import has_unconfigured, is_drive, SERIAL

UNCONFIGURED = 255
STORING_TIME = 3.0  # s; CiA 305 has no bound; 0.3 s and more were seen
_NO_LSS = (
    "no drive answers LSS (CiA 305): set the node id in the maker's tool (or by the switches on "
    'the drive), one drive at a time, store it there, switch the power off and on, and scan')


class Found(NamedTuple):
    """The identity by which LSS knows a drive."""

    vendor_id: int
    product_code: int
    revision_number: int
    serial_number: int


class Assignment:
    """Node ids for the drives of a bus; `timeout` is for a drive's answer to a request [s]."""

    def __init__(self, bus: ToolBus, timeout: float) -> None:
        self._bus = bus
        self._lss = bus.lss(timeout)

    def take_all(self) -> None:
        """Take all node ids, without storing that; a CommissioningError if none knows LSS."""
        self._lss.send_switch_state_global(LssMaster.CONFIGURATION_STATE)
        self._configure(UNCONFIGURED)
        self._take_effect()
        time.sleep(0.5)

    def find(self) -> Iterator[Found]:
        """
        Yield the nodes that have no node id, one after the other; each is then selected.

        Raises a CommissioningError for one whose identity is not found, or that takes no node id.
        """
        seen: set[Found] = set()
        while True:
            self._lss.send_switch_state_global(LssMaster.WAITING_STATE)
            found, identity = self._lss.fast_scan()
            if not found:
                break
            if (one := Found(*identity)) in seen:
                raise CommissioningError(f'the node with serial number {one.serial_number} took a '
                                         'node id and is without one again')
            seen.add(one)
            yield one
        if has_unconfigured(self._bus):
            raise CommissioningError(
                'a node without a node id answers, but its identity is not found: repeat with '
                '--lss-timeout 0.5, or connect it alone and use --only')

    def lend(self, node_id: int) -> int | None:
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
        try:
            is_selected = self._lss.send_switch_state_selective(*found)
        except LssError:
            is_selected = False
        if not is_selected:
            raise CommissioningError(f'the drive {found.serial_number} does not answer any more: '
                                     'nothing is stored in it')
        self._give_selected(node_id)
        self.verify(node_id, found.serial_number)

    def give_alone(self, node_id: int) -> None:
        """Give a node id to the one drive on the bus; raises what `give` does."""
        self._lss.send_switch_state_global(LssMaster.CONFIGURATION_STATE)
        self._give_selected(node_id)

    def _give_selected(self, node_id: int) -> None:
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

    def verify(self, node_id: int, serial_number: int) -> None:
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
    try:
        assignment.take_all()
        for found in assignment.find():
            if not is_drive(assignment.lend(next(spare))):
                continue
            axis = axis_of(found)
            if axis in given:
                raise CommissioningError(f'two drives for {axis}')
            if axis:
                assignment.give(node_ids[axis], found)
                given[axis] = found
    except (CommissioningError, KeyboardInterrupt) as error:
        cause = str(error) or 'stopped by Ctrl-C'
        raise CommissioningError(f'{cause}. {_state(given, node_ids)}') from error
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
