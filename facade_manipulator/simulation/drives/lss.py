"""
The layer setting services of a simulated drive: node id by LSS, with fastscan.

References
----------
CiA 305, Layer setting services and protocols: switch state, configure, store, identify, fastscan.

"""

from __future__ import annotations

from collections.abc import Callable
import struct

from canopen import lss

UNCONFIGURED = 255
_FULL_CHECK, _RESET_SCAN = 0, 0x80
_ANSWERED = b'\0'
_REJECTED = b'\x01'
_SELECTIONS = range(
    lss.CS_SWITCH_STATE_SELECTIVE_VENDOR_ID, lss.CS_SWITCH_STATE_SELECTIVE_SERIAL_NUMBER + 1)
_NUMBER = struct.Struct('<xI')
_SCAN = struct.Struct('<xIBBB')


class LssSlave:
    """
    Node id of a drive, 255 for none, as a master of LSS sets it.

    `identity` returns vendor, product code, revision and serial number.
    """

    def __init__(self, node_id: int, identity: Callable[[], tuple[int, ...]]) -> None:
        self.stored = node_id  #: the node id after the next power-up
        self._identity = identity
        self.power_up()

    def power_up(self) -> None:
        """Forget what was not stored."""
        self.pending = self.stored  #: the node id after the next reset
        self.is_selected = False  #: whether it is in the LSS configuration state
        self._matched = self._scanned = 0

    def receive(self, data: bytes, active: int) -> bytes | None:
        """Take a request; return the answer, None for none. `active` is the present node id."""
        if len(data) != 8:
            return None
        command = data[0]
        if command == lss.CS_SWITCH_STATE_GLOBAL:
            self.is_selected = data[1] == lss.LssMaster.CONFIGURATION_STATE
        elif command == lss.CS_FAST_SCAN:
            return self._scan(data) if active == UNCONFIGURED and not self.is_selected else None
        elif command == lss.CS_IDENTIFY_NON_CONFIGURED_REMOTE_SLAVE and active == UNCONFIGURED:
            return _message(lss.CS_IDENTIFY_NON_CONFIGURED_SLAVE)
        elif command in _SELECTIONS:
            return self._select(_SELECTIONS.index(command), data)
        elif self.is_selected:
            return self._configure(command, data)
        return None

    def _select(self, part: int, data: bytes) -> bytes | None:
        """Become selected by four numbers that come one after the other."""
        matches = part == self._matched and _NUMBER.unpack_from(data)[0] == self._identity()[part]
        self._matched = (part + 1) % 4 if matches else 0
        if not matches or part < 3:
            return None
        self.is_selected = True
        return _message(lss.CS_SWITCH_STATE_SELECTIVE_RESPONSE)

    def _scan(self, data: bytes) -> bytes | None:
        number, bit, part, following = _SCAN.unpack(data)
        if bit == _RESET_SCAN:
            self._scanned = 0
            return _message(lss.CS_IDENTIFY_SLAVE)
        if part != self._scanned or bit > 31 or (number ^ self._identity()[part]) >> bit:
            return None
        if bit == _FULL_CHECK and following != part:
            self._scanned = following
            self.is_selected = following < part
        return _message(lss.CS_IDENTIFY_SLAVE)

    def _configure(self, command: int, data: bytes) -> bytes | None:
        if command == lss.CS_CONFIGURE_NODE_ID:
            if not (1 <= data[1] <= 127 or data[1] == UNCONFIGURED):
                return _message(command, _REJECTED)
            self.pending = data[1]
            return _message(command, _ANSWERED)
        if command == lss.CS_STORE_CONFIGURATION:
            self.stored = self.pending
            return _message(command, _ANSWERED)
        return None


def _message(command: int, content: bytes = b'') -> bytes:
    return (bytes([command]) + content).ljust(8, b'\0')
