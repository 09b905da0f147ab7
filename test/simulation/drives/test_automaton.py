"""Simulated drive in every state, with every controlword."""

import pytest
from simulation.drives.bench import Bench

from facade_manipulator.drives.states import Controlword, State

# IEC 61800-7-201, tables "device control commands" and "state transitions"
COMMAND_BITS = (  # fault reset, enable operation, quick stop, enable voltage, switch on
    ('0x110', Controlword.SHUTDOWN),
    ('00111', Controlword.SWITCH_ON),
    ('01111', Controlword.ENABLE_OPERATION),
    ('0xx0x', Controlword.DISABLE_VOLTAGE),
    ('0x01x', Controlword.QUICK_STOP),
    ('1xxxx', Controlword.FAULT_RESET),
)
UP, ON, RUN, DOWN, STOP, RESET = (command for _, command in COMMAND_BITS)
STANDARD = {  # by state: the state after each command that changes the state
    State.SWITCH_ON_DISABLED: {UP: State.READY_TO_SWITCH_ON},
    State.READY_TO_SWITCH_ON: {
        ON: State.SWITCHED_ON,
        RUN: State.OPERATION_ENABLED,
        DOWN: State.SWITCH_ON_DISABLED,
        STOP: State.SWITCH_ON_DISABLED,
    },
    State.SWITCHED_ON: {
        RUN: State.OPERATION_ENABLED,
        UP: State.READY_TO_SWITCH_ON,
        DOWN: State.SWITCH_ON_DISABLED,
        STOP: State.SWITCH_ON_DISABLED,
    },
    State.OPERATION_ENABLED: {
        ON: State.SWITCHED_ON,
        UP: State.READY_TO_SWITCH_ON,
        DOWN: State.SWITCH_ON_DISABLED,
        STOP: State.QUICK_STOP_ACTIVE,
    },
    State.QUICK_STOP_ACTIVE: {
        DOWN: State.SWITCH_ON_DISABLED,
        RUN: State.OPERATION_ENABLED,
    },
    State.FAULT_REACTION_ACTIVE: {},
    State.FAULT: {RESET: State.SWITCH_ON_DISABLED},
}


def has_pattern(bits, pattern):
    return all(p in ('x', b) for p, b in zip(pattern, bits, strict=True))


def standard_command(controlword):
    bits = [str(controlword >> bit & 1) for bit in (7, 3, 2, 1, 0)]
    (command,) = [one for pattern, one in COMMAND_BITS if has_pattern(bits, pattern)]
    return command


@pytest.mark.parametrize('state', STANDARD)
def test_simulated_drive_in_any_state_obeys_each_controlword(state):
    drive = Bench().configure().drive
    for controlword in range(0x200):
        drive.axis.control(Controlword.QUICK_STOP)  # the fault reset is an edge
        drive.axis.state = state
        drive.errors = [0x8611] * (state is State.FAULT)
        drive.axis.control(controlword)
        command = standard_command(controlword)
        assert drive.axis.state is STANDARD[state].get(command, state), hex(controlword)
