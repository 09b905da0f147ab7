"""
Electronic data sheets: read, however carelessly they were written, and what they allow.

References
----------
CiA 306: electronic data sheet (EDS) and device configuration file (DCF).

"""

from __future__ import annotations

from collections.abc import Iterator
from io import StringIO
from pathlib import Path
import re

from canopen import ObjectDictionary
from canopen.objectdictionary import eds, ODVariable

from facade_manipulator.errors import ParameterError

_NUMBERS = frozenset({
    'ObjectType', 'DataType', 'SubNumber', 'PDOMapping', 'LowLimit', 'HighLimit', 'DefaultValue',
    'ParameterValue', 'VendorNumber', 'ProductNumber', 'RevisionNumber', 'NrOfRXPDO', 'NrOfTXPDO',
    'Granularity'})
_UNUSED = ('[Comments]', '[DummyUsage]')
_TEXT_TYPES = frozenset({0x09, 0x0A, 0x0B, 0x0F})
_SECTIONS = re.compile(r'^(?=\[)', re.MULTILINE)
_OBJECT = re.compile(r'\[[0-9A-F]{4}(sub[0-9A-F]+)?\]', re.IGNORECASE)
_TYPE = re.compile(r'^\s*(DataType|SubNumber|CompactSubObj)\s*=', re.MULTILINE)
_LINE = re.compile(r'\s*(\w+)\s*=\s*([^;]*?)\s*(;.*)?$')


def read_dictionary(path: Path, node_id: int | None = None) -> ObjectDictionary:
    """
    Read an EDS or DCF in UTF-8 or a Windows code page, with empty, unprefixed and octal numbers.

    An object without a data type is left out. Raises a ParameterError for what cannot be read.
    """
    try:
        return eds.import_eds(StringIO('\n'.join(_repaired(_typed(_text(path))))), node_id)
    except Exception as error:  # whatever the library trips over in a maker's file
        raise ParameterError(f'{path} is no EDS or DCF that can be read: {error}') from error


def _text(path: Path) -> str:
    data = path.read_bytes()
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError:
        return data.decode('cp1252', 'replace')


def _typed(text: str) -> str:
    """Return the text without objects that are neither typed nor records or arrays."""
    return ''.join(section for section in _SECTIONS.split(text)
                   if not _OBJECT.match(section) or _TYPE.search(section))


def _repaired(text: str) -> Iterator[str]:
    """Yield the lines, with numbers that Python reads, and without those that say nothing."""
    section, data_type = '', 0
    for line in text.splitlines():
        if line.startswith('['):
            section, data_type = line.strip(), 0
        match = _LINE.match(line)
        if section in _UNUSED or match and match[1] in _NUMBERS and not match[2]:
            continue
        if match and match[1] in _NUMBERS and data_type not in _TEXT_TYPES:
            value = _number(match[2])
            line = f'{match[1]}={value}'
            data_type = int(value, 0) if match[1] == 'DataType' else data_type
        yield line


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
