from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.states import decode_state, STATUSWORDS
from facade_manipulator.errors import DriveStateError


def test_no_statusword_names_two_states():
    for word in range(0x10000):
        names = [s for s, (mask, value) in STATUSWORDS.items() if word & mask == value]
        try:
            assert [decode_state(word)] == names
        except DriveStateError as error:
            assert not names and f'{word:04X}' in str(error)


def test_qualities_of_controller_states_agree():
    def those(quality):
        return {state.name for state in ControllerState if getattr(state, quality)}

    following = {'HOLDING', 'ACTIVE', 'RAMPING', 'HALTED'}
    active = following | {'ACTIVATING', 'HALTING', 'DEACTIVATING'}
    assert (those('is_following'), those('is_active')) == (following, active)
    assert (those('has_power'), those('is_stopped')) == (
        active | {'HOMING'}, {'STOPPING', 'STOPPED'})
