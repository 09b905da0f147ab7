"""
Layer setting services (LSS): assign node ids to drives identified by their 1018h entries.

The library implements the requests of a master. `LssTransport` sends the requests and receives the
answers; several slaves may answer one request. `LssSlave` is the counterpart in a simulated drive.

References
----------
CiA 305, Layer setting services and protocols: switch state, configure, store, identify, fastscan.

"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import struct
from typing import NamedTuple, Protocol

from canopen import lss
from canopen.lss import LssMaster

from facade_manipulator.canopen import cob_ids, indices
from facade_manipulator.canopen.bus import CanBus, Frame

UNCONFIGURED = 255  # node id of a node without a node id
REQUEST_PACE = 0.002  # s between requests: a send queue of ten frames does not fill up
_FRAME_LENGTH = 8


class Identity(NamedTuple):
    """Identity (1018h) by which a master selects a slave."""

    vendor_id: int
    product_code: int
    revision_number: int
    serial_number: int


# --- master


class WaitingBus(Protocol):
    """Bus of a master that receives frames while waiting."""

    frames: CanBus
    receivers: dict[int, Callable[[Frame], None]]  #: by COB-ID
    monotonic: Callable[[], float]

    def wait(self, seconds: float) -> None:
        """Receive frames for a time [s]."""

    def wait_for(self, condition: Callable[[], object], timeout: float) -> bool:
        """Receive frames until a condition holds or a timeout [s] expires; return the result."""


class LssTransport:
    """
    Transport of LSS frames for a master; it matches each answer to its request.

    An answer to fastscan does not repeat its question, and several slaves answer at different
    times. Therefore the transport listens after an answer for as long as the slowest slave has
    needed. The transport repeats a question after silence, because a slave may have answered late
    once.
    """

    STORING_TIME = 3.0  # s; CiA 305 has no limit; drives needed more than 0.3 s
    _CONFIRMING_TIME = 0.5  # s, for the answer to a command that is not part of a scan
    _SCAN_ATTEMPTS = 2  # questions of fastscan before silence is an answer
    _LATENCY_MARGIN = 1.5  # times the slowest answer: wait for late answers
    # command specifiers of the answers that differ from those of the requests
    _ANSWERS = {
        lss.CS_FAST_SCAN: lss.CS_IDENTIFY_SLAVE,
        lss.CS_SWITCH_STATE_SELECTIVE_SERIAL_NUMBER: lss.CS_SWITCH_STATE_SELECTIVE_RESPONSE,
    }

    def __init__(self, bus: WaitingBus, master: LssMaster, timeout: float) -> None:
        self._bus = bus
        self._master = master
        self._timeout = timeout
        # longest time from a question to an answer to fastscan [s], None before the first
        self._slowest: float | None = None
        self._asked_at = 0.0  # time of the first attempt of a question [s]
        self._sent_at = 0.0  # time of its last attempt [s]
        self._expected: int | None = None  # command specifier of the answer
        bus.receivers[cob_ids.LSS_RESPONSE] = self._receive

    def send_message(self, cob_id: int, data: bytes) -> None:
        """Send a request and wait for its answer."""
        command = data[0]
        is_scan = command == lss.CS_FAST_SCAN
        is_first_scan = is_scan and self._slowest is None
        self._bus.wait(REQUEST_PACE)
        self._master.responses.queue.clear()
        self._expected = self._ANSWERS.get(command, command)
        self._asked_at = self._bus.monotonic()

        for _ in range(self._SCAN_ATTEMPTS if is_scan else 1):
            self._sent_at = self._bus.monotonic()
            self._bus.frames.send(cob_id, bytes(data))
            longest = self._longest_wait(command)
            if self._bus.wait_for(lambda: self._master.responses.queue, longest):
                break
        if is_scan and self._master.responses.queue:
            self._await_other_answers(is_first_scan)

    def _longest_wait(self, command: int) -> float:
        """Return the maximum time to wait for the answer to a command [s]."""
        if command == lss.CS_STORE_CONFIGURATION:
            return self.STORING_TIME
        if command == lss.CS_FAST_SCAN:
            return max(self._timeout, self._LATENCY_MARGIN * (self._slowest or 0.0))
        if command in lss.ListMessageNeedResponse:
            return max(self._timeout, self._CONFIRMING_TIME)
        return self._timeout

    def _await_other_answers(self, is_first_scan: bool) -> None:
        """Wait until the slower slaves have also answered."""
        longest = self._LATENCY_MARGIN * (self._slowest or 0.0)
        if is_first_scan:
            longest = max(longest, 2.0 * self._timeout)
        end = self._sent_at + longest
        self._bus.wait(max(0.0, end - self._bus.monotonic()))

    def _receive(self, frame: Frame) -> None:
        """Store an expected answer, and measure the latency of the slave."""
        if not frame.data or frame.data[0] != self._expected:
            return
        if self._expected == lss.CS_IDENTIFY_SLAVE:
            latency = self._bus.monotonic() - self._asked_at
            self._slowest = max(self._slowest or 0.0, latency)
        if not self._master.responses.queue:
            self._master.responses.put(frame.data.ljust(_FRAME_LENGTH, b'\0'))


def lss_master(bus: WaitingBus, timeout: float) -> LssMaster:
    """
    Return the LSS master of the library `canopen` with a timeout [s].

    The timeout limits the wait for the answer to each request.
    """
    master = LssMaster()
    master.RESPONSE_TIMEOUT = 0.0  # the answer has arrived by then
    master.network = LssTransport(bus, master, timeout)  # type: ignore[assignment]
    return master


def find_unknown_slave(
    master: LssMaster, is_known: Callable[[Identity], bool]
) -> Identity | None:
    """
    Return an unknown slave that answers fastscan, None if no such slave answers.

    Each slave found is selected. Most selected slaves no longer answer fastscan; a slave that
    answers again ends the search.
    """
    passed: set[Identity] = set()
    unknown = None
    master.send_switch_state_global(LssMaster.WAITING_STATE)
    while True:
        is_found, numbers = master.fast_scan()
        if not is_found:
            break
        identity = Identity(*numbers)
        if identity in passed:
            break
        if not is_known(identity):
            unknown = identity
            break
        passed.add(identity)
    master.send_switch_state_global(LssMaster.WAITING_STATE)
    return unknown


def set_node_id(
    master: LssMaster, node_id: int, slave: Identity | None, is_stored: bool
) -> None:
    """
    Set the node id of one slave; of all slaves if the slave is None.

    Raises the library's LssError if a slave does not accept or store the node id.
    """
    if slave is None:
        master.send_switch_state_global(LssMaster.CONFIGURATION_STATE)
    else:
        master.send_switch_state_global(LssMaster.WAITING_STATE)
        master.send_switch_state_selective(*slave)
    master.configure_node_id(node_id)
    if is_stored:
        master.store_configuration()
    master.send_switch_state_global(LssMaster.WAITING_STATE)


# --- slave


class LssSlave:
    """
    LSS slave of a simulated drive; node id 255 means that no id is assigned.

    `values` contains the objects of the drive; 1018h is the identity.
    """

    # requests that select a slave with the four numbers of its identity
    _SELECTIONS = range(
        lss.CS_SWITCH_STATE_SELECTIVE_VENDOR_ID,
        lss.CS_SWITCH_STATE_SELECTIVE_SERIAL_NUMBER + 1,
    )
    # values of a fastscan's field for the bit that are not the number of a bit
    _FULL_CHECK = 0
    _RESET_SCAN = 0x80

    def __init__(self, node_id: int, values: Mapping[tuple[int, int], int]) -> None:
        self.stored = node_id  #: the node id after the next power-up
        self._values = values
        self.power_up()

    def power_up(self) -> None:
        """Restore the stored node id."""
        self.pending = self.stored  #: the node id after the next reset
        self.is_selected = False  #: whether the drive is in the LSS configuration state
        # how many of the four numbers of the identity have matched
        self._matched = 0  # in a selection
        self._scanned = 0  # in a fastscan

    def receive(self, data: bytes, active: int) -> bytes | None:
        """Process a request; return the answer or None. `active` is the current node id."""
        command = data[0]
        answer = None
        if command == lss.CS_SWITCH_STATE_GLOBAL:
            self.is_selected = data[1] == LssMaster.CONFIGURATION_STATE
        elif command == lss.CS_FAST_SCAN:
            if active == UNCONFIGURED and not self.is_selected:
                answer = self._scan(data)
        elif command in self._SELECTIONS:
            answer = self._select(self._SELECTIONS.index(command), data)
        elif command == lss.CS_CONFIGURE_NODE_ID and self.is_selected:
            self.pending = data[1]
            answer = command
        elif command == lss.CS_STORE_CONFIGURATION and self.is_selected:
            self.stored = self.pending
            answer = command
        return None if answer is None else bytes([answer]).ljust(_FRAME_LENGTH, b'\0')

    def _number(self, part: int) -> int:
        """Return one number of the identity; part 0 is the vendor id."""
        return self._values[indices.IDENTITY, part + 1]

    def _select(self, part: int, data: bytes) -> int | None:
        """Select the drive by four numbers in successive requests; return the last answer."""
        (number,) = struct.unpack_from('<xI', data)
        if part != self._matched or number != self._number(part):
            self._matched = 0
            return None
        if part < len(self._SELECTIONS) - 1:
            self._matched = part + 1
            return None
        self._matched = 0
        self.is_selected = True
        return lss.CS_SWITCH_STATE_SELECTIVE_RESPONSE

    def _scan(self, data: bytes) -> int | None:
        """Compare the upper bits of one identity number with a request; return the answer."""
        number, bit, part, following = struct.unpack('<xIBBB', data)
        if bit == self._RESET_SCAN:
            self._scanned = 0
            return lss.CS_IDENTIFY_SLAVE
        if part != self._scanned or bit > 31:
            return None
        if (number ^ self._number(part)) >> bit:
            return None
        if bit == self._FULL_CHECK and following != part:
            self._scanned = following
            self.is_selected = following < part
        return lss.CS_IDENTIFY_SLAVE
