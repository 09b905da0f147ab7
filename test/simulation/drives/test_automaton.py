"""A simulated drive in every state, with every controlword."""

from functools import cache

from drive_bench import Bench
import pytest

from facade_manipulator.drives.states import Controlword, POWERED_STATES, State

# IEC 61800-7-201, tables "device control commands" and "state transitions", by their numbers
COMMAND_BITS = (  # fault reset, enable operation, quick stop, enable voltage, switch on
    ('0x110', Controlword.SHUTDOWN), ('00111', Controlword.SWITCH_ON),
    ('01111', Controlword.ENABLE_OPERATION), ('0xx0x', Controlword.DISABLE_VOLTAGE),
    ('0x01x', Controlword.QUICK_STOP), ('1xxxx', Controlword.FAULT_RESET),
)
STANDARD = {
    2: (State.SWITCH_ON_DISABLED, Controlword.SHUTDOWN, State.READY_TO_SWITCH_ON),
    3: (State.READY_TO_SWITCH_ON, Controlword.SWITCH_ON, State.SWITCHED_ON),
    4: (State.SWITCHED_ON, Controlword.ENABLE_OPERATION, State.OPERATION_ENABLED),
    5: (State.OPERATION_ENABLED, Controlword.SWITCH_ON, State.SWITCHED_ON),
    6: (State.SWITCHED_ON, Controlword.SHUTDOWN, State.READY_TO_SWITCH_ON),
    7: (State.READY_TO_SWITCH_ON, Controlword.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),
    8: (State.OPERATION_ENABLED, Controlword.SHUTDOWN, State.READY_TO_SWITCH_ON),
    9: (State.OPERATION_ENABLED, Controlword.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),
    10: (State.SWITCHED_ON, Controlword.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),
    11: (State.OPERATION_ENABLED, Controlword.QUICK_STOP, State.QUICK_STOP_ACTIVE),
    12: (State.QUICK_STOP_ACTIVE, Controlword.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),
    15: (State.FAULT, Controlword.FAULT_RESET, State.SWITCH_ON_DISABLED),
    16: (State.QUICK_STOP_ACTIVE, Controlword.ENABLE_OPERATION, State.OPERATION_ENABLED),
}
QUICK_STOP_IS_DISABLE = ((State.READY_TO_SWITCH_ON, 7), (State.SWITCHED_ON, 10))
TWO_STEPS = (State.READY_TO_SWITCH_ON, Controlword.ENABLE_OPERATION)  # transitions 3 and 4


@cache
def standard_command(bits):
    matches = {command for pattern, command in COMMAND_BITS
               if all(p in ('x', b) for p, b in zip(pattern, bits, strict=True))}
    assert len(matches) == 1
    return matches.pop()


def standard_table():
    table = {(state, command): result for state, command, result in STANDARD.values()}
    for state, number in QUICK_STOP_IS_DISABLE:
        table[state, Controlword.QUICK_STOP] = STANDARD[number][2]
    table[TWO_STEPS] = State.OPERATION_ENABLED
    return table


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


@pytest.mark.parametrize('state', [
    state for state in State if state is not State.NOT_READY_TO_SWITCH_ON])
def test_drive_in_any_state_obeys_each_controlword(state):
    bench, table = in_state(state), standard_table()
    assert bench.drive.state is state
    axis, errors = bench.drive.axis, list(bench.drive.errors)
    before = axis._controlword, axis._stop
    for controlword in range(0x200):
        axis.state = state
        axis._controlword, axis._stop = before
        bench.drive.errors = list(errors)
        axis.control(controlword)
        command = standard_command(tuple(str(controlword >> bit & 1) for bit in (7, 3, 2, 1, 0)))
        assert bench.drive.state is table.get((state, command), state), hex(controlword)
