"""Clearing of faults: afterwards no error of the past hides an error of the same drive."""

from __future__ import annotations

from bus_world import at_rest
import pytest

from facade_manipulator.canopen import cob_ids
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import State
from facade_manipulator.errors import DriveError

POSITION_LOST = 0x7320
UNDERVOLTAGE = 0x3220
OVERCURRENT = 0x2310
ERROR_RESET = bytes(2)


@pytest.fixture
def drop_emergencies(rig):
    """Return a function that drops the emergency messages for which a condition holds."""

    def drop(condition):
        deliver = rig.deliver

        def deliver_others(frames):
            others = []
            for cob_id, data in frames:
                is_emergency = cob_id & ~0x7F == cob_ids.EMERGENCY and cob_id & 0x7F
                if not (is_emergency and condition(data)):
                    others.append((cob_id, data))
            deliver(others)

        rig.deliver = deliver_others

    return drop


def fail(rig, code):
    """Let the first drive fail, and wait until the drives are stopped."""
    rig.inject(0, lambda drive: drive.inject_fault(code))
    rig.until(lambda: rig.state is ControllerState.STOPPED)
    rig.run(0.5)


def test_second_loss_of_position_without_emergency_requires_homing(
    rig, drop_emergencies
):
    drop_emergencies(lambda data: True)
    at_rest(rig)
    for _ in range(2):
        fail(rig, POSITION_LOST)
        assert rig.snapshot.unhomed == ('q1',)
        assert State.QUICK_STOP_ACTIVE not in rig.drive_states
        assert 'clear_faults, home, activate' in rig.snapshot.next_step
        rig.request('clear_faults')
        assert 'q1' in rig.rejection('activate')
        rig.request('home', 'activate')


def test_fault_without_code_shows_no_cleared_code(rig, drop_emergencies):
    drop_emergencies(lambda data: data[:2] == ERROR_RESET)
    at_rest(rig)
    fail(rig, UNDERVOLTAGE)
    rig.request('clear_faults', 'activate')
    drive = rig.drives[0]
    rig.inject(0, lambda drive: drive.axis.fail(keeps_power=False))
    rig.until(lambda: rig.state is ControllerState.STOPPED)
    assert drive.axis.state is State.FAULT
    assert 'the drive sent no error code' in rig.snapshot.cause


def test_clear_faults_forgets_errors_and_warnings(rig, drop_emergencies):
    drop_emergencies(lambda data: data[:2] == ERROR_RESET)
    at_rest(rig)
    for axis in rig.controller.axes:
        axis.errors.warning = 'it reports a warning'
    fail(rig, UNDERVOLTAGE)
    assert '3220h' in rig.snapshot.axes[0].error
    rig.request('clear_faults')
    for axis in rig.snapshot.axes:
        assert not axis.error_code
        assert not axis.error
        assert not axis.warning


def test_cause_during_clear_faults_remains_until_the_next(rig):
    at_rest(rig)
    fail(rig, UNDERVOLTAGE)
    job = rig.ask('clear_faults')
    rig.run(0.01)
    assert not job.done()
    rig.controller.stop('the operator stops again')
    rig.inject(1, lambda drive: drive.inject_fault(OVERCURRENT))
    with pytest.raises(DriveError, match='The faults remain.*2310h') as caught:
        rig.finish(job)
    assert 'the operator stops again' in str(caught.value)
    assert rig.state is ControllerState.STOPPED
    assert '3220h' in rig.snapshot.cause

    cleared = rig.request('clear_faults')
    for cause in ('3220h', 'the operator stops again', '2310h'):
        assert cause in cleared
    rig.request('activate')
