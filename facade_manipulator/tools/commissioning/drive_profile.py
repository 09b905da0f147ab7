"""
Drive profiles: one drafted from a maker's EDS, one held against a real drive.

References
----------
CiA 402-2: supported drive modes 6502h, supported homing methods 60E3h, SI unit velocity 60A9h.

"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from canopen import ObjectDictionary

from facade_manipulator.drives.canopen import SdoAbortError, SdoChannel
from facade_manipulator.drives.cia402 import AxisSettings, DriveProfile, load_profile
from facade_manipulator.drives.controller import check_identity, read_identity, unit_conflicts
from facade_manipulator.errors import DriveIdentityError
from facade_manipulator.tools.commissioning.drive_objects import read_dictionary, variables

TEMPLATE = 'generic_cia402'
_CYCLIC_POSITION = 1 << 7  # in 6502h
_VELOCITY_UNITS = {0x00B44700: 'rpm', 0xFDB44700: 'milli_rpm', 0x00B50300: 'counts_per_second'}
_QUESTIONS = {
    'boots_operational': 'does it enter NMT Operational by itself after boot-up?',
    'zero_statusword_until_controlword': 'is 6041h zero until the first controlword?',
    'pdo_only_on_sync': 'does it send TPDOs only in answer to a SYNC?',
    'never_follows': 'does bit 12 of 6041h stay 0 in cyclic synchronous position?',
}


def draft(eds: Path) -> tuple[str, list[str]]:
    """
    Draft a profile from a maker's EDS; return its YAML, and what the drive lacks.

    What only the maker or the drive can say stands in the YAML as questions. Raises a
    ParameterError if the EDS cannot be read.
    """
    dictionary = read_dictionary(eds)
    template = load_profile(TEMPLATE)
    lines = [f'# Drafted from {eds.name}: answer the lines with a question mark, then try it on '
             'the drive', '# with `commission profile --check`.',
             f'description: {dictionary.device_information.product_name or eds.stem}']
    if dictionary.device_information.vendor_number:
        lines.append(f'vendor_id: {dictionary.device_information.vendor_number}')
    unit = _VELOCITY_UNITS.get(_default(dictionary, 0x60A9))
    methods = _homing_methods(dictionary)
    lines += [
        f'eds: {eds.name}',
        f'velocity_unit: {unit or template.velocity_unit}' + ('' if unit else (
            '  # ? in which unit does it state velocities (606Ch, 6081h)?')),
        f'motor_speed_unit: {template.motor_speed_unit}  # ? in which unit is 6080h?',
        f'homing_methods: [{", ".join(map(str, methods or template.homing_methods))}]' + (
            '' if methods else '  # ? which does its manual name?'),
        'quirks:', *(f'  {name}: false  # ? {question}' for name, question in _QUESTIONS.items()),
        'pdos:', *(f'  {name}: [{", ".join(indices)}]' for name, indices in _pdos(
            dictionary, template)),
        'objects:']
    for item in template.objects:
        if dictionary.get_variable(item.index, item.subindex) is not None:
            lines.append(
                f'  - {{index: 0x{item.index:04X}, subindex: {item.subindex}, value: {item.value},'
                f' required: {str(item.required).lower()}}}')
    return '\n'.join(lines) + '\n', list(_missing(dictionary, template))


def _pdos(
    dictionary: ObjectDictionary, template: DriveProfile
) -> Iterator[tuple[str, list[str]]]:
    """Yield the process data of the template that the drive can carry."""
    for one in template.pdos:
        indices = [f'0x{entry.index:04X}' for entry in one.content
                   if (variable := dictionary.get_variable(entry.index, entry.subindex))
                   is not None and variable.pdo_mappable]
        if indices and one.mapping_index in dictionary:
            yield one.name, indices


def _missing(dictionary: ObjectDictionary, template: DriveProfile) -> Iterator[str]:
    modes = _default(dictionary, 0x6502)
    if modes and not modes & _CYCLIC_POSITION:
        yield 'cyclic synchronous position (bit 7 of 6502h)'
    for item in template.objects:
        if item.required and dictionary.get_variable(item.index, item.subindex) is None:
            yield f'object {item.index:04X}h:{item.subindex:02X} for {item.value}'
    for pdo in template.pdos:
        if pdo.mapping_index not in dictionary:
            yield f'{pdo.name} ({pdo.mapping_index:04X}h)'
        for entry in pdo.content:
            variable = dictionary.get_variable(entry.index, entry.subindex)
            if variable is None or not variable.pdo_mappable:
                yield f'object {entry.index:04X}h in {pdo.name}'


def _default(dictionary: ObjectDictionary, index: int) -> int | None:
    variable = dictionary.get_variable(index)
    return variable.default if variable is not None else None


def _homing_methods(dictionary: ObjectDictionary) -> tuple[int, ...]:
    """Return the defaults of 60E3h, where the EDS has them."""
    return tuple(
        variable.default for variable in variables(dictionary)
        if variable.index == 0x60E3 and variable.subindex and variable.default)


def differences(drive: SdoChannel, profile: DriveProfile, axis: AxisSettings) -> list[str]:
    """
    Return everything in which a drive departs from its profile; nothing is written.

    Raises a DriveTimeoutError if the drive stops answering, a ParameterError if the profile's EDS
    cannot be read.
    """
    dictionary = read_dictionary(profile.eds, drive.node_id)
    axis = profile.applied(axis)
    found = list(unit_conflicts(drive, axis))
    try:
        check_identity(drive.name, read_identity(drive), axis, {})
    except DriveIdentityError as error:
        found.append(str(error))
    if not profile.stops_without_master:
        found.append('by its profile it does not stop when this computer falls silent')
    for item in profile.objects:
        problem = _problem(drive, dictionary, item.index, item.subindex)
        if problem and item.required:
            found.append(f'{problem}; the profile requires it for {item.value}')
        elif problem and 'bytes' in problem:
            found.append(problem)
    for pdo in profile.pdos:
        found += filter(None, (
            _problem(drive, dictionary, pdo.mapping_index, 0),
            *(_problem(drive, dictionary, entry.index, entry.subindex)
              for entry in pdo.content if pdo.is_transmitted)))
    with suppress(SdoAbortError):
        if not (modes := drive.read_number(0x6502)) & _CYCLIC_POSITION:
            found.append(f'it has no cyclic synchronous position (6502h = {modes:X}h)')
    return found


def _problem(
    drive: SdoChannel, dictionary: ObjectDictionary, index: int, subindex: int
) -> str | None:
    label = f'object {index:04X}h:{subindex:02X}'
    try:
        size = len(drive.read(index, subindex))
    except SdoAbortError as error:
        return f'{label} cannot be read ({error})'
    variable = dictionary.get_variable(index, subindex)
    if variable is None:
        return None
    expected = len(variable) // 8
    return None if size == expected else f'{label} has {size} bytes, by its EDS {expected}'
