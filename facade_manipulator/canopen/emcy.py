"""
Emergency messages: their error codes, and the text, remedy and reaction for each code.

References
----------
CiA 301: emergency object and error codes; IEC 61800-7-201 (CiA 402-2): error codes of drives.

"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
import re
from typing import Any, NamedTuple

import yaml

from facade_manipulator.errors import ParameterError
from facade_manipulator.package_files import config_path

ERROR_CODE_LENGTH = 2  # bytes; an emergency message begins with its error code


class Fault(NamedTuple):
    """Meaning of an error code; all three drives stop unless the code is a warning."""

    message: str  #: description; for a received fault it ends with the error code
    #: action of the operator before the next clear_faults
    remedy: str = 'look up the error code in the manual of the drive'
    #: whether the position of the drive is no longer valid; all drives then lose power, and the
    #: axis of this drive must home again
    loses_position: bool = False
    is_warning: bool = False  #: a warning of the maker, which does not stop the drives


# four hexadecimal digits; a last digit x matches any digit
_ROW = re.compile('(?=.{4}$)[0-9A-F]*x*')
_HIGHEST_CODE = 0xFFFF
# A number up to this one may be four hexadecimal digits without quotes, or a number with 0x.
_HIGHEST_UNCLEAR_CODE = 9999


def row_of(code: Any) -> str:
    """
    Return the four digits of an error code in a file, such as ``'8A80'``, ``'FFxx'`` or 0xFF01.

    Raises a ValueError for anything else, and for a number that may lack its quotes: YAML reads
    ``7580`` as a decimal number, which no error code would match.
    """
    if isinstance(code, str) and _ROW.fullmatch(code):
        return code
    if type(code) is not int:
        remedy = "write four hexadecimal digits, such as '8A80' or 'FFxx'"
    elif _HIGHEST_UNCLEAR_CODE < code <= _HIGHEST_CODE:
        return f'{code:04X}'
    else:
        remedy = f"write four hexadecimal digits in quotes, '{code}' or '{code:04X}'"
        if not 0 <= code <= _HIGHEST_UNCLEAR_CODE:
            remedy = 'write four hexadecimal digits in quotes'
    raise ValueError(f'error code {code!r} is not valid; next: {remedy}')


@cache
def read_faults() -> dict[str, Fault]:
    """
    Return the faults by code: four hexadecimal digits; a last digit x matches any digit.

    The first call reads the table in 10 to 50 ms. A control loop calls it before its first cycle.
    Raises a ParameterError for a code that `row_of` rejects.
    """
    path = config_path('error_codes.yaml')
    rows = yaml.safe_load(path.read_text('utf-8'))
    try:
        return {row_of(code): Fault(**row) for code, row in rows.items()}
    except ValueError as error:
        raise ParameterError(f'{path}: {error}') from error


def _narrowest(rows: Mapping[str, Fault], digits: str) -> Fault | None:
    """Return the row with the fewest x that matches four digits; None without a row."""
    found = None
    for exact in range(5):  # number of digits that are not x
        found = rows.get(digits[:exact].ljust(4, 'x'), found)
    return found


def fault(code: int, own: Mapping[str, Fault]) -> Fault:
    """
    Return the meaning of an error code received in 603Fh or in an emergency message.

    `own` contains the codes to which the maker of the drive gives another meaning. Of these, or
    else of the table, the row with the fewest x applies.
    """
    digits = f'{code:04X}'
    table = read_faults()
    found = _narrowest(own, digits) or _narrowest(table, digits) or table['xxxx']
    return found._replace(message=f'{found.message} (error code {digits}h)')


def error_code(data: bytes) -> int:
    """Return the error code in an emergency message."""
    return int.from_bytes(data[:ERROR_CODE_LENGTH], 'little')


def is_error_reset(code: int) -> bool:
    """Return whether an emergency message with this code reports that the error has ended."""
    return code & 0xFF00 == 0
