"""
Emergency messages: their error codes, and the text, remedy and reaction for each code.

References
----------
CiA 301: emergency object and error codes; IEC 61800-7-201 (CiA 402-2): error codes of drives.

"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

import yaml

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


@cache
def read_faults() -> dict[str, Fault]:
    """
    Return the faults by code: four hexadecimal digits; a last digit x matches any digit.

    The first call reads the table in 10 to 50 ms. A control loop calls it before its first cycle.
    """
    rows = yaml.safe_load(config_path('error_codes.yaml').read_text('utf-8'))
    return {code: Fault(**row) for code, row in rows.items()}


def fault(code: int, own: Mapping[int, Fault]) -> Fault:
    """
    Return the meaning of an error code received in 603Fh or in an emergency message.

    `own` contains the codes to which the maker of the drive gives another meaning. Otherwise the
    row of the table with the fewest x applies.
    """
    digits = f'{code:04X}'
    rows = read_faults()
    found = rows['xxxx']
    for exact in (1, 2, 3, 4):  # number of digits that are not x
        found = rows.get(digits[:exact].ljust(4, 'x'), found)
    found = own.get(code, found)
    return found._replace(message=f'{found.message} (error code {digits}h)')


def error_code(data: bytes) -> int:
    """Return the error code in an emergency message."""
    return int.from_bytes(data[:ERROR_CODE_LENGTH], 'little')


def is_error_reset(code: int) -> bool:
    """Return whether an emergency message with this code reports that the error has ended."""
    return code & 0xFF00 == 0
