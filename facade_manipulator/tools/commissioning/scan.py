"""Command `scan`: nodes that answer, nodes that only beat, drives without a node id."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
import struct
import time
from typing import Any, NamedTuple

from canopen import lss

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.bus import Frame
from facade_manipulator.canopen.sdo import SDO_FRAME_LENGTH, SdoChannel
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.profile import fitting_profile
from facade_manipulator.errors import DriveError, DriveIdentityError
from facade_manipulator.tools.commissioning.bus import NODE_IDS, number_or_none, ToolBus
from facade_manipulator.tools.commissioning.context import Context

_PACE = 0.002  # s between requests: a send queue of ten frames does not fill up
_ANSWER = 0.25  # s
_UPLOAD, _ANSWERED = 0x40, b'\x43'
_REQUEST = struct.Struct('<BHB4x')
SERIAL = (0x1018, 4)
DRIVE_TYPE = 402
_ALL = 0x80  # asks every node without a node id for an answer to fastscan
_COLUMNS = ('node', 'serial', 'name', 'firmware', 'vendor', 'product', 'state', 'profile')


def add_commands(add: Callable[..., Any]) -> None:
    """Add the command to the tool."""
    add('scan', run_scan, 'Who is on the bus.')


def run_scan(context: Context) -> int:
    """List the nodes; return 1 if something is not as it should be."""
    expected = {name: axis.node_id for name, axis in context.machine.axes.items()}
    with context.bus() as bus:
        nodes = scan(bus)
        unconfigured = has_unconfigured(
            bus, [serial for node in nodes for serial in node.serials])
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
        operator.say(
            'Nothing answers: power, plugs, termination (60 ohms between CAN high and low), or '
            f'another bit rate than {bus.settings.bitrate}: docs/commissioning.md says how to '
            'listen for it.')
    return 1 if problems else 0


def _row(node: Node) -> tuple[Any, ...]:
    serials = ', '.join(str(serial) for serial in node.serials) or 'no answer'
    return (node.node_id, serials, node.name, node.firmware, _hex(node.vendor_id),
            _hex(node.product_code), node.state, node.profile)


def _hex(number: int | None) -> str:
    return '' if number is None else f'{number:X}h'


class Found(NamedTuple):
    """The identity by which LSS knows a drive."""

    vendor_id: int
    product_code: int
    revision_number: int
    serial_number: int


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
        if not is_drive(self.device_type):
            return ''
        return fitting_profile(self.vendor_id, self.product_code)


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


def has_unconfigured(bus: ToolBus, configured: Iterable[int] = ()) -> bool:
    """
    Return whether a node without a node id answers.

    Some know fastscan alone (CANopenNode); others answer fastscan although they have a node id
    (Lely), so that their serial numbers are compared with those that are `configured`.
    """
    def asked(question: bytes, answer: int) -> bool:
        frames = bus.collect(_ANSWER, lambda: bus.frames.send(
            lss.LssMaster.LSS_TX_COBID, question.ljust(8, b'\0')))
        return any(frame.cob_id == lss.LssMaster.LSS_RX_COBID and frame.data[:1] == bytes([answer])
                   for frame in frames)

    if asked(bytes([lss.CS_IDENTIFY_NON_CONFIGURED_REMOTE_SLAVE]),
             lss.CS_IDENTIFY_NON_CONFIGURED_SLAVE):
        return True
    if not asked(bytes([lss.CS_FAST_SCAN, 0, 0, 0, 0, _ALL, 0, 0]), lss.CS_IDENTIFY_SLAVE):
        return False
    known, master = set(configured), bus.lss(_ANSWER)
    try:
        return not known or any(
            one.serial_number not in known for one in fast_scanned(master))
    finally:
        master.send_switch_state_global(lss.LssMaster.WAITING_STATE)


def fast_scanned(master: lss.LssMaster) -> Iterator[Found]:
    """Yield the nodes that answer fastscan; each is then selected, and so silent."""
    found: set[Found] = set()
    master.send_switch_state_global(lss.LssMaster.WAITING_STATE)
    while (result := master.fast_scan())[0] and (one := Found(*result[1])) not in found:
        found.add(one)
        yield one


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
