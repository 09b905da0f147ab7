"""
Commands `backup` and `restore`: the settings of a drive in a DCF.

References
----------
CiA 301: store parameters (1010h).
CiA 306: electronic data sheet (EDS) and device configuration file (DCF).

"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from typing import Any

from canopen import export_od, ObjectDictionaryError
from canopen.objectdictionary import datatypes, ODVariable

from facade_manipulator.canopen.eds import read_dictionary, variables
from facade_manipulator.canopen.sdo import SdoAbortError, SdoChannel
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.errors import CommissioningError
from facade_manipulator.files import atomic_write
from facade_manipulator.tools.commissioning.context import Context, table

TYPE = ((0x1018, 1), (0x1018, 2))
IDENTITY = (*TYPE, (0x1018, 3), (0x1018, 4))
_COMMANDS = {0x1003, 0x1010, 0x1011, 0x6040, 0x6060, 0x607A, 0x60FF, 0x6071}  # not settings
_COMMUNICATION = range(0x1000, 0x2000)  # of a place on the bus; `configure` writes its own
_STORING_TIME = 5.0  # s
Key = tuple[int, int]
Objects = dict[Key, ODVariable]
Values = dict[Key, Any]


def run_backup(context: Context) -> None:
    """Read the identity and all settings that an EDS names; write them as a DCF."""
    name = context.options.axis
    eds = context.options.eds or load_profile(context.axes[name].profile).eds
    path = context.options.file or context.overlay.path.with_name(f'machine.{name}.dcf')
    with context.bus() as bus:
        drive = context.drive(bus, name)
        dictionary = read_dictionary(eds, drive.node_id)
        objects = _by_key(variables(dictionary))
        values = read_values(drive, objects)
    for key, value in values.items():
        objects[key].value = value
        objects[key].value_raw = str(value)  # type: ignore[attr-defined]  # it is exported
    dictionary.node_id = drive.node_id
    with atomic_write(path) as draft, draft.open('w', encoding='utf-8') as file:
        export_od(dictionary, file, 'dcf')
    print(f'{path} has {len(values)} objects of {name}, those that {eds.name} names.')
    context.record(f'backup {name}')


def _by_key(found: Iterable[ODVariable]) -> Objects:
    return {(one.index, one.subindex): one for one in found}


def read_values(drive: SdoChannel, objects: Objects) -> Values:
    """Return identity and settings of a drive; numbers may have another size than in the EDS."""
    values = {}
    for key, variable in objects.items():
        is_setting = variable.readable and variable.writable and key[0] not in _COMMANDS
        if key in IDENTITY or is_setting:
            with suppress(SdoAbortError, ObjectDictionaryError):  # absent, or of another type
                data = drive.read(*key)
                is_signed = variable.data_type in datatypes.SIGNED_TYPES
                values[key] = int.from_bytes(data, 'little', signed=is_signed) if (
                    variable.data_type in datatypes.INTEGER_TYPES) else variable.decode_raw(data)
    return values


def run_restore(context: Context) -> None:
    """Show the differences, ask, write and store them, and read them after a reset."""
    name, path = context.options.axis, context.options.file
    of_place = load_profile(context.axes[name].profile).of_place
    objects = _by_key(variables(read_dictionary(path)))
    with context.bus() as bus:
        drive = context.drive(bus, name)
        present = read_values(drive, objects)
        if any(objects[key].value != present.get(key) for key in TYPE if key in objects):
            raise CommissioningError(f'{path} rejected: it is not a DCF of such a drive (1018h); '
                                     'next: give one made by commission backup')
        wanted: Values = {
            key: objects[key].value for key, value in present.items()
            if key[0] not in _COMMUNICATION and key not in of_place
            and objects[key].value not in (None, value)}
        if not wanted:
            print(f'{name} agrees with {path}: nothing is written.')
            return
        table([('object', 'name', path.name, f'{name} now'), *(
            (label(key), objects[key].name, value, present[key])
            for key, value in wanted.items())])
        context.agree(f'{name} gets the values of {path}, stores them (1010h) and is reset. '
                      'Nothing moves.')
        for number, (key, value) in enumerate(wanted.items(), start=1):
            context.state = (
                f'Written to {name}: {", ".join(map(label, [*wanted][:number]))}. Nothing is '
                'stored: it has its old values after power off and on')
            drive.write(*key, value.to_bytes(
                len(drive.read(*key)), 'little', signed=value < 0) if isinstance(value, int)
                else objects[key].encode_raw(value))
        context.state = (f'It is not known what {name} has stored. Next: switch its power off and '
                         f'on, then commission restore {name} {path}')
        drive.RESPONSE_TIMEOUT = _STORING_TIME
        drive.write(0x1010, 1, b'save')
        bus.reset(drive.node_id)
        present = read_values(drive, objects)
        if lost := [label(key) for key in wanted if present.get(key) != wanted[key]]:
            raise CommissioningError(f'{name} has not stored {", ".join(lost)}')
    print(f'{name}: {len(wanted)} objects written, stored, and the same after a reset.')


def label(key: Key) -> str:
    """Return index and subindex as manuals write them."""
    return f'{key[0]:04X}h:{key[1]:02X}'
