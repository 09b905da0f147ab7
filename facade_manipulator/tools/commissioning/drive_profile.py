"""
Drive profiles: one drafted from a maker's EDS, one held against a real drive.

References
----------
CiA 402-2: supported drive modes 6502h, supported homing methods 60E3h, SI unit velocity 60A9h.

"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
import json
from pathlib import Path
import shutil
from tempfile import TemporaryDirectory
from typing import NamedTuple

from canopen import ObjectDictionary

from facade_manipulator.drives.canopen import (
    misfit,
    read_dictionary,
    SdoAbortError,
    SdoChannel,
    stated,
    variables,
)
from facade_manipulator.drives.cia402 import (
    AxisSettings,
    DriveProfile,
    load_profile,
    ProfileObject,
    VELOCITY_UNITS,
)
from facade_manipulator.drives.controller import (
    check_identity,
    ControllerSettings,
    object_writes,
    read_identity,
    unit_conflicts,
)
from facade_manipulator.errors import DriveIdentityError, ManipulatorError

TEMPLATE = 'generic_cia402'
_CYCLIC_POSITION = 1 << 7  # in 6502h
_MAXON, _MAXONS_HOME = 0xFB, 0x30B0  # in place of 607Ch
_QUESTIONS = {
    'boots_operational': 'does it enter NMT Operational by itself after boot-up?',
    'zero_statusword_until_controlword': 'is 6041h zero until the first controlword?',
    'pdo_only_on_sync': 'does it send TPDOs only in answer to a SYNC?',
    'never_follows': 'does bit 12 of 6041h stay 0 in cyclic synchronous position?',
}
_ASKED = {'velocity_unit', 'motor_speed_unit', 'homing_methods', *_QUESTIONS}


class Draft(NamedTuple):
    """A profile drafted from an EDS, and whether its drive can be used."""

    text: str  #: YAML; what only the maker or the drive can say stands in it as questions
    deadly: list[str]  #: why the drive cannot be used
    reservations: list[str]  #: what it lacks that others have, or does not say
    without: list[str]  #: optional objects that it does without

    @property
    def verdict(self) -> str:
        """One line for the operator."""
        if self.deadly:
            return 'not drivable, because:'
        return 'drivable, but:' if self.reservations else 'drivable.'


def draft(
    eds: Path, axes: Iterable[AxisSettings], previous: str = '', needs_stop: bool = True
) -> Draft:
    """
    Evaluate a maker's EDS or DCF, and draft a profile from it.

    Parameters
    ----------
    eds : Path
    axes : iterable of AxisSettings
        Whose values its limits must take.
    previous : str
        An earlier draft, whose answers are kept.
    needs_stop : bool
        Whether a drive that a dead master does not stop cannot be used.

    Raises
    ------
    ParameterError
        The EDS cannot be read.

    """
    dictionary = read_dictionary(eds)
    objects, reservations, without = _objects(dictionary)
    deadly = list(_mode_lack(dictionary))
    if not {0x1016, 0x6007} <= {item.index for item in objects}:
        (deadly if needs_stop else reservations).append(
            'a dead master does not stop it: 1016h:01 or 6007h:00 is missing')
    text = _text(eds, dictionary, objects, previous)
    try:
        broken = _broken(text, eds, dictionary, axes)
    except ManipulatorError as error:
        reason = str(error).rpartition('is not valid: ')[2]
        return Draft(text, [*deadly, reason], reservations, without)
    for item, problem in broken.items():
        objects.remove(item)
        if item.value == 'following_error_time' and not misfit(
                dictionary.get_variable(item.index, item.subindex), 0):
            objects.append(item._replace(value=0))  # trips at once
        elif item.required or item.value == 'interpolation_period':
            deadly.append(f'{problem} ({item.value})')
        else:
            without.append(f'{problem} ({item.value})')
    if stated(dictionary.get_variable(0x6502)) is None:
        reservations.append('6502h does not say whether it has cyclic synchronous position')
    return Draft(_text(eds, dictionary, objects, previous), deadly, reservations, without)


def _objects(dictionary: ObjectDictionary) -> tuple[list[ProfileObject], list[str], list[str]]:
    """Return what can be written of the template, and what is lacking: required and optional."""
    objects: list[ProfileObject] = []
    reservations: list[str] = []
    without: list[str] = []
    for item in load_profile(TEMPLATE).objects:
        if item.index not in dictionary and item.value == 'home_position' and (
                dictionary.device_information.vendor_number == _MAXON):
            item = item._replace(index=_MAXONS_HOME)
        if dictionary.get_variable(item.index, item.subindex) is not None:
            objects.append(item)
        elif item.index not in (0x1016, 0x6007):
            (reservations if item.required else without).append(
                f'object {item.index:04X}h:{item.subindex:02X} for {item.value} is missing')
    reservations += [
        f'{name} cannot carry object {index:04X}h' for name, index in _unmapped(dictionary)]
    return objects, reservations, without


def _mode_lack(dictionary: ObjectDictionary) -> Iterator[str]:
    modes = stated(dictionary.get_variable(0x6502))
    if modes is not None and not modes & _CYCLIC_POSITION:
        yield f'it has no cyclic synchronous position (6502h = {modes:X}h, bit 7)'


def _broken(
    text: str, eds: Path, dictionary: ObjectDictionary, axes: Iterable[AxisSettings]
) -> dict[ProfileObject, str]:
    """Return the objects that do not take the values of all axes; raises a ManipulatorError."""
    with TemporaryDirectory() as folder:
        shutil.copy(eds, folder)
        path = Path(folder) / f'{eds.stem}.yaml'
        path.write_text(text, 'utf-8')
        profile = load_profile(str(path))
    broken = {}
    for axis in axes:
        method = next((one for one in (axis.homing_method, *profile.homing_methods)
                       if one in profile.homing_methods), axis.homing_method)
        writes = object_writes(
            profile, profile.applied(replace(axis, homing_method=method)), ControllerSettings())
        for item, write in zip(profile.objects, writes, strict=True):
            if problem := misfit(dictionary.get_variable(*write[:2]), write.value):
                broken[item] = problem
    return broken


def _text(
    eds: Path, dictionary: ObjectDictionary, objects: list[ProfileObject], previous: str
) -> str:
    template, device = load_profile(TEMPLATE), dictionary.device_information
    answers = {
        line.partition(':')[0].strip(): line.strip() for line in previous.splitlines()
        if line.partition(':')[0].strip() in _ASKED and '# ?' not in line}
    code = stated(dictionary.get_variable(0x60A9))
    unit = next((name for name, one in VELOCITY_UNITS.items() if one.velocity == code), None)
    methods = [found for variable in variables(dictionary) if variable.index == 0x60E3
               and variable.subindex and (found := stated(variable))]

    pdos = dict(_pdos(dictionary, template))
    method = dictionary.get_variable(0x6098)
    known = methods or [one for one in template.homing_methods
                        if method is None or not misfit(method, one)] or [0]

    def asked(name: str, value: object, question: str) -> str:
        return answers.get(name, f'{name}: {value}' + (f'  # ? {question}' if question else ''))

    lines = [f'# Drafted from {eds.name}: answer the lines with a question mark, then try it on '
             'the drive', '# with `commission profile --check`.',
             f'description: {json.dumps(device.product_name or eds.stem)}',
             *(f'{name}: {number}' for name, number in (
                 ('vendor_id', device.vendor_number), ('product_code', device.product_number))
               if number),
             f'eds: {json.dumps(eds.name)}',
             asked('velocity_unit', unit or template.velocity_unit, '' if unit else
                   'in which unit does it state velocities (606Ch, 6081h)?'),
             asked('motor_speed_unit', template.motor_speed_unit, 'in which unit is 6080h?'),
             asked('homing_methods', known, '' if methods else
                   'which does its manual name?'),
             'quirks:', *('  ' + asked(name, 'false', text) for name, text in _QUESTIONS.items()),
             'pdos:' if pdos else 'pdos: {}',
             *(f'  {name}: [{", ".join(indices)}]' for name, indices in pdos.items()),
             'objects:']
    lines += [f'  - {{index: 0x{item.index:04X}, subindex: {item.subindex}, value: {item.value}, '
              f'required: {str(item.required or item.index in (0x1016, 0x6007)).lower()}}}'
              for item in objects]
    return '\n'.join(lines) + '\n'


def _pdos(
    dictionary: ObjectDictionary, template: DriveProfile
) -> Iterator[tuple[str, list[str]]]:
    """Yield the process data of the template that the drive can carry."""
    unmapped = set(_unmapped(dictionary))
    for one in template.pdos:
        indices = [f'0x{index:04X}' for index in one.indices if (one.name, index) not in unmapped]
        if indices:
            yield one.name, indices


def _unmapped(dictionary: ObjectDictionary) -> Iterator[tuple[str, int]]:
    for one in load_profile(TEMPLATE).pdos:
        for entry in one.content:
            variable = dictionary.get_variable(entry.index, entry.subindex)
            if one.mapping_index not in dictionary or variable is None or (
                    not variable.pdo_mappable):
                yield one.name, entry.index


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
