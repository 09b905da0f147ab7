from facade_manipulator.drives.states import decode_state, STATUSWORDS


def test_no_statusword_names_two_states():
    for word in range(0x10000):
        names = [s for s, (mask, value) in STATUSWORDS.items() if word & mask == value]
        assert names == ([] if decode_state(word) is None else [decode_state(word)])
