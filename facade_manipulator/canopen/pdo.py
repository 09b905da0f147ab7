"""
PDOs: their mapped objects, from which codecs and drive configuration are derived.

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

from facade_manipulator.canopen import cob_ids, indices
from facade_manipulator.canopen.sdo import Write

#: from the index of the communication parameters of a PDO to that of its mapping
MAPPING_OFFSET = indices.RPDO_MAPPING - indices.RPDO_COMMUNICATION
MAX_SIZE = 8  # bytes of a frame
PDO_NAMES = (
    *(f'RPDO{number}' for number in cob_ids.PDO_NUMBERS),
    *(f'TPDO{number}' for number in cob_ids.PDO_NUMBERS),
)


class MappedObject(NamedTuple):
    """Object in a PDO; `code` is its format character in `struct`."""

    index: int  # type: ignore[assignment]  # hides tuple.index
    subindex: int
    code: str

    @property
    def mapping(self) -> int:
        """Return the mapping entry (1600h or 1A00h): index, subindex and length in bits."""
        return (
            self.index << 16 | self.subindex << 8 | 8 * struct.calcsize(f'<{self.code}')
        )


@dataclass
class Pdo:
    """Process data object: a name, such as 'TPDO1', and its mapped objects."""

    # Hz, maximum rate of cycles at which the bus has room for every PDO
    HIGHEST_FULL_RATE = 200

    name: str
    #: the objects in order; empty for a PDO that is only disabled
    content: tuple[MappedObject, ...] = ()

    def __post_init__(self) -> None:
        self.number = int(self.name[-1])
        #: whether the drive sends it
        self.is_transmitted = self.name.startswith('T')
        first = indices.RPDO_COMMUNICATION
        if self.is_transmitted:
            first = indices.TPDO_COMMUNICATION
        self.communication_index = first + self.number - 1
        #: format of the data bytes, little-endian
        self.codec = struct.Struct('<' + ''.join(item.code for item in self.content))
        self.indices = tuple(item.index for item in self.content)

    def transmission(self, rate: int) -> int:
        """
        Return the transmission type n for a SYNC rate [Hz].

        A drive sends a TPDO at every n-th SYNC; an RPDO always has 1 and applies at the next SYNC.
        TPDOs with an object of `STATUS_OBJECTS` also have 1: each of them is an answer to a SYNC.
        TPDOs with an object of `MOTION_OBJECTS` have 1 up to a SYNC rate of 200 Hz. Above 200 Hz
        they are sent at most at 50 Hz, because the bus has no room for all TPDOs. Other TPDOs,
        such as those with error code and torque, are sent at most at 10 Hz.
        """
        if not self.is_transmitted or not STATUS_OBJECTS.isdisjoint(self.indices):
            return 1
        if MOTION_OBJECTS.isdisjoint(self.indices):
            return ceil(rate / 10)
        return 1 if rate <= self.HIGHEST_FULL_RATE else ceil(rate / 50)

    def cob_id(self, node_id: int) -> int:
        """Return the COB-ID of this PDO for a node id."""
        first = cob_ids.TPDO if self.is_transmitted else cob_ids.RPDO
        return first + cob_ids.PDO_STEP * (self.number - 1) + node_id

    def disable_write(self, node_id: int) -> Write:
        """
        Return the write that disables the PDO.

        A drive may lack the PDO, but must not reject the write. Only the bit that disables the PDO
        is read back: the drive may keep another COB-ID.
        """
        entry = self._cob_id_entry(node_id) | cob_ids.NOT_VALID
        return Write(
            self.communication_index,
            1,
            entry,
            4,
            required=False,
            read_back=cob_ids.NOT_VALID,
        )

    def configure_writes(self, node_id: int, rate: int) -> list[Write]:
        """
        Return the writes that configure the PDO, in the order prescribed by CiA 301.

        The order is: disable, count 0, entries, count, transmission type at a rate of SYNC [Hz],
        enable. The first two writes are not read back, because later writes replace them.
        """
        communication = self.communication_index
        mapping = communication + MAPPING_OFFSET
        disable = self.disable_write(node_id)._replace(required=True, read_back=0)
        writes = [disable, Write(mapping, 0, 0, 1, read_back=0)]
        for position, item in enumerate(self.content, start=1):
            writes.append(Write(mapping, position, item.mapping, 4))
        writes.append(Write(mapping, 0, len(self.content), 1))
        writes.append(Write(communication, 2, self.transmission(rate), 1))
        entry = self._cob_id_entry(node_id)
        used = cob_ids.NOT_VALID | cob_ids.EXTENDED_FRAME | cob_ids.COB_ID_BITS
        writes.append(Write(communication, 1, entry, 4, read_back=used))
        return writes

    def _cob_id_entry(self, node_id: int) -> int:
        """Return the COB-ID entry that enables the PDO."""
        return self.cob_id(node_id) | (
            cob_ids.RTR_NOT_ALLOWED if self.is_transmitted else 0
        )


RPDO1 = Pdo(
    'RPDO1',
    (
        MappedObject(indices.CONTROLWORD, 0, 'H'),
        MappedObject(indices.MODE_OF_OPERATION, 0, 'b'),
        MappedObject(indices.TARGET_POSITION, 0, 'i'),
    ),
)
TPDO1 = Pdo(
    'TPDO1',
    (
        MappedObject(indices.STATUSWORD, 0, 'H'),
        MappedObject(indices.MODE_DISPLAY, 0, 'b'),
        MappedObject(indices.ACTUAL_POSITION, 0, 'i'),
    ),
)
TPDO2 = Pdo(
    'TPDO2',
    (
        MappedObject(indices.ACTUAL_VELOCITY, 0, 'i'),
        MappedObject(indices.ACTUAL_FOLLOWING_ERROR, 0, 'i'),
    ),
)
TPDO3 = Pdo(
    'TPDO3',
    (
        MappedObject(indices.ERROR_CODE, 0, 'H'),
        MappedObject(indices.ACTUAL_TORQUE, 0, 'h'),
        MappedObject(indices.DIGITAL_INPUTS, 0, 'I'),
    ),
)

PDO_MAP = (RPDO1, TPDO1, TPDO2, TPDO3)
COMMAND_OBJECTS = frozenset(RPDO1.indices)
STATUS_OBJECTS = frozenset(TPDO1.indices)
MOTION_OBJECTS = frozenset(TPDO2.indices)
KNOWN_OBJECTS = {
    item.index: item
    for item in (*RPDO1.content, *TPDO1.content, *TPDO2.content, *TPDO3.content)
}


def unused_pdos(used: Iterable[Pdo]) -> tuple[Pdo, ...]:
    """Return the unused PDOs among the first four of each direction."""
    names = {one.name for one in used}
    return tuple(Pdo(name) for name in PDO_NAMES if name not in names)
