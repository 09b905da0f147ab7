"""
Read electronic data sheets of makers after conversion to the spelling of CiA 306.

References
----------
CiA 306: electronic data sheet (EDS) and device configuration file (DCF).

"""

from __future__ import annotations

from configparser import RawConfigParser
from io import StringIO
from pathlib import Path
import re

from canopen import ObjectDictionary
from canopen.objectdictionary import eds, ODVariable

from facade_manipulator.errors import ParameterError

_SECTIONS = {  # CiA 306 itself misspells the last one
    'deviceinfo': 'DeviceInfo', 'devicecomissioning': 'DeviceComissioning'}
_OBJECT = re.compile('([0-9A-F]{2,4})(?:SUB([0-9A-F]+)|(NAME))?', re.IGNORECASE)
_WHOLE_NUMBERS = frozenset({
    'ObjectType', 'DataType', 'PDOMapping', 'CompactSubObj', 'NrOfEntries', 'NodeID',
    'VendorNumber', 'ProductNumber', 'RevisionNumber'})
_VALUES = frozenset({'LowLimit', 'HighLimit', 'DefaultValue', 'ParameterValue'})
_KEYS = {name.lower(): name for name in (
    *_WHOLE_NUMBERS, *_VALUES, 'ParameterName', 'AccessType', 'VendorName', 'ProductName')}
_NOT_WHOLE = frozenset({0x08, 0x09, 0x0A, 0x0B, 0x0F, 0x11})  # types: real numbers, texts, bytes
_COMPOSITES = (8, 9)  # object types: array, record


def read_dictionary(path: Path, node_id: int | None = None) -> ObjectDictionary:
    """
    Read an EDS or DCF, including the usual deviations of makers from CiA 306.

    The text may be UTF-8 or in a Windows code page. It may have names in any case, tabs, and
    numbers that are empty, octal or without 0x. An object without a data type is left out.
    Raises a ParameterError with the reason for any other deviation.
    """
    try:
        return eds.import_eds(_normalised(_text(path)), node_id)
    except Exception as error:  # the library raises any error for a maker's file
        reason = ' '.join(str(error).split())
        raise ParameterError(f'{path} is no EDS or DCF that can be read: {reason}') from error


def _text(path: Path) -> str:
    data = path.read_bytes()
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError:
        return data.decode('cp1252', 'replace')


def _normalised(text: str) -> StringIO:
    """Return the text in the form that `canopen` reads: each object, then its sub-objects."""
    found, lines = RawConfigParser(inline_comment_prefixes=(';',)), list[str]()
    found.optionxform = lambda key: _KEYS.get(key.lower(), key)  # type: ignore
    found.read_string('\n'.join(line.strip() for line in text.splitlines()))
    sections = {known: found[name] for name in found if (known := _section_name(name))}
    if not any(map(_OBJECT.fullmatch, sections)):
        raise ValueError('it has no objects')
    for name in sorted(sections):
        entries = {'ParameterName': name} | {
            key: _number(value) if key in _WHOLE_NUMBERS else value
            for key, value in sections[name].items() if value}
        data_type = int(entries.get('DataType', '0'), 0)
        is_variable = int(entries.get('ObjectType', '7'), 0) not in _COMPOSITES
        if _OBJECT.fullmatch(name) and is_variable and not data_type and 'Name' not in name:
            continue
        if data_type not in _NOT_WHOLE:
            entries |= {key: _number(entries[key]) for key in _VALUES & entries.keys()}
        lines += [f'[{name}]', *(f'{key}={value}' for key, value in entries.items())]
    return StringIO('\n'.join(lines))


def _section_name(text: str) -> str | None:
    """Return the library's name of a section, None for a section that it does not use."""
    match = _OBJECT.fullmatch(text)
    if match is None:
        return _SECTIONS.get(text.lower())
    index, subindex, names = match.groups('')
    return index.upper() + (f'sub{int(subindex, 16):X}' if subindex else names.capitalize())


def _number(text: str) -> str:
    """Return a number as Python reads it; accept hexadecimal without 0x and octal of CiA 306."""
    if re.fullmatch('[0-9A-Fa-f]*[A-Fa-f][0-9A-Fa-f]*', text):
        return f'0x{text}'
    if re.fullmatch('0[0-9]+', text):
        return str(int(text, 10 if set(text) & {'8', '9'} else 8))
    return text


def variables(dictionary: ObjectDictionary) -> dict[tuple[int, int], ODVariable]:
    """Return all variables of an object dictionary by index and subindex."""
    found = [one for entry in dictionary.values()
             for one in ([entry] if isinstance(entry, ODVariable) else entry.values())]
    return {(one.index, one.subindex): one for one in found}
