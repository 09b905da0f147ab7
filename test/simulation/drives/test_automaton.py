"""A simulated drive in every state, with every controlword."""

from drive_bench import Bench
import pytest

from facade_manipulator.drives.states import Controlword, POWERED_STATES, State

# IEC 61800-7-201, tables "device control commands" and "state transitions"
COMMAND_BITS = (  # fault reset, enable operation, quick stop, enable voltage, switch on
    ('0x110', Controlword.SHUTDOWN), ('00111', Controlword.SWITCH_ON),
    ('01111', Controlword.ENABLE_OPERATION), ('0xx0x', Controlword.DISABLE_VOLTAGE),
    ('0x01x', Controlword.QUICK_STOP), ('1xxxx', Controlword.FAULT_RESET),
)
UP, ON, RUN, DOWN, STOP, RESET = (command for _, command in COMMAND_BITS)
STANDARD = {  # by state: the state after each command that changes it
    State.SWITCH_ON_DISABLED: {UP: State.READY_TO_SWITCH_ON},
    State.READY_TO_SWITCH_ON: {
        ON: State.SWITCHED_ON, RUN: State.OPERATION_ENABLED,
        DOWN: State.SWITCH_ON_DISABLED, STOP: State.SWITCH_ON_DISABLED},
    State.SWITCHED_ON: {
        RUN: State.OPERATION_ENABLED, UP: State.READY_TO_SWITCH_ON,
        DOWN: State.SWITCH_ON_DISABLED, STOP: State.SWITCH_ON_DISABLED},
    State.OPERATION_ENABLED: {
        ON: State.SWITCHED_ON, UP: State.READY_TO_SWITCH_ON,
        DOWN: State.SWITCH_ON_DISABLED, STOP: State.QUICK_STOP_ACTIVE},
    State.QUICK_STOP_ACTIVE: {DOWN: State.SWITCH_ON_DISABLED, RUN: State.OPERATION_ENABLED},
    State.FAULT_REACTION_ACTIVE: {},
    State.FAULT: {RESET: State.SWITCH_ON_DISABLED},
}


def standard_command(bits):
    command, = {command for pattern, command in COMMAND_BITS
                if all(p in ('x', b) for p, b in zip(pattern, bits, strict=True))}
    return command


def in_state(state):
    """Return a bench whose drive is in a state; its controlword is that of the state."""
    bench = Bench().configure()
    if state in POWERED_STATES - {State.OPERATION_ENABLED}:
        bench.enable().move_at(0.2, 20)
    else:
        bench.go(state if state is not State.FAULT else State.SWITCHED_ON)
    if state is State.QUICK_STOP_ACTIVE:
        bench.controlword = 0x02
        bench.cycle(1)
    elif state in (State.FAULT, State.FAULT_REACTION_ACTIVE):
        bench.controlword = 0
        bench.drive.inject_fault(0x8611)
    return bench


@pytest.mark.parametrize('state', STANDARD)
def test_drive_in_any_state_obeys_each_controlword(state):
    bench = in_state(state)
    assert bench.drive.state is state
    axis, errors = bench.drive.axis, list(bench.drive.errors)
    before = axis._controlword, axis._stop
    for controlword in range(0x200):
        axis.state = state
        axis._controlword, axis._stop = before
        bench.drive.errors = list(errors)
        axis.control(controlword)
        command = standard_command(tuple(str(controlword >> bit & 1) for bit in (7, 3, 2, 1, 0)))
        assert bench.drive.state is STANDARD[state].get(command, state), hex(controlword)
