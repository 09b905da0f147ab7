"""
Commands `profile`, `backup` and `restore` for the objects of drives.

References
----------
CiA 301: store parameters (1010h).
CiA 306: electronic data sheet (EDS) and device configuration file (DCF).
CiA 402-2: supported drive modes 6502h.

"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from canopen import export_od, ObjectDictionaryError
from canopen.objectdictionary import datatypes, ODVariable

from facade_manipulator.canopen import indices
from facade_manipulator.canopen.eds import read_dictionary, variables
from facade_manipulator.canopen.sdo import SdoAbortError, SdoChannel, Steps, Write
from facade_manipulator.drives import configuration
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.errors import CommissioningError, DriveObjectError
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.package_files import atomic_write
from facade_manipulator.tools.commissioning.procedure import Context

TYPE_ENTRIES = ((indices.IDENTITY, 1), (indices.IDENTITY, 2))
_NOT_STORED = (
    '{} may have new values, which are not stored; next: switch its power off and on'
)
Key = tuple[int, int]
Objects = dict[Key, ODVariable]


def run_profile(context: Context) -> None:
    """Compare all drives with their profiles; fail if a drive differs."""
    context.agree(
        'The objects of the profiles are written to the drives, read back, and restored '
        'by a reset. Nothing is stored, and nothing moves.'
    )
    problems = []
    for name in [context.options.axis] if context.options.axis else AXIS_NAMES:
        axis = context.axes[name]
        profile = load_profile(axis.profile)
        writes = configuration.drive_writes(profile, axis, context.controller)
        context.begin(f'profile --check {name}')
        with context.drive(name, profile.eds) as (bus, drive):
            compared = bus.run(configuration.check(drive, writes))
            print(
                f'{name}: configure will change {len(compared.changed)} objects: '
                + (', '.join(compared.changed) or 'none')
            )
            if compared.unreadable:
                print(
                    f'{name}: the drive lacks or rejects '
                    + ', '.join(sorted(compared.unreadable))
                )
            context.state = _NOT_STORED.format(name)
            different = bus.run(differences(drive, axis, writes))
            found = [f'{name}: {one}' for one in different]
            bus.reset(axis.node_id, profile.quirks.boot_time)
            context.state = ''
        problems += found
        if not found:
            context.record(f'profile --check {name}', {})
    if problems:
        raise CommissioningError('\n! '.join(['profile rejected:', *problems]))


_CYCLIC_POSITION = 1 << 7  # in 6502h


def differences(
    drive: SdoChannel, axis: AxisSettings, writes: list[Write]
) -> Steps[list[str]]:
    """Describe every difference of a drive from its profile; raises a DriveTimeoutError."""
    profile = load_profile(axis.profile)
    read = drive.read_optional
    found: list[str] = []
    for check in (
        configuration.check_identity(drive, axis, {}),
        configuration.apply(drive, writes),
    ):
        try:
            yield from check
        except DriveObjectError as error:
            found += error.findings
    found += yield from configuration.unit_conflicts(read, axis)

    if not (yield from configuration.stops_without_master(drive, profile)):
        found.append(
            'the drive does not stop when this computer is silent (1016h with 6007h)'
        )
    modes = yield from read(indices.SUPPORTED_MODES, 0)
    if modes is not None and not modes & _CYCLIC_POSITION:
        found.append(
            f'the drive does not support cyclic synchronous position (6502h = {modes:X}h, bit 7)'
        )
    return found


def run_backup(context: Context) -> None:
    """Read the identity and all settings that an EDS lists, and write them to a DCF."""
    name = context.options.axis
    eds = context.options.eds or load_profile(context.axes[name].profile).eds
    path = context.options.file or context.overlay.path.with_name(f'machine.{name}.dcf')
    context.begin(f'backup {name}')
    with context.drive(name) as (bus, drive):
        dictionary = read_dictionary(eds, drive.node_id)
        objects = variables(dictionary)
        values = bus.run(read_values(drive, objects))
    for key, value in values.items():
        objects[key].value = value
        objects[key].value_raw = str(value)  # type: ignore[attr-defined]  # for export
    dictionary.node_id = drive.node_id
    with atomic_write(path) as draft, draft.open('w', encoding='utf-8') as file:
        export_od(dictionary, file, 'dcf')
    print(f'{path} contains the {len(values)} objects of {name} that {eds.name} lists.')
    context.record(f'backup {name}', {})


IDENTITY_ENTRIES = (*TYPE_ENTRIES, (indices.IDENTITY, 3), (indices.IDENTITY, 4))
# writable, but not settings
_NOT_SETTINGS = {
    indices.ERROR_FIELD,
    indices.STORE_PARAMETERS,
    indices.RESTORE_PARAMETERS,
    indices.CONTROLWORD,
    indices.MODE_OF_OPERATION,
    indices.TARGET_TORQUE,
    indices.TARGET_POSITION,
    indices.TARGET_VELOCITY,
}


def read_values(drive: SdoChannel, objects: Objects) -> Steps[dict[Key, Any]]:
    """Return identity and settings of a drive; sizes of numbers may differ from the EDS."""
    values = {}
    for key, variable in objects.items():
        is_setting = (
            variable.readable and variable.writable and key[0] not in _NOT_SETTINGS
        )
        if key in IDENTITY_ENTRIES or is_setting:
            # absent, or of another type
            with suppress(SdoAbortError, ObjectDictionaryError):
                data = yield from drive.read(*key)
                is_signed = variable.data_type in datatypes.SIGNED_TYPES
                values[key] = (
                    int.from_bytes(data, 'little', signed=is_signed)
                    if (variable.data_type in datatypes.INTEGER_TYPES)
                    else variable.decode_raw(data)
                )
    return values


_STORING_TIME = 5.0  # s


def run_restore(context: Context) -> None:
    """Print the differences, ask, write and store the values; compare again after a reset."""
    name = context.options.axis
    path = context.options.file
    profile = load_profile(context.axes[name].profile)
    objects = variables(read_dictionary(path))
    with context.drive(name) as (bus, drive):
        present = bus.run(read_values(drive, objects))
        if any(
            objects[key].value != present.get(key)
            for key in TYPE_ENTRIES
            if key in objects
        ):
            raise CommissioningError(
                f'{path} rejected: it is not a DCF of this type of drive (1018h); '
                'next: give a file that commission backup has written'
            )
        writes = []
        for key, value in present.items():
            is_of_bus = key[0] in indices.COMMUNICATION  # `configure` writes these
            is_new = objects[key].value not in (None, value)
            if is_new and not is_of_bus and key not in profile.of_place:
                writes.append(_write(key, objects[key]))
        if not writes:
            print(f'{name} agrees with {path}: nothing is written.')
            return
        print(f'object    {path.name:>14} {f"{name} now":>14}  name')
        for write in writes:
            variable = objects[write[:2]]
            print(
                f'{write} {variable.value!s:>14} {present[write[:2]]!s:>14}  {variable.name}'
            )
        context.agree(
            f'{name} receives the values of {path}, stores them (1010h) and is reset. '
            'No carriage moves.'
        )
        context.state = _NOT_STORED.format(name)
        bus.run(configuration.apply(drive, writes))
        context.state = (
            f'The values stored in {name} are unknown; next: switch its power off '
            f'and on, then commission restore {name} {path}'
        )
        drive.response_timeout = _STORING_TIME
        bus.run(drive.write(indices.STORE_PARAMETERS, 1, b'save'))
        bus.reset(drive.node_id, profile.quirks.boot_time)
        compared = bus.run(configuration.check(drive, writes))
        if lost := compared.problems:
            raise CommissioningError(
                f'{name} has not stored these values: ' + '; '.join(lost.values())
            )
    print(f'{name}: {len(writes)} objects written, stored, and the same after a reset.')


_ALL_BITS = -1  # mask of an object of any size


def _write(key: Key, variable: ODVariable) -> Write:
    """Return the write for a value; an integer has the size of the object in the drive."""
    if isinstance(variable.value, int):
        return Write(*key, variable.value, read_back=_ALL_BITS)
    data = variable.encode_raw(variable.value)  # type: ignore[arg-type]  # the value is set
    return Write(*key, int.from_bytes(data, 'little'), len(data), read_back=_ALL_BITS)
