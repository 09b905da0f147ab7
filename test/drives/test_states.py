from facade_manipulator.drives.states import decode_state, STATUSWORDS
from facade_manipulator.errors import DriveStateError


def test_no_statusword_names_two_states():
    for word in range(0x10000):
        names = [s for s, (mask, value) in STATUSWORDS.items() if word & mask == value]
        try:
            assert [decode_state(word)] == names
        except DriveStateError as error:
            assert not names and f'{word:04X}' in str(error)
