"""Every reply and every stop names a next step in requests, and these requests work."""

from dataclasses import replace

from drive_rig import at_rest, inactive, SETTINGS
import pytest
from support import wait_until

from facade_manipulator.drives.controller.snapshot import ControllerState

PATIENT = replace(SETTINGS, heartbeat_timeout=1.0, boot_timeout=5.0)  # of a busy computer
REQUESTS = (
    'configure', 'home', 'activate', 'halt', 'clear_faults', 'deactivate', 'self_test', 'cleanup')


@pytest.fixture
def rig(make_rig):
    """Make a controller that a busy computer does not stop."""
    return make_rig(settings=PATIENT)


def fault(code):
    def inject(rig):
        at_rest(rig)
        with rig.simulator.access() as drives:
            drives[1].inject_fault(code)
        rig.until_stopped()
        with rig.simulator.access() as drives:
            drives[1].remove_cause()

    return inject


def restarted(rig):
    at_rest(rig)
    with rig.simulator.access() as drives:
        drives[1].reboot()
    rig.until_stopped()


def halted(rig):
    at_rest(rig)
    rig.do('halt')


STATES = {
    'unconfigured': lambda rig: None,
    'not homed': lambda rig: rig.do('configure'),
    'inactive': inactive,
    'active': at_rest,
    'halted': halted,
    'stopped by a following error': fault(0x8611),
    'stopped by a lost position': fault(0x7392),
    'stopped by a restart': restarted,
}


def requests_of(message: str) -> list[str]:
    """Return the requests of the next step that a message names, in their order."""
    words = message.rpartition('next: ')[2].rpartition('then ')[2].split(', ')
    assert set(words) <= set(REQUESTS), message
    return words


def follow(rig, message: str) -> None:
    """Do what a message says is next; afterwards the drives follow setpoints."""
    wait_until(lambda: rig.controller.snapshot().stamp or rig.state.value == 'unconfigured', 'it')
    rig.do(*requests_of(message))
    rig.until(ControllerState.ACTIVE)


def reply(rig, request: str) -> str:
    return rig.rejection(request) or ''


@pytest.mark.parametrize('state', STATES)
def test_the_next_step_of_every_state_leads_to_drives_that_follow(rig, state):
    STATES[state](rig)
    step = rig.controller.snapshot().next_step
    if rig.state is ControllerState.ACTIVE:
        assert step == ''
    else:
        follow(rig, step)


@pytest.mark.parametrize('state', STATES)
def test_the_next_step_of_every_rejection_leads_to_drives_that_follow(make_rig, state):
    """Each once in a state: a rejection leaves the rig where it was, for the next request."""
    rig, followed = None, []
    for request in REQUESTS:
        if rig is None:
            rig = make_rig(settings=PATIENT)
            STATES[state](rig)
            # that of the state leads there, as the test above shows
            followed = followed or [requests_of(rig.controller.snapshot().next_step or 'halt')]
        message = reply(rig, request)
        if message and (rig.state is ControllerState.ACTIVE or requests_of(message) in followed):
            continue
        if message:
            followed.append(requests_of(message))
            follow(rig, message)
        rig.close()
        rig = None


@pytest.mark.quick
def test_every_reply_to_a_request_that_is_done_names_the_next_one(rig):
    assert requests_of(rig.do('configure')) == ['home', 'activate']
    assert requests_of(rig.do('home')) == ['activate']
    assert 'next' not in rig.do('activate')
    assert requests_of(rig.do('halt')) == ['clear_faults']
    assert 'next' not in rig.do('clear_faults')
    assert requests_of(rig.do('deactivate')) == ['activate']
    assert requests_of(rig.do('cleanup')) == ['configure', 'home', 'activate']


@pytest.mark.quick
def test_what_only_hands_can_change_comes_before_the_next_configure(rig):
    rig.drives[1].is_silent = True
    said = reply(rig, 'configure')
    assert 'q2 (node 2) sent no boot-up' in said and '. The bus is ' in said
    assert said.endswith('next: put that right at the drive, then configure, home, activate')
    assert rig.state is ControllerState.UNCONFIGURED
    rig.drives[1].is_silent = False
    follow(rig, said)
