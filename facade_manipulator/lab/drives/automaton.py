"""
The finite state automaton of a CiA 402 drive as tables: commands and what they do in each state.

References
----------
IEC 61800-7-201 (CiA 402-2), "Power drive systems": finite state automaton, tables of controlword
commands and transitions.

"""

from __future__ import annotations

from enum import Enum

from facade_manipulator.drives.cia402 import State


class DeviceCommand(Enum):
    """What a controlword commands."""

    DISABLE_VOLTAGE = 'disable voltage'
    QUICK_STOP = 'quick stop'
    SHUTDOWN = 'shutdown'
    SWITCH_ON = 'switch on'
    ENABLE_OPERATION = 'enable operation'
    FAULT_RESET = 'fault reset'

    __hash__ = object.__hash__


# mask and value of the controlword for each command; the masks of no two commands overlap
CONTROLWORDS = {
    DeviceCommand.DISABLE_VOLTAGE: (0x82, 0x00),
    DeviceCommand.QUICK_STOP: (0x86, 0x02),
    DeviceCommand.SHUTDOWN: (0x87, 0x06),
    DeviceCommand.SWITCH_ON: (0x8F, 0x07),
    DeviceCommand.ENABLE_OPERATION: (0x8F, 0x0F),
    DeviceCommand.FAULT_RESET: (0x80, 0x80),
}

# what a command does in a state; a pair that is not here changes nothing
TRANSITIONS = {
    (State.SWITCH_ON_DISABLED, DeviceCommand.SHUTDOWN): State.READY_TO_SWITCH_ON,
    (State.READY_TO_SWITCH_ON, DeviceCommand.SWITCH_ON): State.SWITCHED_ON,
    (State.READY_TO_SWITCH_ON, DeviceCommand.ENABLE_OPERATION): State.OPERATION_ENABLED,
    (State.READY_TO_SWITCH_ON, DeviceCommand.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.READY_TO_SWITCH_ON, DeviceCommand.QUICK_STOP): State.SWITCH_ON_DISABLED,
    (State.SWITCHED_ON, DeviceCommand.ENABLE_OPERATION): State.OPERATION_ENABLED,
    (State.SWITCHED_ON, DeviceCommand.SHUTDOWN): State.READY_TO_SWITCH_ON,
    (State.SWITCHED_ON, DeviceCommand.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.SWITCHED_ON, DeviceCommand.QUICK_STOP): State.SWITCH_ON_DISABLED,
    (State.OPERATION_ENABLED, DeviceCommand.SWITCH_ON): State.SWITCHED_ON,
    (State.OPERATION_ENABLED, DeviceCommand.SHUTDOWN): State.READY_TO_SWITCH_ON,
    (State.OPERATION_ENABLED, DeviceCommand.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.OPERATION_ENABLED, DeviceCommand.QUICK_STOP): State.QUICK_STOP_ACTIVE,
    (State.QUICK_STOP_ACTIVE, DeviceCommand.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.QUICK_STOP_ACTIVE, DeviceCommand.ENABLE_OPERATION): State.OPERATION_ENABLED,
    (State.FAULT, DeviceCommand.FAULT_RESET): State.SWITCH_ON_DISABLED,
}

# what the drive does by itself: after its initialisation, at the end of the fault reaction
AUTOMATIC_TRANSITIONS = {
    State.NOT_READY_TO_SWITCH_ON: State.SWITCH_ON_DISABLED,
    State.FAULT_REACTION_ACTIVE: State.FAULT,
}

_COMMAND_OF_BITS = {
    bits: command
    for command, (mask, value) in CONTROLWORDS.items()
    for bits in range(0x100) if bits & mask == value
}


def decode_command(controlword: int) -> DeviceCommand:
    """Return the command that a controlword gives; every controlword gives exactly one."""
    return _COMMAND_OF_BITS[controlword & 0xFF]
