"""
Finite state automaton of a CiA 402 drive as tables of commands and transitions.

References
----------
IEC 61800-7-201 (CiA 402-2), "Power drive systems": finite state automaton, tables of controlword
commands and transitions.

"""

from __future__ import annotations

from canopen.profiles.p402 import State402

from facade_manipulator.drives.states import Controlword, State

_WITHOUT_COMMAND = ('START', 'NOT READY TO SWITCH ON', 'FAULT REACTION ACTIVE')

# next state by state and command; a missing pair keeps the state
TRANSITIONS = {
    (State(before.lower()), Controlword(command)): State(after.lower())
    for (before, after), command in State402.TRANSITIONTABLE.items()
    if before not in _WITHOUT_COMMAND
} | {  # the library's table is for masters and lacks these transitions
    (State.READY_TO_SWITCH_ON, Controlword.ENABLE_OPERATION): State.OPERATION_ENABLED,
    (State.READY_TO_SWITCH_ON, Controlword.QUICK_STOP): State.SWITCH_ON_DISABLED,
    (State.SWITCHED_ON, Controlword.QUICK_STOP): State.SWITCH_ON_DISABLED,
}


# mask of the controlword bits that identify each command; every controlword is one command
_MASKS = {
    Controlword.DISABLE_VOLTAGE: 0x82,
    Controlword.QUICK_STOP: 0x86,
    Controlword.SHUTDOWN: 0x87,
    Controlword.SWITCH_ON: 0x8F,
    Controlword.ENABLE_OPERATION: 0x8F,
    Controlword.FAULT_RESET: 0x80,
}


def decode_command(controlword: int) -> Controlword:
    """Return the command encoded in a controlword."""
    return next(
        command for command, mask in _MASKS.items() if controlword & mask == command
    )
