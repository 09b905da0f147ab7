"""Whatever is asked for, in whatever order: lifecycle and power agree, and all is answered."""

from __future__ import annotations

from concurrent.futures import Future
import time

from drive_rig import Rig
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
from support import wait_until

from facade_manipulator.drives.cia402 import ACTIVE_STATES, ControllerState
from facade_manipulator.drives.cia402.states import State

REQUESTS = ('configure', 'home', 'activate', 'deactivate', 'halt', 'clear_faults', 'cleanup')
MEANING = {'activate': True, 'deactivate': False, 'cleanup': False, 'stop': False}
BOUND = 15.0  # s, for any answer
POWERED = {State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE}
steps = st.lists(
    st.tuples(st.sampled_from([*REQUESTS, 'halt', 'activate', 'stop']),
              st.sampled_from([0.0, 0.0, 0.005, 0.02, 0.06, 0.3])),
    min_size=3, max_size=14)


class Lifecycle:
    """The lifecycle of the driver node, as it follows from the answers it gets."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.is_active = False
        self.answers: list[tuple[str, Future | None]] = []

    def ask(self, request: str) -> None:
        """Ask without waiting for what was asked before."""
        controller = self.rig.controller
        self.answers.append((request, controller.stop('enough') if request == 'stop'
                             else controller.request(request)))

    def settle(self) -> None:
        """Wait for every answer; take what they and the state of the controller mean."""
        for request, answer in self.answers:
            error = answer and answer.exception(BOUND)  # raises for one that never comes
            assert error is None or str(error)
            if error is None:
                self.is_active = MEANING.get(request, self.is_active)
        if self.rig.state not in ACTIVE_STATES:
            self.is_active = False


@pytest.fixture(scope='module')
def walked(shared_time):
    """Make one rig for all examples: each begins in the state that the last one has left."""
    rig = Rig('request sequences')
    rig.do('configure', 'home')
    yield rig
    rig.close()


def begin(rig: Rig) -> None:
    """Go back to a configured, homed machine without power."""
    if rig.state is not ControllerState.UNCONFIGURED:
        rig.controller.stop('begin again')
        wait_until(lambda: rig.rejection('cleanup') is None, 'the cleanup')
    rig.do('configure', 'home')


@settings(max_examples=25)
@given(steps)
def test_lifecycle_and_power_agree_after_any_sequence_of_requests(walked, sequence):
    begin(walked)
    lifecycle = Lifecycle(walked)
    for request, pause in sequence:
        lifecycle.ask(request)
        if pause:
            time.sleep(pause)  # part of the input, not a way to wait for something
    lifecycle.settle()
    has_power = walked.state in ACTIVE_STATES
    assert has_power == lifecycle.is_active
    if not has_power and walked.state is not ControllerState.STOPPED:
        wait_until(lambda: not POWERED & {*walked.drive_states}, 'power off')


@pytest.mark.parametrize('delay', [0.0, 0.01, 0.03, 0.05])
def test_a_halt_right_after_an_activation_never_leaves_power_that_nobody_owns(walked, delay):
    begin(walked)
    activation = walked.controller.request('activate')
    time.sleep(delay)  # part of the input, as above
    assert walked.controller.request('halt').exception(BOUND) is None
    was_activated = activation.exception(BOUND) is None
    assert (walked.state in ACTIVE_STATES) == was_activated
