"""
PDOs: their objects, from which codecs and configuration of the drives follow.

TPDO and RPDO are named from the side of the drive: the master encodes RPDOs and decodes TPDOs. The
drive type determines the mapped objects; `PDO_MAP` is the mapping for drives with free mapping.

References
----------
CiA 301, process data objects: communication parameters 1400h/1800h, mapping 1600h/1A00h.

"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil
import struct
from typing import NamedTuple

NMT_COB_ID = 0x000
SYNC_COB_ID = 0x080
# COB-IDs of the predefined connection set; the node id is added
EMERGENCY, SDO_RESPONSE, SDO_REQUEST, HEARTBEAT = 0x080, 0x580, 0x600, 0x700
LSS_REQUEST = 0x7E5
MASTER_NODE_ID = 127
REMOTE_FRAME = 1 << 30  # marks the COB-ID of a received remote frame, as in SocketCAN
# bits of a COB-ID in the objects of a node
PDO_NOT_VALID = 1 << 31
RTR_NOT_ALLOWED = 1 << 30
EXTENDED_FRAME = 1 << 29
COB_ID_BITS = 0x7FF

NMT_STARTUP_OBJECT = 0x1F80
WAITS_FOR_START = 1 << 2  # bit of 1F80h: the node does not start itself (CiA 302-2)
GUARD_TIME_OBJECT = 0x100C  # ms
SYNC_OBJECT, SYNC_PERIOD_OBJECT = 0x1005, 0x1006
SYNC_PRODUCER = 1 << 30  # bit of 1005h: the node sends SYNC with the period 1006h [us]

ALL_BITS = 0xFFFFFFFF
HIGHEST_FULL_RATE = (
    200  # Hz, maximum rate of cycles at which the bus has room for every PDO
)
PDO_NAMES = tuple(
    f'{direction}PDO{number}' for direction in 'RT' for number in range(1, 5)
)


class Write(NamedTuple):
    """Write of one object, with a mask of the bits that must be read back."""

    index: int  # type: ignore[assignment]  # hides tuple.index
    subindex: int
    value: int
    size: int | None = (
        None  #: bytes; None for the size in the drive's object dictionary
    )
    required: bool = True  #: whether a drive without the object is rejected
    #: mask of the bits that must be read back as written; 0 for an intermediate value
    compared: int = ALL_BITS

    def __str__(self) -> str:
        return f'{self.index:04X}h:{self.subindex:02X}'


class MappedObject(NamedTuple):
    """Object in a PDO; `code` is its letter in `struct`."""

    index: int  # type: ignore[assignment]  # hides tuple.index
    subindex: int
    code: str

    @property
    def mapping(self) -> int:
        """Return the entry of 1600h or 1A00h: index, subindex and length in bits."""
        return (
            self.index << 16 | self.subindex << 8 | 8 * struct.calcsize(f'<{self.code}')
        )


@dataclass
class Pdo:
    """Process data object: its name, such as 'TPDO1', and its mapped objects."""

    name: str
    #: the objects in order; empty for a PDO that is only disabled
    content: tuple[MappedObject, ...] = ()

    def __post_init__(self) -> None:
        self.number = int(self.name[-1])
        self.is_transmitted = self.name.startswith(
            'T'
        )  #: named from the side of the drive
        self.communication_index = (
            (0x1800 if self.is_transmitted else 0x1400) + self.number - 1
        )
        #: format of the data bytes, little-endian
        self.codec = struct.Struct('<' + ''.join(item.code for item in self.content))
        self.indices = tuple(item.index for item in self.content)

    def transmission(self, rate: int) -> int:
        """
        Return the transmission type at a rate [Hz]: the PDO is sent at every n-th SYNC.

        The condition of a drive is sent at 10 Hz. The bus has no room for its velocity in every
        cycle faster than 200 Hz; it is then sent at 50 Hz.
        """
        if not self.is_transmitted or not STATUS.isdisjoint(self.indices):
            return 1
        if MOTION.isdisjoint(self.indices):
            return ceil(rate / 10)
        return 1 if rate <= HIGHEST_FULL_RATE else ceil(rate / 50)

    def cob_id(self, node_id: int) -> int:
        """Return the COB-ID of this PDO at a node."""
        return 0x100 * self.number + (0x080 if self.is_transmitted else 0x100) + node_id

    def disable_write(self, node_id: int) -> Write:
        """Return the write that disables the PDO; the drive may keep another COB-ID."""
        entry = self._cob_id_entry(node_id) | PDO_NOT_VALID
        return Write(
            self.communication_index,
            1,
            entry,
            4,
            required=False,
            compared=PDO_NOT_VALID,
        )

    def configure_writes(self, node_id: int, rate: int = 100) -> list[Write]:
        """
        Return the writes that configure the PDO, in the order that CiA 301 prescribes.

        The order is: disable, count 0, entries, count, transmission type at a rate [Hz], enable.

        """
        mapping = self.communication_index + 0x200
        return [
            self.disable_write(node_id)._replace(required=True, compared=0),
            Write(mapping, 0, 0, 1, compared=0),
            *(
                Write(mapping, position, item.mapping, 4)
                for position, item in enumerate(self.content, start=1)
            ),
            Write(mapping, 0, len(self.content), 1),
            Write(self.communication_index, 2, self.transmission(rate), 1),
            Write(
                self.communication_index,
                1,
                self._cob_id_entry(node_id),
                4,
                compared=PDO_NOT_VALID | EXTENDED_FRAME | COB_ID_BITS,
            ),
        ]

    def _cob_id_entry(self, node_id: int) -> int:
        return self.cob_id(node_id) | (RTR_NOT_ALLOWED if self.is_transmitted else 0)


RPDO1 = Pdo(
    'RPDO1',
    (
        MappedObject(0x6040, 0, 'H'),
        MappedObject(0x6060, 0, 'b'),
        MappedObject(0x607A, 0, 'i'),
    ),
)
TPDO1 = Pdo(
    'TPDO1',
    (
        MappedObject(0x6041, 0, 'H'),
        MappedObject(0x6061, 0, 'b'),
        MappedObject(0x6064, 0, 'i'),
    ),
)
TPDO2 = Pdo('TPDO2', (MappedObject(0x606C, 0, 'i'), MappedObject(0x60F4, 0, 'i')))
TPDO3 = Pdo(
    'TPDO3',
    (
        MappedObject(0x603F, 0, 'H'),
        MappedObject(0x6077, 0, 'h'),
        MappedObject(0x60FD, 0, 'I'),
    ),
)

CONTROLWORD, MODE_COMMAND, TARGET = RPDO1.indices
STATUSWORD, MODE, POSITION = TPDO1.indices
VELOCITY, FOLLOWING_ERROR = TPDO2.indices
ERROR_CODE, TORQUE, INPUTS = TPDO3.indices
PDO_MAP = (RPDO1, TPDO1, TPDO2, TPDO3)
COMMANDS, STATUS, MOTION = (frozenset(one.indices) for one in (RPDO1, TPDO1, TPDO2))
KNOWN_OBJECTS = {item.index: item for one in PDO_MAP for item in one.content}


def frames_of_masters(node_ids: Iterable[int]) -> dict[int, tuple[str, bool]]:
    """Return descriptions of master frames by COB-ID, and whether the frames command drives."""
    frames = {
        HEARTBEAT + MASTER_NODE_ID: ('its heartbeat (77Fh)', True),
        SYNC_COB_ID: ('SYNC (080h)', True),
        NMT_COB_ID: ('an NMT command', False),
        LSS_REQUEST: ('an LSS request (7E5h)', False),
    }
    for node in node_ids:
        for pdo in map(Pdo, PDO_NAMES):
            if pdo.is_transmitted:
                frames[REMOTE_FRAME | pdo.cob_id(node)] = (
                    f'a remote request to node {node}',
                    False,
                )
            else:
                frames[pdo.cob_id(node)] = f'process data for node {node}', True
        frames[SDO_REQUEST + node] = f'an SDO request to node {node}', False
        guarding = f'node guarding of node {node} (RTR to {HEARTBEAT + node:03X}h)'
        frames[REMOTE_FRAME | (HEARTBEAT + node)] = guarding, False
    return frames


def unused_pdos(used: Iterable[Pdo]) -> tuple[Pdo, ...]:
    """Return the unused PDOs among the four of each direction."""
    return tuple(
        Pdo(name) for name in PDO_NAMES if name not in {one.name for one in used}
    )
