"""
Emergency messages: bytes, and a table from error codes to messages, reactions and next steps.

References
----------
CiA 301, emergency object and error codes; IEC 61800-7-201 (CiA 402-2), error codes of drives.
Codes that end in 80h to FFh are a manufacturer's; where other makers' manuals are silent or
agree, their meaning follows the maxon EPOS4. What FFxxh means the drive's profile says: FF02h is
a watchdog to maxon, a bit of profile position mode to Technosoft. A failed sensor is 7300h to Elmo
and Faulhaber, 7320h to maxon ("the position is no longer valid"), 7303h to 7307h to CiA 402: an
incremental encoder that missed counts is right again only after homing, whatever the code.

"""

from __future__ import annotations

from collections.abc import Mapping
import struct
from types import MappingProxyType
from typing import NamedTuple

_MANUAL = 'look up the error code in the manual of the drive'
_BUS = 'check wiring and termination of the bus'
_SENSOR = 'check the encoder and its cable'
_RESTORE = 'restore the drive from its backup (commission restore)'
_COOL = 'let motor and drive cool down, check load and ventilation'
_MOTOR = 'check the motor cable, and what blocks the carriage'
_SUPPLY = 'check the supply of the drive and its fuses'
_HELD = 'check what holds the carriage back (its load, its brake, limits of the drive)'
_LIMIT = 'move the carriage inside its stroke by hand, check home_position and the stroke'
_REPLACE = 'replace the drive if the fault returns'
_MASTER = _BUS + ', and the load of this computer if its control loop was late'


class Fault(NamedTuple):
    """What an error code means; all three drives stop, unless it is a warning."""

    message: str  #: what happened, without the code
    remedy: str = _MANUAL  #: what the operator does before the drives are asked again
    #: whether the drive's position can no longer be trusted: all lose power, too, and home again
    loses_position: bool = False
    is_warning: bool = False  #: whether the maker calls it one: it stops nothing


class Emergency(NamedTuple):
    """An emergency message: code, error register 1001 and five bytes of the manufacturer's."""

    code: int
    register: int = 0
    vendor_data: bytes = bytes(5)


_STRUCT = struct.Struct('<HB5s')

# by code, in which x is any digit; the row with the fewest x counts
_FAULTS = {
    '2310': Fault('the motor current is too high', _MOTOR),
    '2320': Fault(
        'the power stage has shut itself off', 'check the motor cable for a short circuit'),
    '3210': Fault('the supply voltage is too high', 'check the supply and its brake chopper'),
    '3220': Fault('the supply voltage is too low', _SUPPLY),
    '6010': Fault('the watchdog of the drive has restarted it', _REPLACE, loses_position=True),
    '6310': Fault('the drive has lost its parameters', _RESTORE),
    '6320': Fault(
        'a drive parameter is not valid',
        'compare the drive with its profile (commission profile --check)'),
    '6380': Fault('the stored parameters of the drive are damaged', _RESTORE),
    '7121': Fault('the motor is blocked', 'find out what holds the carriage'),
    '7392': Fault(
        'the position sensor counts against the motor', _SENSOR, loses_position=True),
    '8110': Fault('the drive has lost CAN frames', _BUS),
    '8120': Fault('the drive is error passive on the CAN bus', _BUS),
    '8130': Fault('the drive misses the heartbeat of the master', _MASTER),
    '8140': Fault('the drive has recovered from bus-off', _BUS),
    '8150': Fault('two CAN nodes send with the same identifier', _BUS),
    '8210': Fault('the drive has received a process data object of wrong length', _BUS),
    '8250': Fault('the drive misses its process data', _BUS),
    '8611': Fault('the following error is beyond its window', _HELD),
    '8612': Fault('a reference limit has been met', _LIMIT),
    '8A80': Fault('the carriage is on its negative limit switch', _LIMIT),
    '8A81': Fault('the carriage is on its positive limit switch', _LIMIT),
    '8A82': Fault('the carriage is beyond a software position limit', _LIMIT),
    '8A88': Fault('safe torque off is open', 'close the safety circuit of the drive (STO)'),
    '511x': Fault('the logic supply voltage is too low', 'check the logic supply of the drive'),
    '8A8x': Fault('the carriage is at a limit', _LIMIT),
    '73xx': Fault(
        'a sensor of the motor has failed and the position is lost', _SENSOR,
        loses_position=True),
    '81xx': Fault('communication with the drive is disturbed', _BUS),
    '82xx': Fault('the drive has rejected a frame', _BUS),
    '83xx': Fault(
        'the torque controller has failed',
        'check the motor cable and the tuning of the torque controller'),
    '84xx': Fault(
        'the speed controller has failed, or it is too fast',
        'check the encoder and the tuning of the speed controller'),
    '86xx': Fault('the position controller has failed', _HELD),
    'FFxx': Fault('a fault specific to the manufacturer'),
    '1xxx': Fault('a fault that the drive does not specify'),
    '2xxx': Fault('a fault of the motor current', _MOTOR),
    '3xxx': Fault('a fault of the supply voltage', _SUPPLY),
    '4xxx': Fault('the motor or the drive is too hot', _COOL),
    '5xxx': Fault('a fault of the drive hardware', _REPLACE),
    '6xxx': Fault('a fault of the drive software', _REPLACE),
    '7xxx': Fault(
        'a fault of a sensor or an additional module', _SENSOR + ', and the modules of the drive'),
    '8xxx': Fault('a fault found by monitoring'),
    '9xxx': Fault('an external fault', 'check the device at the fault input of the drive'),
}
_UNKNOWN = Fault('a fault with a code that is in no table')
_NO_FAULT = Fault('no fault', '')
_NONE: Mapping[int, Fault] = MappingProxyType({})


def fault(code: int, own: Mapping[int, Fault] = _NONE) -> Fault:
    """
    Return what an error code of 603F or of an emergency message means; any code has a row.

    `own` has the codes to which the drive's maker gives a meaning of its own.
    """
    if is_error_reset(code):
        return _NO_FAULT
    if code in own:
        return own[code]
    digits = f'{code:04X}'
    rows = (digits[:known].ljust(4, 'x') for known in (4, 3, 2, 1))
    return next((_FAULTS[row] for row in rows if row in _FAULTS), _UNKNOWN)


def describe(code: int, own: Mapping[int, Fault] = _NONE) -> str:
    """Return a message for an operator, with the code in CiA's notation."""
    return f'{fault(code, own).message} (error code {code:04X}h)'


def is_error_reset(code: int) -> bool:
    """Return whether an emergency message says that errors are gone rather than come."""
    return code & 0xFF00 == 0


def decode_emergency(data: bytes) -> Emergency:
    """Read the eight bytes of an emergency message."""
    return Emergency(*_STRUCT.unpack(data))
