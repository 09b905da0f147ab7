"""
Drive profiles: one drafted from a maker's EDS, one held against a real drive.

References
----------
CiA 402-2: supported drive modes 6502h, supported homing methods 60E3h, SI unit velocity 60A9h.

"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from functools import partial
import json
from pathlib import Path
from typing import NamedTuple

from canopen import ObjectDictionary
import yaml

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.eds import misfit, read_dictionary, stated, variables
from facade_manipulator.canopen.sdo import SdoAbortError, SdoChannel
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.configuration import (
    check_identity,
    compare_objects,
    drive_writes,
    object_writes,
    read_identity,
    read_optional,
    unit_conflicts,
)
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.profile import DriveProfile, load_profile, ProfileObject
from facade_manipulator.drives.units import VELOCITY_UNITS
from facade_manipulator.errors import DriveIdentityError, ParameterError

TEMPLATE = 'generic_cia402'
_CYCLIC_POSITION = 1 << 7  # in 6502h
_MAXON, _MAXONS_HOME = 0xFB, 0x30B0  # in place of 607Ch
# what stops a drive whose master is dead
_STOPS = {0x1016: '1016h', 0x6007: '6007h (where the maker has another object for it, write the '
          'profile by hand, with lost_master_reaction)'}
_QUIRKS = {
    'boots_operational': 'does it enter NMT Operational by itself after boot-up?',
    'never_follows': 'does bit 12 of 6041h stay 0 in cyclic synchronous position?',
}
_NO_RAMP = ('# acceleration_unit: rpm  # ? are 6083h to 6085h and 609Ah in another unit than '
            'velocity_unit per second?')
_NO_ERRORS = ('# errors: {}  # ? which emergency messages does its manual call warnings '
              '(is_warning), which codes are its own?')
_UNITS = ('velocity_unit', 'motor_speed_unit', 'acceleration_unit')
_ASKED = {*_UNITS, 'homing_methods', 'errors', *_QUIRKS}


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

    The EDS's limits must take the axes' values. The answers of an earlier draft are kept.
    `needs_stop` says whether a drive that a dead master does not stop cannot be used. Raises a
    ParameterError if the EDS cannot be read, or the earlier draft has an answer that none can
    be.
    """
    dictionary = read_dictionary(eds)
    lines = _head(eds, dictionary, previous)
    profile = _template(lines)
    found = Draft('', [], [], [])
    fitted = [_fitted(axis, profile) for axis in axes]
    writes = [object_writes(profile, axis, ControllerSettings()) for axis in fitted]
    objects = [
        usable for item, *values in zip(profile.objects, *writes, strict=True)
        if (usable := _usable(item, {one.value for one in values}, dictionary, found))]
    if missing := [label for index, label in _STOPS.items() if index not in dictionary]:
        (found.deadly if needs_stop else found.reservations).append(
            f'a dead master does not stop it: there is no {" and no ".join(missing)}')
    found.reservations.extend(dict.fromkeys(
        f'as it comes, {conflict}' for axis in fitted
        for conflict in unit_conflicts(partial(_stated, dictionary), axis)))
    pdos = _pdos(profile, dictionary, found)
    modes = _stated(dictionary, 0x6502)
    if modes is None:
        found.reservations.append(
            '6502h does not say whether it has cyclic synchronous position')
    elif not modes & _CYCLIC_POSITION:
        found.deadly.append(_no_cyclic_position(modes))
    lines += ['pdos:', *(f'  {name}: [{", ".join(f"0x{index:04X}" for index in indices)}]'
                         for name, indices in pdos.items()), 'objects:']
    lines += [f'  - {{index: 0x{item.index:04X}, subindex: {item.subindex}, value: {item.value}, '
              f'required: {str(item.required or item.index in _STOPS).lower()}}}'
              for item in objects]
    return found._replace(text='\n'.join(lines) + '\n')


def _head(eds: Path, dictionary: ObjectDictionary, previous: str) -> list[str]:
    """Return what a profile says before its objects, unknown answers marked as questions."""
    device = dictionary.device_information
    answers = {name: line.strip() for line in previous.splitlines() if '# ?' not in line
               and (name := line.partition(':')[0].strip()) in _ASKED}
    velocity, acceleration = _stated(dictionary, 0x60A9), _stated(dictionary, 0x60AA)
    unit = next((name for name, one in VELOCITY_UNITS.items() if one.velocity == velocity), None)
    ramp = next((name for name, one in VELOCITY_UNITS.items()
                 if one.acceleration == acceleration), None)
    methods = [found for variable in variables(dictionary) if variable.index == 0x60E3
               and variable.subindex and (found := stated(variable))]
    template, variable = load_profile(TEMPLATE), dictionary.get_variable(0x6098)
    usual = [one for one in template.homing_methods
             if variable is None or not misfit(variable, one)]

    def asked(name: str, known: object, otherwise: object, question: str) -> str:
        return answers.get(name, f'{name}: {known}' if known else (
            f'{name}: {otherwise}  # ? {question}'))

    return [
        f'# Drafted from {eds.name}: answer the lines with a question mark, then try it on '
        'the drive', '# with `commission profile --check`.',
        f'description: {json.dumps(device.product_name or eds.stem)}',
        *(f'{name}: {number}' for name, number in (
            ('vendor_id', device.vendor_number), ('product_code', device.product_number))
          if number),
        f'eds: {json.dumps(eds.name)}',
        asked('velocity_unit', unit, template.velocity_unit,
              'in which unit does it state velocities (606Ch, 6081h)?'),
        asked('motor_speed_unit', None, template.motor_speed_unit, 'in which unit is 6080h?'),
        answers.get('acceleration_unit', f'acceleration_unit: {ramp}' if ramp else _NO_RAMP),
        asked('homing_methods', methods, usual or [0], 'which does its manual name?'),
        answers.get('errors', _NO_ERRORS),
        'quirks:',
        *('  ' + asked(name, None, 'false', question) for name, question in _QUIRKS.items())]


def _template(lines: list[str]) -> DriveProfile:
    """Return the template with the units and homing methods of a draft."""
    given = yaml.safe_load('\n'.join(lines))
    units = {name: given.get(name, given['velocity_unit']) for name in _UNITS}
    if not set(units.values()) <= VELOCITY_UNITS.keys():
        raise ParameterError(f'the draft there is has {units}: each is one of '
                             + ', '.join(VELOCITY_UNITS))
    return replace(load_profile(TEMPLATE), homing_methods=tuple(given['homing_methods']), **units)


def _fitted(axis: AxisSettings, profile: DriveProfile) -> AxisSettings:
    """Return an axis with the drive's units, and a homing method that it has."""
    if axis.homing_method not in profile.homing_methods:
        axis = replace(axis, homing_method=profile.homing_methods[0])
    return profile.applied(axis)


def _usable(
    item: ProfileObject, values: set[int], dictionary: ObjectDictionary, found: Draft
) -> ProfileObject | None:
    """Return an object as it can be written; None, and what that means, if it cannot."""
    if item.value == 'home_position' and item.index not in dictionary and (
            dictionary.device_information.vendor_number == _MAXON):
        item = item._replace(index=_MAXONS_HOME)
    variable = dictionary.get_variable(item.index, item.subindex)
    if variable is None:
        if item.index not in _STOPS:
            (found.reservations if item.required else found.without).append(
                f'object {item.index:04X}h:{item.subindex:02X} for {item.value} is missing')
        return None
    problem = next(filter(None, (misfit(variable, value) for value in values)), '')
    if problem and item.value == 'following_error_time' and not misfit(variable, 0):
        return item._replace(value=0)  # trips at once
    if problem:
        is_needed = item.required or item.value == 'interpolation_period'
        (found.deadly if is_needed else found.without).append(f'{problem} ({item.value})')
    return None if problem else item


def _pdos(
    profile: DriveProfile, dictionary: ObjectDictionary, found: Draft
) -> dict[str, list[int]]:
    """Return the process data that the drive can carry; what it cannot is said."""
    pdos: dict[str, list[int]] = {}
    for one in profile.pdos:
        for entry in one.content:
            variable = dictionary.get_variable(entry.index, entry.subindex)
            if one.mapping_index in dictionary and variable is not None and variable.pdo_mappable:
                pdos.setdefault(one.name, []).append(entry.index)
            else:
                is_needed = entry.index in pdo.COMMANDS | pdo.STATUS
                (found.deadly if is_needed else found.reservations).append(
                    f'{one.name} cannot carry object {entry.index:04X}h')
    return pdos


def _stated(dictionary: ObjectDictionary, index: int, subindex: int = 0) -> int | None:
    return stated(dictionary.get_variable(index, subindex))


def _no_cyclic_position(modes: int) -> str:
    return f'it has no cyclic synchronous position (6502h = {modes:X}h, bit 7)'


def differences(drive: SdoChannel, profile: DriveProfile, axis: AxisSettings) -> list[str]:
    """
    Return everything in which a drive departs from its profile; nothing is written.

    Raises a DriveTimeoutError if the drive stops answering, a ParameterError if the profile's EDS
    cannot be read.
    """
    axis = profile.applied(axis)
    found = list(unit_conflicts(partial(read_optional, drive), axis))
    try:
        check_identity(drive.name, read_identity(drive), axis, {})
    except DriveIdentityError as error:
        found.append(str(error))
    if not profile.stops_without_master:
        found.append('by its profile it does not stop when this computer falls silent')
    writes = drive_writes(profile, axis, ControllerSettings())
    found += compare_objects(drive, writes).lacking
    for index in {index for one in profile.pdos if one.is_transmitted for index in one.indices}:
        try:
            drive.read(index, 0)
        except SdoAbortError as error:
            found.append(str(error))
    with suppress(SdoAbortError):
        if not (modes := drive.read_number(0x6502)) & _CYCLIC_POSITION:
            found.append(_no_cyclic_position(modes))
    return list(dict.fromkeys(found))
