import pytest

from facade_manipulator.drives.cia402.states import decode_state, STATUSWORDS
from facade_manipulator.errors import DriveStateError


def test_no_statusword_names_two_states():
    for word in range(0x10000):
        names = [s for s, (mask, value) in STATUSWORDS.items() if word & mask == value]
        assert len(names) <= 1
        if names:
            assert decode_state(word) is names[0]
        else:
            with pytest.raises(DriveStateError, match=f'{word:04X}'):
                decode_state(word)


def test_bits_beside_the_states_do_not_matter():
    for state, (_, value) in STATUSWORDS.items():
        for extra in (0x0010, 0x0080, 0x0200, 0x0400, 0x0800, 0x1000, 0x2000, 0xFF90):
            assert decode_state(value | extra) is state
