"""
CiA 402 power state machine for a master: states, statuswords, controlwords and modes.

The behaviour of a drive is in `facade_manipulator.simulation.drives.automaton`.

References
----------
IEC 61800-7-201 (CiA 402-2), "Power drive systems": finite state automaton, tables of controlword
commands and statusword coding.

"""

from __future__ import annotations

from enum import Enum, IntEnum
from functools import cache
from typing import NamedTuple


class State(Enum):
    """State of the power drive system."""

    NOT_READY_TO_SWITCH_ON = 'not ready to switch on'
    SWITCH_ON_DISABLED = 'switch on disabled'
    READY_TO_SWITCH_ON = 'ready to switch on'
    SWITCHED_ON = 'switched on'
    OPERATION_ENABLED = 'operation enabled'
    QUICK_STOP_ACTIVE = 'quick stop active'
    FAULT_REACTION_ACTIVE = 'fault reaction active'
    FAULT = 'fault'

    __hash__ = object.__hash__  # the tables are looked up at every SYNC


class Status(IntEnum):
    """Used bits of the statusword 6041h; the meaning of bits 12 and 13 depends on the mode."""

    OPERATION_ENABLED = 0x0004
    FAULT = 0x0008
    VOLTAGE_ENABLED = 0x0010
    SWITCH_ON_DISABLED = 0x0040
    REMOTE = 0x0200
    TARGET_REACHED = 0x0400
    HOMING_ATTAINED = 0x1000
    DRIVE_FOLLOWS = 0x1000
    HOMING_ERROR = 0x2000
    FOLLOWING_ERROR = 0x2000


class DigitalInput(IntEnum):
    """Used bits of the digital inputs 60FDh."""

    NEGATIVE_LIMIT_SWITCH = 0x1
    POSITIVE_LIMIT_SWITCH = 0x2
    HOME_SWITCH = 0x4


class Controlword(IntEnum):
    """Controlword 6040h for each command, and the bits that modes add to 0x0F."""

    DISABLE_VOLTAGE = 0x0000
    QUICK_STOP = 0x0002
    SHUTDOWN = 0x0006
    SWITCH_ON = 0x0007
    DISABLE_OPERATION = 0x0007
    ENABLE_OPERATION = 0x000F
    HOMING_START = 0x0010
    NEW_TARGET = 0x0010
    FAULT_RESET = 0x0080


class Mode(IntEnum):
    """Modes of operation 6060h used by this package."""

    NONE = 0
    HOMING = 6
    CYCLIC_SYNCHRONOUS_POSITION = 8


class AxisCommand(NamedTuple):
    """Controlword and mode of operation for one drive."""

    controlword: int
    mode: int


# mask and value of the statusword in each state
STATUSWORDS = {
    State.NOT_READY_TO_SWITCH_ON: (0x4F, 0x00),
    State.SWITCH_ON_DISABLED: (0x4F, 0x40),
    State.READY_TO_SWITCH_ON: (0x6F, 0x21),
    State.SWITCHED_ON: (0x6F, 0x23),
    State.OPERATION_ENABLED: (0x6F, 0x27),
    State.QUICK_STOP_ACTIVE: (0x6F, 0x07),
    State.FAULT_REACTION_ACTIVE: (0x4F, 0x0F),
    State.FAULT: (0x4F, 0x08),
}

POWERED_STATES = frozenset(
    {
        State.OPERATION_ENABLED,
        State.QUICK_STOP_ACTIVE,
        State.FAULT_REACTION_ACTIVE,
    }
)
# states in which the motor has no power; only the commands that switch on can give power
UNPOWERED_STATES = frozenset(
    {
        State.NOT_READY_TO_SWITCH_ON,
        State.SWITCH_ON_DISABLED,
        State.FAULT,
    }
)


class Power(Enum):
    """Power state of a drive's motor according to the statusword."""

    CONFIRMED_OFF = 'confirmed off'  #: its own statusword confirms it
    UNKNOWN = 'unknown'  #: no answer, or a statusword without a state of CiA 402
    ON = 'on'  #: or being switched on or off


@cache
def decode_state(statusword: int) -> State | None:
    """Return the state encoded in a statusword; None for 52 of the 64 bit patterns."""
    return next(
        (
            state
            for state, (mask, value) in STATUSWORDS.items()
            if statusword & mask == value
        ),
        None,
    )


def describe_state(statusword: int) -> str:
    """Describe state and statusword, and the bits that make the state invalid."""
    number = f'(statusword {statusword:04X}h)'
    state = decode_state(statusword)
    if state is not None:
        return f'the state {state.value} {number}'

    def difference(nearest: State) -> int:
        mask, value = STATUSWORDS[nearest]
        return (statusword & mask) ^ value

    nearest = min(STATUSWORDS, key=lambda one: difference(one).bit_count())
    bits = [bit for bit in range(16) if difference(nearest) >> bit & 1]
    changed = ' and '.join(f'bit {bit} = {1 - (statusword >> bit & 1)}' for bit in bits)
    return f'no state of CiA 402 {number}; it would be {nearest.value} with {changed}'
