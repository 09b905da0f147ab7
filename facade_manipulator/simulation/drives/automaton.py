"""
The finite state automaton of a CiA 402 drive as tables: commands and what they do in each state.

References
----------
IEC 61800-7-201 (CiA 402-2), "Power drive systems": finite state automaton, tables of controlword
commands and transitions.

"""

from __future__ import annotations

from facade_manipulator.drives.states import Controlword, State

# which bits of a controlword must be as in a command's own; every controlword gives one command
_MASKS = {
    Controlword.DISABLE_VOLTAGE: 0x82,
    Controlword.QUICK_STOP: 0x86,
    Controlword.SHUTDOWN: 0x87,
    Controlword.SWITCH_ON: 0x8F,
    Controlword.ENABLE_OPERATION: 0x8F,
    Controlword.FAULT_RESET: 0x80,
}

# next state by state and command; a missing pair changes nothing
TRANSITIONS = {
    (State.SWITCH_ON_DISABLED, Controlword.SHUTDOWN): State.READY_TO_SWITCH_ON,
    (State.READY_TO_SWITCH_ON, Controlword.SWITCH_ON): State.SWITCHED_ON,
    (State.READY_TO_SWITCH_ON, Controlword.ENABLE_OPERATION): State.OPERATION_ENABLED,
    (State.READY_TO_SWITCH_ON, Controlword.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.READY_TO_SWITCH_ON, Controlword.QUICK_STOP): State.SWITCH_ON_DISABLED,
    (State.SWITCHED_ON, Controlword.ENABLE_OPERATION): State.OPERATION_ENABLED,
    (State.SWITCHED_ON, Controlword.SHUTDOWN): State.READY_TO_SWITCH_ON,
    (State.SWITCHED_ON, Controlword.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.SWITCHED_ON, Controlword.QUICK_STOP): State.SWITCH_ON_DISABLED,
    (State.OPERATION_ENABLED, Controlword.SWITCH_ON): State.SWITCHED_ON,
    (State.OPERATION_ENABLED, Controlword.SHUTDOWN): State.READY_TO_SWITCH_ON,
    (State.OPERATION_ENABLED, Controlword.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.OPERATION_ENABLED, Controlword.QUICK_STOP): State.QUICK_STOP_ACTIVE,
    (State.QUICK_STOP_ACTIVE, Controlword.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.QUICK_STOP_ACTIVE, Controlword.ENABLE_OPERATION): State.OPERATION_ENABLED,
    (State.FAULT, Controlword.FAULT_RESET): State.SWITCH_ON_DISABLED,
}

_COMMAND_OF_BITS = {
    bits: command
    for command, mask in _MASKS.items() for bits in range(0x100) if bits & mask == command
}


def decode_command(controlword: int) -> Controlword:
    """Return the command that a controlword gives."""
    return _COMMAND_OF_BITS[controlword & 0xFF]
