"""
All writable objects of a drive: read, kept as a DCF, compared, written back, stored in the drive.

References
----------
CiA 301: store and restore parameters (1010h, 1011h), order of writing PDO parameters.
CiA 306: electronic data sheet (EDS) and device configuration file (DCF).

"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from canopen import export_od, ObjectDictionary
from canopen.objectdictionary import datatypes, ODVariable

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.eds import read_dictionary, variables
from facade_manipulator.canopen.sdo import SdoAbortError, SdoChannel
from facade_manipulator.errors import CommissioningError, file_errors, ParameterError
from facade_manipulator.files import atomic_write
from facade_manipulator.tools.commissioning.bus import stating, STORING, ToolBus

Key = tuple[int, int]
IDENTITY = tuple((0x1018, subindex) for subindex in (1, 2, 3, 4))
_COMMANDS = {0x1003, 0x1010, 0x1011, 0x6040, 0x6060, 0x607A, 0x60FF, 0x6071}  # nothing to keep
_PDOS = range(0x1400, 0x1C00)
_MAPPING = 0x200  # the bit in which a PDO's communication parameter and its mapping differ
_SAVE = int.from_bytes(b'save', 'little')


class Snapshot(NamedTuple):
    """Values of a drive's objects: where they come from, by index and subindex, what they mean."""

    source: str
    node_id: int
    values: dict[Key, Any]
    dictionary: ObjectDictionary
    sizes: dict[Key, int]  #: bytes that an object has, where the description says otherwise

    def variable(self, key: Key) -> Any:
        """Return the `ODVariable` of one of the objects, with what a file adds to it."""
        return self.dictionary.get_variable(*key)

    def value(self, key: Key, node_id: int = 0) -> Any:
        """Return a value with a node id in place of that in it; None for an absent object."""
        value = self.values.get(key)
        if value is None or not self.variable(key).relative:
            return value
        return value - self.node_id + node_id


def take_snapshot(drive: SdoChannel, eds: Path) -> Snapshot:
    """
    Read the identity and all writable objects that an EDS names; those that are absent are left.

    Raises a DriveTimeoutError if the drive stops answering, a ParameterError if the EDS cannot be
    read.
    """
    dictionary = read_dictionary(eds, drive.node_id)
    values, sizes = {}, {}
    for variable in variables(dictionary):
        key = variable.index, variable.subindex
        if is_kept(variable) or key in IDENTITY:
            with suppress(SdoAbortError):
                data = drive.read(*key)
                if variable.fixed_size and 8 * len(data) != len(variable):
                    sizes[key] = len(data)
                values[key] = decoded(variable, data)
    return Snapshot(drive.name, drive.node_id, values, dictionary, sizes)


def is_kept(variable: ODVariable) -> bool:
    """Return whether an object is a setting: it can be read and written, and does nothing."""
    return variable.readable and variable.writable and variable.index not in _COMMANDS


def decoded(variable: ODVariable, data: bytes) -> Any:
    """Return the value of an object, whatever size the description gives a number."""
    if variable.data_type in datatypes.INTEGER_TYPES:
        is_signed = variable.data_type in datatypes.SIGNED_TYPES
        return int.from_bytes(data, 'little', signed=is_signed)
    return variable.decode_raw(data) if 8 * len(data) == len(variable) or (
        not variable.fixed_size) else data.hex()


def encoded(variable: ODVariable, value: Any, size: int | None) -> bytes:
    """Return the bytes of a value, of another size than described where one is given."""
    if size is None:
        return variable.encode_raw(value)
    if isinstance(value, str):
        return bytes.fromhex(value)
    return value.to_bytes(size, 'little', signed=value < 0)


def write_dcf(snapshot: Snapshot, path: Path) -> None:
    """Write a snapshot as a DCF; raises a ParameterError, and leaves no half file."""
    dictionary = snapshot.dictionary
    for key, value in snapshot.values.items():
        variable = snapshot.variable(key)
        variable.value, variable.value_raw = value, str(value)
    dictionary.node_id = snapshot.node_id
    dictionary.comments = (
        f'{snapshot.source}, {datetime.now().isoformat(" ", "seconds")}, serial number '
        f'{snapshot.values.get(IDENTITY[3])}')
    with (file_errors(path), atomic_write(path) as draft,
          draft.open('w', encoding='utf-8') as file):
        export_od(dictionary, file, 'dcf')


def read_dcf(path: Path) -> Snapshot:
    """Read a snapshot from a DCF; raises a ParameterError where there are no values in it."""
    dictionary = read_dictionary(path)
    values = {
        (variable.index, variable.subindex): variable.value
        for variable in variables(dictionary) if variable.value is not None}
    if dictionary.node_id is None or not values:
        raise ParameterError(f'{path} has no values and no node id: it is no DCF of a drive')
    for variable in variables(dictionary):
        variable.relative = '$NODEID' in str(getattr(variable, 'default_raw', ''))
    return Snapshot(path.name, dictionary.node_id, values, dictionary, {})


class Difference(NamedTuple):
    """An object that two snapshots have with different values; None where one has none."""

    key: Key
    name: str
    here: Any
    there: Any

    @property
    def row(self) -> tuple[str, str, str, str]:
        """What an operator reads: object, its name, and the two values."""
        return label(self.key), self.name, shown(self.here), shown(self.there)


def compare(
    here: Snapshot, there: Snapshot, of_place: Iterable[Key] = ()
) -> list[Difference]:
    """
    Return where two snapshots differ, but for node ids in COB-IDs and the identity.

    Objects of a place, such as the node id, differ between good drives: they are left out.
    """
    keys = sorted((here.values.keys() | there.values.keys()) - {*IDENTITY, *of_place})
    return [
        Difference(key, _name(here if key in here.values else there, key),
                   here.values.get(key), there.values.get(key))
        for key in keys if here.value(key) != there.value(key)]


def _name(snapshot: Snapshot, key: Key) -> str:
    variable = snapshot.variable(key)
    parent = variable.parent.name if key[1] else ''
    return f'{parent}: {variable.name}' if parent else variable.name


def restore(
    drive: SdoChannel, wanted: Snapshot, present: Snapshot, of_place: Iterable[Key] = ()
) -> int:
    """
    Write what differs, in the order that PDOs need, and read it back; return how many differed.

    Nothing is stored. Raises a CommissioningError with the drive's state if it rejects an object,
    reads it back otherwise or stops answering.
    """
    changes = {
        difference.key: wanted.value(difference.key, drive.node_id)
        for difference in compare(wanted, present, of_place)
        if difference.here is not None and difference.there is not None}
    done: dict[str, None] = {}  # labels, in order
    with stating(lambda: (
            f'Written to {drive.name}: {", ".join(done) or "nothing"}. Nothing is stored: it has '
            'its old values again after its power was off and on')):
        for key, value in _in_order(changes, wanted, drive.node_id):
            done[label(key)] = None
            drive.write(*key, encoded(wanted.variable(key), value, present.sizes.get(key)))
        for key, value in changes.items():
            found = decoded(wanted.variable(key), drive.read(*key))
            if found != value:
                raise CommissioningError(
                    f'{drive.name}: {label(key)} reads back as {found} instead of {value}')
    return len(changes)


def _in_order(
    changes: dict[Key, Any], wanted: Snapshot, node_id: int
) -> Iterator[tuple[Key, Any]]:
    """Yield the writes; those of a PDO: off, no entries, entries, count, the rest, on."""
    for index in sorted({key[0] & ~_MAPPING for key in changes if key[0] in _PDOS}):
        values = {key: wanted.value(key, node_id) for key in sorted(wanted.values)
                  if key[0] & ~_MAPPING == index}
        switch, count = (index, 1), (index + _MAPPING, 0)
        yield switch, values[switch] | pdo.DISABLED
        if count in values:
            yield count, 0
        for key in values:
            if key not in (switch, count, (index, 0)) and _is_entry(key, count, values):
                yield key, values[key]
        if count in values:
            yield count, values[count]
        yield switch, values[switch]
    yield from (item for item in changes.items() if item[0][0] not in _PDOS)


def _is_entry(key: Key, count: Key, values: dict[Key, Any]) -> bool:
    """Return whether an object is written: of the mapping only the entries that count."""
    return key[0] != count[0] or 0 < key[1] <= values.get(count, 0)


def store(bus: ToolBus, node_id: int, name: str) -> None:
    """
    Let a drive store its objects (1010h:01), reset it, and wait until it is back.

    Raises a CommissioningError that says what may be in it now, if it does not.
    """
    with stating(lambda: (
            f'What {name} holds now is not known: switch its power off and on, then commission '
            f'compare {name} with its backup, and restore it')):
        try:
            bus.objects(node_id, name, patience=STORING).write(
                0x1010, 1, _SAVE.to_bytes(4, 'little'))
        except SdoAbortError as error:
            raise CommissioningError(f'{error}: {name} has stored nothing') from error
        bus.reset(node_id)


def label(key: Key) -> str:
    """Return index and subindex as manuals write them."""
    return f'{key[0]:04X}h:{key[1]:02X}'


def shown(value: Any) -> str:
    """Return a value as an operator reads it."""
    if value is None:
        return 'absent'
    return f'{value} ({value:X}h)' if isinstance(value, int) and value > 9 else str(value)
