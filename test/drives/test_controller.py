"""Requests of the drive controller: a normal sequence, rejections, replies and next steps."""

from __future__ import annotations

from dataclasses import replace

from bus_world import at_rest, configured, HOME, in_motion, SETTINGS, SWITCH_HOMING
import pytest

from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller import REQUESTS
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import State, Status
from facade_manipulator.errors import DriveStateError, ManipulatorError
from facade_manipulator.kinematics.geometry import AXIS_NAMES

pytestmark = pytest.mark.long

OFF = [State.SWITCH_ON_DISABLED] * 3


def requests_of(message: str) -> list[str]:
    """Return the requests of the next step in a message, in their order."""
    words = message.rpartition('next: ')[2].rpartition('then ')[2].split(', ')
    assert {*words} <= {*REQUESTS}, message
    return words


def test_normal_sequence_from_configure_to_cleanup_succeeds(rig):
    answer = rig.request('configure')
    assert 'power: confirmed off' in answer
    assert requests_of(answer) == ['home', 'activate']
    with pytest.raises(
        DriveStateError, match='q3 must be homed; .*next: home, activate'
    ):
        rig.request('activate')
    assert rig.state is ControllerState.INACTIVE
    assert rig.drive_states == OFF
    answer = rig.request('home')
    assert all(f'{name} is homed' in answer for name in AXIS_NAMES)
    assert requests_of(answer) == ['activate']
    rig.stream()
    answer = rig.request('activate')
    assert 'follow' in answer
    assert 'next' not in answer
    rig.until(lambda: rig.carriages[0] > HOME[0] + 0.02)
    axis = rig.snapshot.axes[0]
    assert axis.state is State.OPERATION_ENABLED
    assert axis.statusword & Status.DRIVE_FOLLOWS
    assert axis.homed is True
    assert axis.serial_number == 1
    assert type(axis.force) is float
    answer = rig.request('deactivate')
    assert 'power: confirmed off' in answer
    assert rig.drive_states == OFF
    assert requests_of(answer) == ['activate']
    assert rig.snapshot.joints().positions == pytest.approx(rig.carriages, abs=1e-4)
    answer = rig.request('cleanup')
    assert 'have confirmed that their power is off' in answer
    assert requests_of(answer) == ['configure', 'home', 'activate']
    assert rig.state == ControllerState.UNCONFIGURED
    assert rig.snapshot.power == 'unknown'

    def are_pre_operational():
        return {drive.objects.nmt.state for drive in rig.drives} == {'PRE-OPERATIONAL'}

    rig.until(are_pre_operational)
    rig.request('configure')


def test_carriages_arrive_exactly_at_their_targets(rig):
    at_rest(rig)

    def course(time):
        """Move by 0.02 m at 0.05 m/s."""
        if time < 0.4:
            return [0.05 * time] * 3, [0.05] * 3
        return [0.02] * 3, [0.0] * 3

    rig.course = course
    rig.run(2.0)
    assert rig.carriages == pytest.approx([place + 0.02 for place in HOME], abs=1e-5)


def test_halt_holds_and_activate_resumes(rig):
    in_motion(rig)
    assert requests_of(rig.request('halt')) == ['clear_faults']
    assert rig.state is ControllerState.HALTED
    held = rig.snapshot.axes[0].target
    rig.cycles(5)
    assert rig.snapshot.axes[0].target == held
    rig.request('activate')
    rig.until(lambda: abs(rig.carriages[0] - held) > 0.005)


def test_next_step_of_a_halt_in_progress_leads_to_its_end(rig):
    in_motion(rig)
    rig.ask('halt')
    rig.until(lambda: rig.state is ControllerState.HALTING)
    assert (
        rig.snapshot.next_step == 'wait until the drives are halted, then clear_faults'
    )


@pytest.mark.parametrize(
    ('request_', 'cycles', 'unhomed'),
    [('activate', 0, ()), ('activate', 12, ()), ('home', 12, AXIS_NAMES)],
)
def test_halt_cancels_an_activation_or_homing(make_rig, request_, cycles, unhomed):
    is_homing = request_ == 'home'
    rig = make_rig(
        settings=replace(SETTINGS, hold_cycles=30),
        axes=SWITCH_HOMING if is_homing else DEFAULT_AXES,
    )
    rig.request('configure', *() if is_homing else ('home',))
    job = rig.ask(request_)
    rig.cycles(cycles)
    answer = rig.request('halt')
    assert is_homing or 'The activation is cancelled; power: confirmed off' in answer
    with pytest.raises(DriveStateError, match='cancelled by halt'):
        rig.finish(job)
    assert rig.state is ControllerState.INACTIVE
    assert rig.drive_states == OFF
    assert rig.snapshot.unhomed == unhomed


def test_close_while_configuring_ends_at_once(rig):
    job = rig.ask('configure')
    rig.request('close')
    with pytest.raises(ManipulatorError):
        rig.finish(job)
    assert rig.state is ControllerState.CLOSED
    assert 'closed' in rig.rejection('configure')


def test_reply_to_close_requests_no_new_start(rig):
    reply = rig.request('close')
    assert rig.snapshot.next_step == 'start the driver again'
    assert 'next: ' not in reply


def test_halt_does_not_cancel_close(rig):
    in_motion(rig)
    job = rig.ask('close')
    assert 'halt is not possible while close is under way' in rig.rejection('halt')
    rig.finish(job)
    assert rig.state is ControllerState.CLOSED
    assert rig.drive_states == OFF


def test_rejected_requests_while_active_change_nothing(rig):
    at_rest(rig)
    for name in ('configure', 'cleanup', 'home', 'activate', 'self_test'):
        assert f'{name} is not possible' in rig.rejection(name)
        assert rig.state is ControllerState.ACTIVE
        assert rig.drive_states == [State.OPERATION_ENABLED] * 3


def test_request_for_drives_without_power_names_deactivate_as_next_step(rig):
    at_rest(rig)
    for name in ('cleanup', 'home', 'self_test'):
        assert rig.rejection(name).endswith('; next: deactivate')


def test_second_request_is_rejected_while_one_runs(rig):
    first = rig.ask('configure')
    with pytest.raises(DriveStateError, match='while configure is under way'):
        rig.request('home')
    rig.finish(first)


@pytest.mark.parametrize('rate', [200, 500])
def test_drives_follow_targets_at_faster_cycles(make_rig, rate):
    rig = make_rig(settings=replace(SETTINGS, rate=rate))
    in_motion(rig)
    rig.request('deactivate')


# --- next steps, which lead to active drives


def halted(rig):
    at_rest(rig)
    rig.request('halt')


STATES = {
    'unconfigured': (lambda rig: None, ['configure', 'home', 'activate']),
    'not homed': (lambda rig: rig.request('configure'), ['home', 'activate']),
    'inactive': (configured, ['activate']),
    'halted': (halted, ['clear_faults']),
}


@pytest.mark.parametrize('state', STATES)
def test_next_step_of_every_rejection_leads_to_active_drives(rig, state):
    get_there, steps = STATES[state]
    get_there(rig)
    assert requests_of(rig.snapshot.next_step) == steps
    before = rig.state
    for request in (
        'clear_faults',
        'deactivate',
        'cleanup',
        'self_test',
        'home',
        'activate',
    ):
        if rig.state is before and (message := rig.rejection(request)):
            assert requests_of(message) == steps
    rig.recover()


def test_failed_configure_names_the_repair_and_the_next_request(rig):
    rig.drives[1].is_silent = True
    message = rig.rejection('configure')
    assert (
        'q2 (node 2) sent no boot-up message on can0 after its reset (waited 0.5 s); next: '
        'check its power' in message
    )
    assert message.endswith(', then configure, home, activate')
    assert rig.state is ControllerState.UNCONFIGURED
    rig.repair()
    rig.recover()
