"""
Layer setting services of a simulated drive: node id by LSS, with fastscan.

The library implements only the master of these services.

References
----------
CiA 305, Layer setting services and protocols: switch state, configure, store, identify, fastscan.

"""

from __future__ import annotations

from collections.abc import Mapping
import struct

from canopen import lss

from facade_manipulator.canopen import indices
from facade_manipulator.simulation.drives.objects import Key

UNCONFIGURED = 255
_FULL_CHECK, _RESET_SCAN = 0, 0x80
_SELECTIONS = range(
    lss.CS_SWITCH_STATE_SELECTIVE_VENDOR_ID,
    lss.CS_SWITCH_STATE_SELECTIVE_SERIAL_NUMBER + 1,
)


class LssSlave:
    """
    Node id of a drive, set by an LSS master; 255 means no node id.

    `values` contains the identity object 1018: vendor, product code, revision and serial number.
    """

    def __init__(self, node_id: int, values: Mapping[Key, int]) -> None:
        self.stored = node_id  #: the node id after the next power-up
        self._values = values
        self.power_up()

    def power_up(self) -> None:
        """Restore the stored node id."""
        self.pending = self.stored  #: the node id after the next reset
        self.is_selected = False  #: whether the drive is in the LSS configuration state
        self._matched = self._scanned = 0

    def receive(self, data: bytes, active: int) -> bytes | None:
        """Process a request; return the answer or None. `active` is the present node id."""
        command, is_new, answer = data[0], active == UNCONFIGURED, None
        if command == lss.CS_SWITCH_STATE_GLOBAL:
            self.is_selected = data[1] == lss.LssMaster.CONFIGURATION_STATE
        elif command == lss.CS_FAST_SCAN and is_new and not self.is_selected:
            answer = self._scan(data)
        elif command in _SELECTIONS:
            answer = self._select(_SELECTIONS.index(command), data)
        elif command == lss.CS_CONFIGURE_NODE_ID and self.is_selected:
            self.pending, answer = data[1], [command]
        elif command == lss.CS_STORE_CONFIGURATION and self.is_selected:
            self.stored, answer = self.pending, [command]
        return None if answer is None else bytes(answer).ljust(8, b'\0')

    def _select(self, part: int, data: bytes) -> list[int] | None:
        """Select the drive by four numbers in successive requests."""
        (number,) = struct.unpack_from('<xI', data)
        matches = (
            part == self._matched and number == self._values[indices.IDENTITY, part + 1]
        )
        self._matched = (part + 1) % 4 if matches else 0
        is_complete = matches and part == 3
        self.is_selected |= is_complete
        return [lss.CS_SWITCH_STATE_SELECTIVE_RESPONSE] if is_complete else None

    def _scan(self, data: bytes) -> list[int] | None:
        number, bit, part, following = struct.unpack('<xIBBB', data)
        if bit == _RESET_SCAN:
            self._scanned = 0
        elif (
            part != self._scanned
            or bit > 31
            or (number ^ self._values[indices.IDENTITY, part + 1]) >> bit
        ):
            return None
        elif bit == _FULL_CHECK and following != part:
            self._scanned = following
            self.is_selected = following < part
        return [lss.CS_IDENTIFY_SLAVE]
