"""Every reply and every state names the next requests, and these lead to active drives."""

from __future__ import annotations

from drive_faults import at_rest, configured
import pytest

from facade_manipulator.drives.controller import REQUESTS
from facade_manipulator.drives.controller_state import ControllerState


def halted(rig):
    at_rest(rig)
    rig.request('halt')


STATES = {
    'unconfigured': (lambda rig: None, ['configure', 'home', 'activate']),
    'not homed': (lambda rig: rig.request('configure'), ['home', 'activate']),
    'inactive': (configured, ['activate']),
    'halted': (halted, ['clear_faults']),
}


def requests_of(message: str) -> list[str]:
    """Return the requests of the next step that a message names, in their order."""
    words = message.rpartition('next: ')[2].rpartition('then ')[2].split(', ')
    assert {*words} <= {*REQUESTS}, message
    return words


@pytest.mark.parametrize('state', STATES)
def test_next_step_of_every_rejection_leads_to_active_drives(rig, state):
    get_there, steps = STATES[state]
    get_there(rig)
    assert requests_of(rig.snapshot.next_step) == steps
    before = rig.state
    for request in ('clear_faults', 'deactivate', 'cleanup', 'self_test', 'home', 'activate'):
        if rig.state is before and (message := rig.rejection(request)):
            assert requests_of(message) == steps
    rig.recover()


def test_every_reply_names_the_next_request(rig):
    assert requests_of(rig.request('configure')) == ['home', 'activate']
    assert requests_of(rig.request('home')) == ['activate']
    assert 'next' not in rig.request('activate')
    assert requests_of(rig.request('halt')) == ['clear_faults']
    assert 'next' not in rig.request('clear_faults')
    assert requests_of(rig.request('deactivate')) == ['activate']
    assert requests_of(rig.request('cleanup')) == ['configure', 'home', 'activate']


def test_repair_by_hand_comes_before_the_next_configure(rig):
    rig.drives[1].is_silent = True
    message = rig.rejection('configure')
    assert 'q2 (node 2) sent no boot-up' in message and '. The bus is can0' in message
    assert message.endswith('next: put that right at the drive, then configure, home, activate')
    assert rig.state is ControllerState.UNCONFIGURED
    rig.repair()
    rig.recover()
