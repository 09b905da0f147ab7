from functools import cache
import itertools

from facade_manipulator.drives.cia402.states import Controlword, State
from facade_manipulator.lab.drives.automaton import decode_command, MASKS, TRANSITIONS

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


def test_every_controlword_gives_one_command_and_it_is_the_standards():
    for word in range(0x10000):
        matches = [command for command, mask in MASKS.items() if word & mask == command]
        bits = tuple(str(word >> bit & 1) for bit in (7, 3, 2, 1, 0))
        assert matches == [decode_command(word)] == [standard_command(bits)]


def test_all_states_and_all_commands_go_where_the_standard_says():
    table = standard_table()
    for state, command in itertools.product(State, MASKS):
        assert TRANSITIONS.get((state, command), state) is table.get((state, command), state)
