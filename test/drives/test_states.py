"""
Values of CiA 402, written here from the standard.

The simulated drive shares the tables of the package. It would obey a wrong value, which a real
drive does not.
"""

import pytest

from facade_manipulator.drives.states import Controlword, DigitalInput, Mode, Status

COMMANDS = [  # in CiA 402 the bits x have no effect on the command
    (Controlword.SHUTDOWN, '0xxxx110'),
    (Controlword.SWITCH_ON, '0xxx0111'),
    (Controlword.DISABLE_VOLTAGE, '0xxxxx0x'),
    (Controlword.QUICK_STOP, '0xxxx01x'),
    (Controlword.DISABLE_OPERATION, '0xxx0111'),
    (Controlword.ENABLE_OPERATION, '0xxx1111'),
    (Controlword.FAULT_RESET, '1xxxxxxx'),
]


@pytest.mark.parametrize(('command', 'pattern'), COMMANDS)
def test_controlword_has_the_pattern_of_cia_402(command, pattern):
    bits = f'{command:08b}'
    assert all(p in ('x', bit) for p, bit in zip(pattern, bits, strict=True))


@pytest.mark.parametrize('command', [command for command, _ in COMMANDS])
def test_command_sets_no_mode_specific_bit(command):
    """Bits 4 to 6 belong to the mode, bit 8 is halt, and the higher bits are reserved."""
    assert command & ~0x8F == 0


@pytest.mark.parametrize(
    ('mask', 'bit'),
    [
        (Controlword.HOMING_START, 4),
        (Controlword.NEW_TARGET, 4),
        (Status.FAULT, 3),
        (Status.VOLTAGE_ENABLED, 4),
        (Status.SWITCH_ON_DISABLED, 6),
        (Status.REMOTE, 9),
        (Status.TARGET_REACHED, 10),
        (Status.HOMING_ATTAINED, 12),
        (Status.HOMING_ERROR, 13),
        (Status.DRIVE_FOLLOWS, 12),
        (Status.FOLLOWING_ERROR, 13),
        (DigitalInput.NEGATIVE_LIMIT_SWITCH, 0),
        (DigitalInput.POSITIVE_LIMIT_SWITCH, 1),
        (DigitalInput.HOME_SWITCH, 2),
    ],
)
def test_flag_has_its_bit_of_cia_402(mask, bit):
    assert mask == 1 << bit


def test_modes_have_their_numbers_of_cia_402():
    assert Mode.NONE == 0
    assert Mode.HOMING == 6
    assert Mode.CYCLIC_SYNCHRONOUS_POSITION == 8
