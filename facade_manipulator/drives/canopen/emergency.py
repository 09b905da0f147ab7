"""
Emergency messages: bytes, and a table from error codes to messages, reactions and next steps.

References
----------
CiA 301, emergency object and error codes; IEC 61800-7-201 (CiA 402-2), error codes of drives.
Codes in 738xh, 8A8xh and FFxxh are a manufacturer's; their meaning follows the maxon EPOS4.

"""

from __future__ import annotations

from enum import Enum
import struct
from typing import NamedTuple

from facade_manipulator.errors import InputError


class Reaction(Enum):
    """What the master does with all three drives when one of them reports a fault."""

    QUICK_STOP_ALL = 'quick stop of all axes'
    DISABLE_ALL = 'power off on all axes'


class Fault(NamedTuple):
    """What a fault means."""

    message: str  #: what happened, without the code
    reaction: Reaction  #: what the group of drives does
    home_again: bool  #: whether the drive's position can no longer be trusted
    remedy: str  #: what the operator does about it before the drives are asked again


class Emergency(NamedTuple):
    """An emergency message: code, error register 1001 and five bytes of the manufacturer's."""

    code: int
    register: int = 0
    vendor_data: bytes = bytes(5)


_STRUCT = struct.Struct('<HB5s')

_REMOVE = 'remove the cause'
_BUS = 'check wiring and termination of the bus'
_MASTER = _BUS + ', and the load of this computer if its control loop was late'


def _stop(message: str, remedy: str = _REMOVE) -> Fault:
    return Fault(message, Reaction.QUICK_STOP_ALL, False, remedy)


def _lost(message: str) -> Fault:
    return Fault(message, Reaction.DISABLE_ALL, True, _REMOVE)


# (mask, code): the first entry that matches is taken, so the narrow masks come first
_FAULTS: dict[tuple[int, int], Fault] = {
    (0xFFFF, 0x1000): _stop('a fault that the drive does not specify'),
    (0xFFFF, 0x2310): _stop('the motor current is too high'),
    (0xFFFF, 0x2320): _stop('the power stage has shut itself off'),
    (0xFFFF, 0x3210): _stop('the supply voltage is too high'),
    (0xFFFF, 0x3220): _stop('the supply voltage is too low'),
    (0xFFFF, 0x4210): _stop('the drive is too hot'),
    (0xFFFF, 0x4380): _stop('the motor is too hot'),
    (0xFFFF, 0x5113): _stop('the logic supply voltage is too low'),
    (0xFFFF, 0x6320): _stop('a drive parameter is not valid'),
    (0xFFFF, 0x7320): _stop('the position sensor reports an error'),
    (0xFFFF, 0x7392): _lost('the position sensor counts against the motor'),
    (0xFFFF, 0x8110): _stop('the drive has lost CAN frames', _BUS),
    (0xFFFF, 0x8120): _stop('the drive is error passive on the CAN bus', _BUS),
    (0xFFFF, 0x8130): _stop('the drive misses the heartbeat of the master', _MASTER),
    (0xFFFF, 0x8140): _stop('the drive has recovered from bus-off', _BUS),
    (0xFFFF, 0x8150): _stop('two CAN nodes send with the same identifier', _BUS),
    (0xFFFF, 0x81FD): _stop('the drive has switched itself off the CAN bus', _BUS),
    (0xFFFF, 0x8210): _stop('the drive has received a process data object of wrong length', _BUS),
    (0xFFFF, 0x8250): _stop('the drive misses its process data', _BUS),
    (0xFFFF, 0x8611): _stop('the following error is beyond its window', ''),
    (0xFFFF, 0x8612): _stop('a reference limit has been met', ''),
    (0xFFFF, 0x8A80): _stop('the carriage is on its negative limit switch', ''),
    (0xFFFF, 0x8A81): _stop('the carriage is on its positive limit switch', ''),
    (0xFFFF, 0x8A82): _stop('the carriage is beyond a software position limit', ''),
    (0xFFFF, 0x8A88): _stop('safe torque off is open'),
    (0xFFFF, 0xFF01): _stop('the drive is overloaded'),
    (0xFFFF, 0xFF02): _lost('the watchdog of the drive has restarted it'),
    (0xFFF0, 0x7380): _lost('the position sensor has failed and the position is lost'),
    (0xFFF0, 0x8A80): _stop('the carriage is at a limit', ''),
    (0xFF00, 0x8100): _stop('communication with the drive is disturbed', _BUS),
    (0xFF00, 0x8200): _stop('the drive has rejected a frame', _BUS),
    (0xFF00, 0x8600): _stop('the position controller has failed', ''),
    (0xFF00, 0xFF00): _stop('a fault specific to the manufacturer'),
    (0xF000, 0x1000): _stop('a fault that the drive does not specify'),
    (0xF000, 0x2000): _stop('a fault of the motor current'),
    (0xF000, 0x3000): _stop('a fault of the supply voltage'),
    (0xF000, 0x4000): _stop('a fault of the temperature'),
    (0xF000, 0x5000): _stop('a fault of the drive hardware'),
    (0xF000, 0x6000): _stop('a fault of the drive software'),
    (0xF000, 0x7000): _stop('a fault of a sensor or an additional module'),
    (0xF000, 0x8000): _stop('a fault found by monitoring'),
    (0xF000, 0x9000): _stop('an external fault'),
}
_UNKNOWN = _stop('a fault with a code that is in no table')
_NO_FAULT = Fault('no fault', Reaction.QUICK_STOP_ALL, False, '')


def fault(code: int) -> Fault:
    """Return what an error code of 603F or of an emergency message means; any code has a row."""
    if code & 0xFF00 == 0:
        return _NO_FAULT
    for (mask, value), meaning in _FAULTS.items():
        if code & mask == value:
            return meaning
    return _UNKNOWN


def describe(code: int) -> str:
    """Return a message for an operator, with the code in CiA's notation."""
    return f'{fault(code).message} (error code {code:04X}h)'


def is_error_reset(code: int) -> bool:
    """Return whether an emergency message says that errors are gone rather than come."""
    return code & 0xFF00 == 0


def encode_emergency(emergency: Emergency) -> bytes:
    """Build the eight bytes of an emergency message."""
    return _STRUCT.pack(*emergency)


def decode_emergency(data: bytes) -> Emergency:
    """
    Read an emergency message.

    Raises
    ------
    InputError
        It does not have eight bytes.

    """
    try:
        return Emergency(*_STRUCT.unpack(data))
    except struct.error:
        raise InputError(
            'length', f'an emergency message has {len(data)} bytes, not {_STRUCT.size}') from None
