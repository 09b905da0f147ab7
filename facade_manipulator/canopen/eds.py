"""
Reader of manufacturers' electronic data sheets, which are first converted to CiA 306 spelling.

References
----------
CiA 306: electronic data sheet (EDS) and device configuration file (DCF).

"""

from __future__ import annotations

from collections.abc import Mapping
from configparser import RawConfigParser
from io import StringIO
from pathlib import Path
import re

from canopen import ObjectDictionary
from canopen.objectdictionary import datatypes, eds, ODVariable

from facade_manipulator.errors import ParameterError

_WHOLE_NUMBERS = frozenset(
    {
        'ObjectType',
        'DataType',
        'PDOMapping',
        'CompactSubObj',
        'NrOfEntries',
        'VendorNumber',
        'ProductNumber',
        'RevisionNumber',
    }
)
_VALUES = frozenset({'LowLimit', 'HighLimit', 'DefaultValue', 'ParameterValue'})


def read_dictionary(path: Path, node_id: int | None = None) -> ObjectDictionary:
    """
    Return the object dictionary of an EDS or DCF; accept common deviations from CiA 306.

    The text may be UTF-8 or in a Windows code page. The text may contain names in any case, tabs,
    and numbers that are empty, octal or without 0x. An object without a data type is left out.
    Raises a ParameterError with the reason for any other deviation.
    """
    data = path.read_bytes()
    try:
        text = data.decode('utf-8-sig')
    except UnicodeDecodeError:
        text = data.decode('cp1252', 'replace')
    try:
        dictionary = eds.import_eds(_normalised(text), node_id)
        if not dictionary:
            raise ValueError('it contains no objects')
    except Exception as error:  # the library may raise any exception
        reason = ' '.join(str(error).split())
        raise ParameterError(
            f'{path} is not a readable EDS or DCF: {reason}; next: correct the '
            'file as in CiA 306'
        ) from error
    return dictionary


_KEYS = {
    name.lower(): name
    for name in (
        *_WHOLE_NUMBERS,
        *_VALUES,
        'ParameterName',
        'AccessType',
        'VendorName',
        'ProductName',
    )
}


def _normalised(text: str) -> StringIO:
    """Return the text in the form that `canopen` reads: each object before its sub-objects."""
    found = RawConfigParser(inline_comment_prefixes=(';',))
    found.optionxform = lambda key: _KEYS.get(key.lower(), key)  # type: ignore
    found.read_string('\n'.join(line.strip() for line in text.splitlines()))
    lines = []
    for section in sorted(found.sections(), key=str.upper):
        name = _section_name(section)
        entries = _entries(name, found[section])
        if entries is not None:
            lines.append(f'[{name}]')
            lines += [f'{key}={value}' for key, value in entries.items()]
    return StringIO('\n'.join(lines))


def _section_name(section: str) -> str:
    """Return the name of a section in the spelling that the library `canopen` expects."""
    name = section.upper().replace('SUB', 'sub').replace('NAME', 'Name')
    return name.replace('DEVICEINFO', 'DeviceInfo')


# DATA_TYPES are strings and domains
_NOT_WHOLE = frozenset({*datatypes.FLOAT_TYPES, *datatypes.DATA_TYPES})


def _entries(name: str, section: Mapping[str, str]) -> dict[str, str] | None:
    """Return the entries of a section; None for an object without a data type."""
    entries = {'ParameterName': name}
    for key, value in section.items():
        if value:
            entries[key] = _number(value) if key in _WHOLE_NUMBERS else value

    data_type = int(entries.get('DataType', '0'), 0)
    is_composite = int(entries.get('ObjectType', '0'), 0) in (eds.ARR, eds.RECORD)
    is_object = re.fullmatch('[0-9A-F]+(sub[0-9A-F]+)?', name) is not None
    if is_object and not data_type and not is_composite:
        return None
    if data_type not in _NOT_WHOLE:
        for key in _VALUES & entries.keys():
            entries[key] = _number(entries[key])
    return entries


def _number(text: str) -> str:
    """Return a number in Python's notation; accept hexadecimal without 0x and CiA 306 octal."""
    if not re.fullmatch('[0-9A-Fa-f]+', text):
        return text
    base = 10
    if not text.isdecimal():
        base = 16
    elif text.startswith('0') and not set(text) & {'8', '9'}:
        base = 8
    return str(int(text, base))


def variables(dictionary: ObjectDictionary) -> dict[tuple[int, int], ODVariable]:
    """Return all variables of an object dictionary, by index and subindex."""
    found = {}
    for entry in dictionary.values():
        parts = [entry] if isinstance(entry, ODVariable) else entry.values()
        for variable in parts:
            found[variable.index, variable.subindex] = variable
    return found
