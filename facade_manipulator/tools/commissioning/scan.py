"""Who is on the bus: nodes that answer, nodes that only beat, drives without a node id."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
import struct
import time
from typing import NamedTuple

from canopen import lss

from facade_manipulator.drives.canopen import Frame, pdo, SDO_FRAME_LENGTH, SdoChannel
from facade_manipulator.drives.cia402 import AxisSettings, fitting_profile
from facade_manipulator.errors import DriveError, DriveIdentityError
from facade_manipulator.tools.commissioning.bus import NODE_IDS, number_or_none, ToolBus

_PACE = 0.002  # s between requests: a send queue of ten frames does not fill up
_ANSWER = 0.25  # s
_UPLOAD, _ANSWERED = 0x40, b'\x43'
_REQUEST = struct.Struct('<BHB4x')
SERIAL = (0x1018, 4)
DRIVE_TYPE = 402
_ALL = 0x80  # asks every node without a node id for an answer to fastscan
_WITHOUT_ID = bytes([lss.CS_IDENTIFY_NON_CONFIGURED_SLAVE]), bytes([lss.CS_IDENTIFY_SLAVE])


class Node(NamedTuple):
    """
    What a scan found at a node id.

    `serials` has one serial number per answer: more than one is more than one drive. Numbers are
    None and texts empty where the node did not answer.
    """

    node_id: int
    serials: tuple[int, ...]
    state: str = ''
    name: str = ''
    firmware: str = ''
    device_type: int | None = None
    vendor_id: int | None = None
    product_code: int | None = None
    errors: tuple[int, ...] = ()  #: error history (1003h), newest first

    @property
    def profile(self) -> str:
        """The drive type that fits; empty for none."""
        return fitting_profile(self.vendor_id) if is_drive(self.device_type) else ''


def is_drive(device_type: int | None) -> bool:
    """Return whether a device type (1000h) is that of a drive, and not of an I/O module."""
    return device_type is not None and device_type & 0xFFFF == DRIVE_TYPE


def scan(bus: ToolBus) -> list[Node]:
    """Ask all node ids at once, then each that answered for what it is."""
    answers = defaultdict(list)
    for frame in _ask(bus, NODE_IDS):
        if pdo.sdo_response_cob_id(0) < frame.cob_id <= pdo.sdo_response_cob_id(127):
            answers[frame.cob_id - pdo.sdo_response_cob_id(0)].append(_serial(frame.data))
    beating = {node_id for node_id in NODE_IDS if pdo.heartbeat_cob_id(node_id) in bus.latest}
    return [_describe(bus, node_id, tuple(answers.get(node_id, ())))
            for node_id in sorted(answers.keys() | beating)]


def _ask(bus: ToolBus, node_ids: Iterable[int]) -> list[Frame]:
    """Ask for serial numbers; return what comes then."""
    def ask() -> None:
        for node_id in node_ids:
            bus.frames.send(pdo.sdo_request_cob_id(node_id), _REQUEST.pack(_UPLOAD, *SERIAL))
            time.sleep(_PACE)

    return bus.collect(_ANSWER, ask)


def _serial(data: bytes) -> int:
    """Return the serial number of an answer, 0 for a drive that has none."""
    is_number = len(data) == SDO_FRAME_LENGTH and data.startswith(_ANSWERED)
    return int.from_bytes(data[4:], 'little') if is_number else 0


def _describe(bus: ToolBus, node_id: int, serials: tuple[int, ...]) -> Node:
    beat = bus.nmt_state(node_id)
    state = '' if beat is None else beat.name.lower().replace('_', '-')
    if len(serials) != 1:
        return Node(node_id, serials, state)
    drive = bus.objects(node_id)
    return Node(node_id, serials, state, _text(drive, 0x1008), _text(drive, 0x100A),
                number_or_none(drive, 0x1000), number_or_none(drive, 0x1018, 1),
                number_or_none(drive, 0x1018, 2), tuple(_errors(drive)))


def _errors(drive: SdoChannel) -> Iterator[int]:
    for subindex in range(1, (number_or_none(drive, 0x1003) or 0) + 1):
        if error := number_or_none(drive, 0x1003, subindex):
            yield error & 0xFFFF  # above it is what the maker adds


def _text(drive: SdoChannel, index: int) -> str:
    try:
        return drive.read(index, 0).decode('latin-1').strip('\0 ')
    except DriveError:
        return ''


def has_unconfigured(bus: ToolBus) -> bool:
    """Return whether a node without a node id answers; some know fastscan alone."""
    questions = (bytes([lss.CS_IDENTIFY_NON_CONFIGURED_REMOTE_SLAVE]).ljust(8, b'\0'),
                 bytes([lss.CS_FAST_SCAN, 0, 0, 0, 0, _ALL, 0, 0]))

    def ask() -> None:
        for question in questions:
            bus.frames.send(lss.LssMaster.LSS_TX_COBID, question)

    return any(frame.cob_id == lss.LssMaster.LSS_RX_COBID and frame.data[:1] in _WITHOUT_ID
               for frame in bus.collect(_ANSWER, ask))


def findings(nodes: list[Node], expected: dict[str, int], unconfigured: bool) -> Iterator[str]:
    """Yield what is wrong with what a scan found; nothing where all is as expected."""
    is_mixed = unconfigured or any(len(node.serials) > 1 for node in nodes)
    remedy = 'commission assign' if is_mixed else 'check its power, its plug, its node id'
    for node in nodes:
        if len(node.serials) > 1:
            serials = ', '.join(str(serial) for serial in sorted(set(node.serials)))
            yield (f'{len(node.serials)} drives have node id {node.node_id} (serial numbers '
                   f'{serials}): commission assign')
        elif not node.serials:
            yield (f'node {node.node_id} sends heartbeats but answers no SDO: it is stopped, '
                   'or no drive')
    if unconfigured:
        yield 'there is a drive without a node id: commission assign'
    for name, node_id in expected.items():
        if node_id not in {node.node_id for node in nodes}:
            yield f'{name} (node {node_id} in the parameter file) is silent: {remedy}'


def only_drive(
    bus: ToolBus, axis: AxisSettings, name: str, eds: Path | None = None
) -> SdoChannel:
    """Return the objects of an axis's drive; a DriveIdentityError if more than one answers."""
    node_id = axis.node_id
    answers = [frame for frame in _ask(bus, [node_id])
               if frame.cob_id == pdo.sdo_response_cob_id(node_id)]
    if len(answers) > 1:
        raise DriveIdentityError(
            f'{len(answers)} drives answer as {name} (node {node_id}): nothing was done; '
            'commission assign gives each its own node id')
    return bus.objects(node_id, name, eds)
