"""
Emergency stop through inputs of the drives, which report no error code.

Requests while the stop is pressed, and its release, move no carriage. The carriages home with a
switch, so that each request could move them.
"""

from bus_world import Rig, SITUATIONS, SWITCH_HOMING
from drive_faults import quick_stop_input, safe_torque_off_without_code
import pytest

from facade_manipulator.drives.snapshot import ControllerState

pytestmark = pytest.mark.long

AT_REST = 1e-5  # m, by which a carriage that holds its position may move
ANSWER_BOUND = 20.0  # s, of a request that fails
REQUESTS = ('clear_faults', 'activate', 'home')
# a request that fails stops the drives again
WHILE_PRESSED = ('clear_faults', 'activate', 'clear_faults', 'home', 'clear_faults')


def press(rig, fault):
    """Open the inputs of all drives and wait until the carriages are at rest."""
    for number in range(len(rig.drives)):
        rig.inject(number, fault)
    rig.until_stopped()
    rig.course = None  # no sender repeats its goal
    rig.run(1.0)


def require_rest(rig, places):
    """Fail if a carriage is not at its place [m]."""
    assert rig.carriages == pytest.approx(places, abs=AT_REST)


def ask_at_rest(rig, name, places):
    """Send a request; return its error, and fail if a carriage moves until then."""
    job = rig.ask(name)

    def is_answered():
        require_rest(rig, places)
        return job.done()

    rig.until(is_answered, ANSWER_BOUND)
    return job.exception()


@pytest.mark.parametrize('fault', [quick_stop_input, safe_torque_off_without_code])
@pytest.mark.parametrize('situation', ['homing', 'active at rest', 'active in motion'])
def test_no_request_moves_a_carriage_while_pressed(fault, situation):
    rig = Rig(axes=SWITCH_HOMING)
    SITUATIONS[situation](rig)
    press(rig, fault)
    places = rig.carriages

    errors = {}
    for name in WHILE_PRESSED:
        errors[name] = ask_at_rest(rig, name, places)
        assert rig.state is not ControllerState.ACTIVE
    assert errors['activate'] is not None
    # homing was not rejected at once, but its drives did not enable operation
    assert 'it is in the state switched on' in str(errors['home'])


@pytest.mark.parametrize('fault', [quick_stop_input, safe_torque_off_without_code])
@pytest.mark.parametrize('request_name', ['', *REQUESTS])
def test_release_moves_no_carriage(fault, request_name):
    rig = Rig(axes=SWITCH_HOMING)
    SITUATIONS['active in motion'](rig)
    press(rig, fault)
    places = rig.carriages
    if request_name:
        rig.rejection('clear_faults')
        rig.rejection(request_name)
    rig.repair()

    def is_over():
        require_rest(rig, places)
        return rig.clock.now > end

    end = rig.clock.now + 5.0
    rig.until(is_over, 6.0)
    assert rig.state is not ControllerState.ACTIVE
