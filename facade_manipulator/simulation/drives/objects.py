"""
The object dictionary of a simulated drive: values behind an EDS, and the SDO server over them.

References
----------
CiA 301, SDO abort codes.

"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from canopen import ObjectDictionary, SdoAbortedError
from canopen.objectdictionary import ODVariable
from canopen.sdo import constants, SdoServer

from facade_manipulator.drives.canopen import pdo
from facade_manipulator.drives.canopen.eds import read_dictionary, variables

Key = tuple[int, int]
Reader = Callable[[], int]
Writer = Callable[[int], None]

COMMUNICATION_OBJECTS = range(0x1000, 0x2000)
STORE, RESTORE = (0x1010, 1), (0x1011, 1)
_SIGNATURES = {
    STORE: int.from_bytes(b'save', 'little'), RESTORE: int.from_bytes(b'load', 'little')}
_COMMANDS = {0x1003, 0x1010, 0x1011, 0x6040, 0x6060, 0x607A}  # writable, but nothing to keep
_LONGEST_DOWNLOAD = 64


@lru_cache(maxsize=16)
def _dictionary(eds: Path, node_id: int) -> ObjectDictionary:
    return read_dictionary(eds, node_id)


class ObjectStore:
    """
    Values of all objects of one drive, by index and subindex.

    The EDS has the values after a reset; `missing` are indices that this drive does not have.
    """

    def __init__(self, eds: Path, node_id: int, missing: tuple[int, ...] = ()) -> None:
        self.node_id = node_id
        self._eds = eds
        self.object_dictionary = _dictionary(eds, node_id)
        self.variables = {
            (item.index, item.subindex): item
            for item in variables(self.object_dictionary) if item.index not in missing
        }
        self._indices = {index for index, _ in self.variables}
        #: after a reset; a drive changes those in which it differs from others of its type
        self.defaults: dict[Key, Any] = {
            key: variable.default for key, variable in self.variables.items()}
        self.values: dict[Key, Any] = {}
        self.stored: dict[Key, Any] = {}  #: by 1010h: those that differ from the defaults
        self.readers: dict[Key, Reader] = {}  #: called for what is measured, instead of `values`
        #: called before a value is stored; they act on it, or reject it with `SdoAbortedError`
        self.writers: dict[Key, Writer] = {
            STORE: partial(self._keep, STORE), RESTORE: partial(self._keep, RESTORE)}
        self.reset()

    def reset(self, only: range = range(0x10000)) -> None:
        """Give the objects with an index in `only` what was stored, or their defaults."""
        for key, value in self.defaults.items():
            if key[0] in only:
                self.values[key] = self.stored.get(key, value)

    def set_node_id(self, node_id: int) -> None:
        """Become the objects of another node: some defaults depend on its number."""
        before, self.node_id = self.object_dictionary, node_id
        self.object_dictionary = _dictionary(self._eds, node_id)
        for old, new in zip(variables(before), variables(self.object_dictionary), strict=True):
            key = new.index, new.subindex
            if key in self.variables:
                self.variables[key] = new
                if self.defaults[key] == old.default:
                    self.defaults[key] = new.default

    def _keep(self, command: Key, signature: int) -> None:
        """Store all writable values, or forget them, which the next reset shows (CiA 301)."""
        if signature != _SIGNATURES[command]:
            raise SdoAbortedError(constants.ABORT_STORE_APPLICATION)
        self.stored.clear()
        if command == STORE:
            self.stored.update(
                (key, self.values[key]) for key, variable in self.variables.items()
                if variable.writable and key[0] not in _COMMANDS
                and self.values[key] != self.defaults[key])

    def __contains__(self, key: Key) -> bool:
        return key in self.variables

    def read(self, key: Key) -> Any:
        """Return the present value of an object that exists."""
        reader = self.readers.get(key)
        return self.values[key] if reader is None else reader()

    def write(self, key: Key, value: Any) -> None:
        """Store a value that a PDO or an SDO brought, or raise `SdoAbortedError`."""
        variable = self.variables[key]
        if variable.max is not None and value > variable.max:
            raise SdoAbortedError(constants.ABORT_VALUE_TOO_HIGH)
        if variable.min is not None and value < variable.min:
            raise SdoAbortedError(constants.ABORT_VALUE_TOO_LOW)
        writer = self.writers.get(key)
        if writer is not None:
            writer(value)
        if key not in _SIGNATURES:
            self.values[key] = value

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        """Return an object's bytes, for the SDO server."""
        variable = self._find(index, subindex)
        if check_readable and not variable.readable:
            raise SdoAbortedError(constants.ABORT_READ_WRITEONLY)
        return variable.encode_raw(self.read((index, subindex)))

    def set_data(
        self, index: int, subindex: int, data: bytes, check_writable: bool = False
    ) -> None:
        """Take an object's bytes from the SDO server."""
        variable = self._find(index, subindex)
        if check_writable and not variable.writable:
            raise SdoAbortedError(constants.ABORT_WRITE_READONLY)
        if 8 * len(data) != len(variable):
            raise SdoAbortedError(
                constants.ABORT_LENGTH_TOO_HIGH if 8 * len(data) > len(variable)
                else constants.ABORT_LENGTH_TOO_LOW)
        self.write((index, subindex), variable.decode_raw(bytes(data)))

    def _find(self, index: int, subindex: int) -> ODVariable:
        if index not in self._indices:
            raise SdoAbortedError(constants.ABORT_NOT_IN_OD)
        try:
            return self.variables[index, subindex]
        except KeyError:
            raise SdoAbortedError(constants.ABORT_NO_SUBINDEX) from None


class ObjectServer(SdoServer):
    """
    The SDO server over a store, hardened against frames that no SDO client would send.

    ``send_message(cob_id, data)`` of the network takes the answers.
    """

    def __init__(self, node_id: int, store: ObjectStore, network: Any) -> None:
        super().__init__(pdo.sdo_request_cob_id(node_id), pdo.sdo_response_cob_id(node_id), store)
        self.network = network
        # the library's server answers an unexpected segment with what it finds in these
        self._index = self._subindex = 0
        self._buffer = bytearray()

    def request(self, data: bytes) -> None:
        """Serve a frame; one that does not have eight bytes is not one of a client's."""
        if len(data) == 8:
            self.on_request(self.rx_cobid, bytearray(data), 0.0)

    def block_download(self, data: bytes) -> None:
        """Reject a block transfer, which the library does not offer, without a word in the log."""
        _, self._index, self._subindex = constants.SDO_STRUCT.unpack_from(data)
        raise SdoAbortedError(constants.ABORT_INVALID_COMMAND_SPECIFIER)

    def segmented_download(self, command: int, request: bytes) -> None:
        """Take a segment, as long as the transfer stays within what the objects can hold."""
        if len(self._buffer or b'') > _LONGEST_DOWNLOAD:
            self._buffer = bytearray()
            raise SdoAbortedError(constants.ABORT_OUT_OF_MEMORY)
        super().segmented_download(command, request)
