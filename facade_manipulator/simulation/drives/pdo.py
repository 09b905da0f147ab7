"""
Process data of a simulated drive, exactly as its communication and mapping objects say.

References
----------
CiA 301, PDO communication and mapping parameters, transmission types.

"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
import struct

from canopen import SdoAbortedError
from canopen.objectdictionary import ODVariable
from canopen.sdo import constants

from facade_manipulator.drives.canopen import pdo
from facade_manipulator.simulation.drives.objects import Key, ObjectStore

_RECEIVE, _TRANSMIT = range(0x1400, 0x1404), range(0x1800, 0x1804)  # communication parameters
_MAPPING = 0x200  # from one to its mapping parameter
_EXTENDED = 1 << 29
_SYNCHRONOUS = range(241)  # transmission types that a SYNC triggers
_EVENT = (254, 255)
_CONTROLWORD = (0x6040, 0)

Send = Callable[[int, bytes], None]


@dataclass
class _Pdo:
    """A PDO that is switched on."""

    cob_id: int
    keys: tuple[Key, ...]
    codec: struct.Struct
    transmission: int
    data: bytes | None = None  #: what was received and waits, or was sent last
    syncs: int = 0

    def is_due_at_sync(self, data: bytes) -> bool:
        """Count a SYNC; return whether this one is to be answered."""
        if self.transmission == 0:
            return data != self.data
        self.syncs = (self.syncs + 1) % self.transmission
        return self.syncs == 0


class ProcessData:
    """
    The PDOs of one drive. TPDOs are sent in answer to SYNC alone.

    The store's configuration objects get their checks here; `on_short_frame` is called when an
    RPDO is too short for its mapping.
    """

    def __init__(
        self, store: ObjectStore, send: Send, on_short_frame: Callable[[], None]
    ) -> None:
        self._store = store
        self._send = send
        self._on_short_frame = on_short_frame
        self.forget()
        for communication in (*_RECEIVE, *_TRANSMIT):
            self._guard(communication, communication + _MAPPING)

    def _guard(self, communication: int, mapping: int) -> None:
        writers = self._store.writers
        writers[communication, 1] = partial(self._write_cob_id, communication)
        writers[communication, 2] = self._write_transmission
        writers[mapping, 0] = partial(self._write_count, communication, mapping)
        for subindex in range(1, 9):
            writers[mapping, subindex] = partial(self._write_entry, communication, mapping)

    def _write_cob_id(self, communication: int, value: int) -> None:
        before = self._store.values[communication, 1]
        moved = (before ^ value) & 0x7FF and not (before | value) & pdo.DISABLED
        if moved or value & _EXTENDED:
            raise SdoAbortedError(constants.ABORT_INVALID_VALUE)
        self._compiled = False

    def _write_transmission(self, value: int) -> None:
        if value not in _SYNCHRONOUS and value not in _EVENT:
            raise SdoAbortedError(constants.ABORT_INVALID_VALUE)
        self._compiled = False

    def _write_count(self, communication: int, mapping: int, count: int) -> None:
        self._require_disabled(communication)
        entries = [self._store.values[mapping, n] for n in range(1, count + 1)]
        for entry in entries:
            self._check_entry(mapping, entry)
        if sum(entry & 0xFF for entry in entries) > 64:
            raise SdoAbortedError(constants.ABORT_PDO_LENGTH_EXCEEDED)

    def _write_entry(self, communication: int, mapping: int, value: int) -> None:
        self._require_disabled(communication)
        if self._store.values[mapping, 0]:
            raise SdoAbortedError(constants.ABORT_APPLICATION_DEVICE_STATE)
        self._check_entry(mapping, value)

    def _require_disabled(self, communication: int) -> None:
        if not self._store.values[communication, 1] & pdo.DISABLED:
            raise SdoAbortedError(constants.ABORT_APPLICATION_DEVICE_STATE)

    def _check_entry(self, mapping: int, entry: int) -> None:
        variable = self._store.variables.get(_mapped(entry))
        transmitted = mapping >= 0x1A00
        if variable is None or not variable.pdo_mappable or len(variable) != entry & 0xFF:
            raise SdoAbortedError(constants.ABORT_PDO_CANNOT_MAP)
        if not (variable.readable if transmitted else variable.writable):
            raise SdoAbortedError(constants.ABORT_PDO_CANNOT_MAP)

    def forget(self) -> None:
        """Drop what is waiting for a SYNC, as on leaving NMT Operational or after a reset."""
        self._compiled = False
        self._receive: dict[int, _Pdo] = {}
        self._transmit: list[_Pdo] = []

    def receives(self, cob_id: int) -> bool:
        """Return whether an RPDO of this COB-ID is switched on."""
        self._compile()
        return cob_id in self._receive

    def _compile(self) -> None:
        if not self._compiled:
            self._compiled = True
            self._receive = {one.cob_id: one for one in self._switched_on(_RECEIVE)}
            self._transmit = self._switched_on(_TRANSMIT)

    def _switched_on(self, parameters: range) -> list[_Pdo]:
        values = self._store.values
        return [
            self._make(values[index, 1] & 0x7FF, index, index + _MAPPING) for index in parameters
            if not values[index, 1] & pdo.DISABLED and values[index + _MAPPING, 0] > 0]

    def _make(self, cob_id: int, communication: int, mapping: int) -> _Pdo:
        values, variables = self._store.values, self._store.variables
        keys = tuple(_mapped(values[mapping, n]) for n in range(1, values[mapping, 0] + 1))
        codes = [ODVariable.STRUCT_TYPES[variables[key].data_type or 0].format[-1] for key in keys]
        return _Pdo(cob_id, keys, struct.Struct('<' + ''.join(codes)), values[communication, 2])

    def receive(self, cob_id: int, data: bytes) -> bool:
        """Take an RPDO; return whether it acted at once rather than waiting for a SYNC."""
        self._compile()
        rpdo = self._receive[cob_id]
        if len(data) < rpdo.codec.size:
            self._on_short_frame()
            return False
        rpdo.data = data[:rpdo.codec.size]
        waits = rpdo.transmission in _SYNCHRONOUS
        if not waits:
            self._apply(rpdo, rpdo.data)
        return not waits

    def answer_sync(self) -> None:
        """Send the TPDOs that a SYNC asks for, with the values of this instant."""
        self._compile()
        for tpdo in self._transmit:
            if tpdo.transmission in _SYNCHRONOUS:
                data = tpdo.codec.pack(*map(self._store.read, tpdo.keys))
                if tpdo.is_due_at_sync(data):
                    tpdo.data = data
                    self._send(tpdo.cob_id, data)

    def latch(self) -> None:
        """Make the RPDOs that came since the last SYNC act."""
        for rpdo in self._receive.values():
            if rpdo.data is not None:
                self._apply(rpdo, rpdo.data)

    def _apply(self, rpdo: _Pdo, data: bytes) -> None:
        pairs = zip(rpdo.keys, rpdo.codec.unpack(data), strict=True)
        rpdo.data = None
        # the controlword last: it acts on the mode and the target that came with it
        for key, value in sorted(pairs, key=lambda pair: pair[0] == _CONTROLWORD):
            try:
                self._store.write(key, value)
            except SdoAbortedError:
                continue  # as a drive does: a value that it rejects keeps its old one


def _mapped(entry: int) -> Key:
    return entry >> 16, entry >> 8 & 0xFF
