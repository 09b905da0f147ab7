"""
Electronic data sheets as makers write them: brought into the spelling of CiA 306, then read.

References
----------
CiA 306: electronic data sheet (EDS) and device configuration file (DCF).

"""

from __future__ import annotations

import codecs
from collections.abc import Iterator
from io import StringIO
from pathlib import Path
import re

from canopen import ObjectDictionary
from canopen.objectdictionary import eds, ODVariable

from facade_manipulator.errors import ParameterError

_SECTIONS = {  # CiA 306 itself misspells the last one
    'deviceinfo': 'DeviceInfo', 'devicecomissioning': 'DeviceComissioning'}
_WHOLE_NUMBERS = frozenset({
    'ObjectType', 'DataType', 'SubNumber', 'PDOMapping', 'CompactSubObj', 'NrOfEntries', 'NodeID',
    'VendorNumber', 'ProductNumber', 'RevisionNumber'})
_VALUES = frozenset({'LowLimit', 'HighLimit', 'DefaultValue', 'ParameterValue'})
_ENTRIES = {name.lower(): name for name in (
    *_WHOLE_NUMBERS, *_VALUES, 'ParameterName', 'AccessType', 'VendorName', 'ProductName')}
_NOT_WHOLE = frozenset({0x08, 0x09, 0x0A, 0x0B, 0x0F, 0x11})  # types: real numbers, texts, bytes
_ARRAY, _RECORD = 8, 9
_OBJECT = re.compile('([0-9A-F]{2,4})(?:SUB([0-9A-F]+)|(NAME))?', re.IGNORECASE)
_COMMENT = re.compile(r'^\s*[;#].*|\s;.*')
Sections = dict[str, dict[str, str]]


def read_dictionary(path: Path, node_id: int | None = None) -> ObjectDictionary:
    """
    Read an EDS or DCF, also one that departs from CiA 306 as makers' files do.

    It may be UTF-8, UTF-16 or of a Windows code page, have names in any case, tabs, numbers that
    are empty, octal or without 0x, and sub-objects without their object. What it repeats must be
    the same. An object without a data type is left out. Raises a ParameterError with the line and
    the reason for anything else.
    """
    try:
        return eds.import_eds(StringIO('\n'.join(_lines(_sections(_text(path))))), node_id)
    except Exception as error:  # whatever the library trips over in a maker's file
        raise ParameterError(f'{path} is no EDS or DCF that can be read: {error}') from error


def _text(path: Path) -> str:
    data = path.read_bytes()
    is_wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return data.decode('utf-16' if is_wide else 'utf-8-sig')
    except UnicodeDecodeError:
        return data.decode('cp1252', 'replace')


def _sections(text: str) -> Sections:
    """Return the entries of the objects' sections, by the names that the library looks for."""
    sections: Sections = {}
    name: str | None = ''
    for number, line in enumerate(text.splitlines(), start=1):
        line = _COMMENT.sub('', line).strip()
        if line.startswith('['):
            name = _section_name(line.strip('[] \t'))
            sections.setdefault(name or '', {})
        elif line and name is not None:
            key, sign, value = (part.strip() for part in line.partition('='))
            key = _ENTRIES.get(key.lower(), key)
            value = _number(value) if key in _WHOLE_NUMBERS else value
            before = sections[name].setdefault(key, value) if value and name else value
            if not sign or not name:
                raise ValueError(f'line {number}: {line!r} is not an entry of a section')
            if key in _WHOLE_NUMBERS and not re.fullmatch('|0x[0-9A-F]+|[0-9]+', value, re.I):
                raise ValueError(f'line {number}: {key}={value} of [{name}] is not a number')
            if before != value:
                raise ValueError(f'line {number}: {key}={value} of [{name}] was {before} before')
    if not any(map(_OBJECT.fullmatch, sections)):
        raise ValueError('it has no objects')
    return sections


def _section_name(text: str) -> str | None:
    """Return how the library calls a section, None if it has no use for it."""
    match = _OBJECT.fullmatch(text)
    if match is None:
        return _SECTIONS.get(text.lower())
    index, subindex, names = match.groups('')
    return index.upper() + (f'sub{int(subindex, 16):X}' if subindex else names.capitalize())


def _lines(sections: Sections) -> Iterator[str]:
    """Yield what the library reads: each object, then its sub-objects."""
    parents = {index for index, sign, _ in (name.partition('sub') for name in sections) if sign}
    for name in sorted(parents | sections.keys() - {''}):
        entries = {'ParameterName': name, **sections.get(name, {})}
        data_type = int(entries.get('DataType', '0'), 0)
        is_composite = int(entries.get('ObjectType', '0'), 0) in (_ARRAY, _RECORD)
        if name in parents and not is_composite:
            entries['ObjectType'] = str(_RECORD)
        elif _OBJECT.fullmatch(name) and not (data_type or is_composite or 'Name' in name):
            continue
        yield f'[{name}]'
        for key, value in entries.items():
            is_number = key in _VALUES and data_type not in _NOT_WHOLE
            yield f'{key}={_number(value) if is_number else value}'


def _number(text: str) -> str:
    """Return a number as Python reads it: hexadecimal without 0x, octal as CiA 306 has it."""
    if re.fullmatch('[0-9A-Fa-f]*[A-Fa-f][0-9A-Fa-f]*', text):
        return f'0x{text}'
    if re.fullmatch('0[0-9]+', text):
        return str(int(text, 10 if set(text) & {'8', '9'} else 8))
    return text


def variables(dictionary: ObjectDictionary) -> Iterator[ODVariable]:
    """Yield all variables of an object dictionary."""
    for entry in dictionary.values():
        yield from [entry] if isinstance(entry, ODVariable) else entry.values()


def stated(variable: ODVariable | None) -> int | None:
    """Return what a file says is in an object: a DCF its value, an EDS its default."""
    if variable is None:
        return None
    return variable.default if variable.value is None else variable.value


def misfit(variable: ODVariable | None, value: int) -> str:
    """Return why an object does not take a value; ``''`` if it does, or has it for good."""
    if variable is None:
        return 'the object is missing'
    label = f'{variable.index:04X}h:{variable.subindex:02X}'
    if not variable.writable:
        found = stated(variable)
        return '' if found == value else (
            f'{label} is {variable.access_type}, {"of unknown value" if found is None else found}'
            f' for good, not {value}')
    bits, signed = len(variable), variable.data_type in eds.datatypes.SIGNED_TYPES
    low, high = (-1 << bits - 1, (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
    low = low if variable.min is None else max(low, variable.min)
    high = high if variable.max is None else min(high, variable.max)
    return '' if low <= value <= high else f'{label} takes {low} to {high}, not {value}'
