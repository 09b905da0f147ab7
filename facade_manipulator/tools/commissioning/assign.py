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
from facade_manipulator.tools.commissioning.bus import BOOT_TIMEOUT, number_or_none, ToolBus

UNCONFIGURED = 255
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
        self._lss.send_switch_state_global(LssMaster.WAITING_STATE)
        self._bus.command(NmtCommand.RESET_COMMUNICATION)
        time.sleep(0.5)

    def find(self) -> Iterator[Found]:
        """Yield the drives that have no node id, one after the other; each is then selected."""
        while True:
            found, identity = self._lss.fast_scan()
            if not found:
                return
            yield Found(*identity)

    def give(self, node_id: int) -> None:
        """
        Give the selected drive a node id, store it, and let the drive come up.

        Raises a CommissioningError if it does not; the message says in what state it is.
        """
        self._configure(node_id)
        try:
            self._lss.store_configuration()
        except LssError as error:
            raise CommissioningError(
                f'the drive took node id {node_id} but did not store it ({error}): it has its old '
                'one again after its power was off and on; do that, then assign again') from error
        self._lss.send_switch_state_global(LssMaster.WAITING_STATE)

    def give_alone(self, node_id: int) -> None:
        """Give a node id to the one drive on the bus; raises what `give` does."""
        self._lss.send_switch_state_global(LssMaster.CONFIGURATION_STATE)
        self.give(node_id)
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
        """Wait for a drive's new node id; a CommissioningError if another has it, or none."""
        drive = self._bus.objects(node_id)
        end = time.monotonic() + BOOT_TIMEOUT
        while (serial := number_or_none(drive, 0x1018, 4)) is None and time.monotonic() < end:
            time.sleep(0.05)
        if serial != serial_number:
            what = 'no drive' if serial is None else f'the drive {serial}'
            raise CommissioningError(
                f'{what} answers as node {node_id} instead of {serial_number}: the node id is '
                'stored; switch its power off and on, then scan')


def assign_all(
    assignment: Assignment, node_ids: dict[str, int], axis_of: Callable[[Found], str]
) -> dict[str, Found]:
    """
    Give all drives on the bus their node ids by axis; return which drive is which axis.

    `axis_of` says which axis a drive moves, empty for none. Raises a CommissioningError with the
    state in which the drives are.
    """
    assignment.take_all()
    given: dict[str, Found] = {}
    try:
        for found in assignment.find():
            axis = axis_of(found)
            if axis in given:
                raise CommissioningError(f'two drives for {axis}')
            if axis:
                assignment.give(node_ids[axis])
                assignment.verify(node_ids[axis], found.serial_number)
                given[axis] = found
    except CommissioningError as error:
        raise CommissioningError(f'{error}. {_state(given, node_ids)}') from error
    missing = node_ids.keys() - given.keys()
    if missing:
        raise CommissioningError(
            f'no drive was found for {", ".join(sorted(missing))} (fastscan). '
            f'{_state(given, node_ids)}. A drive that knows LSS but no fastscan: connect it alone '
            'and use --only')
    return given


def _state(given: dict[str, Found], node_ids: dict[str, int]) -> str:
    done = ', '.join(f'{axis} is node {node_ids[axis]} (serial number {found.serial_number})'
                     for axis, found in given.items()) or 'No drive has a new node id'
    return f'{done}; the others have their old ones again after their power was off and on'
