"""The drive controller on an ordinary day: what is asked for, what is rejected, what is told."""

from __future__ import annotations

from dataclasses import replace

from drive_rig import at_rest, HOME, inactive, MOVING, moving, PATIENCE, SETTINGS, Source
import pytest
from support import wait_until

from facade_manipulator.drives.canopen.nmt import NmtState
from facade_manipulator.drives.cia402.settings import AXIS_NAMES, DEFAULT_AXES
from facade_manipulator.drives.cia402.states import State, Status
from facade_manipulator.drives.controller.session import BusAccess, Session
from facade_manipulator.drives.controller.snapshot import ControllerState
from facade_manipulator.drives.controller.targets import MechanismChecks
from facade_manipulator.errors import DriveStateError, ManipulatorError, ParameterError

pytestmark = pytest.mark.quick


def test_an_ordinary_day_from_configure_to_cleanup(rig):
    assert rig.state is ControllerState.UNCONFIGURED
    assert 'power: confirmed off' in rig.do('configure')
    with pytest.raises(DriveStateError, match='q3 must be homed; .*next: home, activate'):
        rig.do('activate')
    assert rig.state is ControllerState.INACTIVE
    assert rig.drive_states == [State.SWITCH_ON_DISABLED] * 3
    answer = rig.do('home')
    assert all(f'{name} is homed' in answer for name in AXIS_NAMES)
    rig.source.speed = MOVING
    assert 'follow' in rig.do('activate')
    assert rig.state is ControllerState.ACTIVE
    wait_until(lambda: rig.carriages[0] > HOME[0] + 0.02, 'the carriages to follow')
    axis = rig.controller.snapshot().axes[0]
    assert axis.state is State.OPERATION_ENABLED and axis.statusword & Status.DRIVE_FOLLOWS
    assert (axis.homed, axis.serial_number, type(axis.force)) == (True, 1, float)
    assert axis.heartbeat_age <= SETTINGS.heartbeat_timeout
    assert 'power: confirmed off' in rig.do('deactivate')
    assert rig.drive_states == [State.SWITCH_ON_DISABLED] * 3
    snapshot = rig.controller.snapshot()
    assert rig.controller.snapshot().joints().positions == pytest.approx(rig.carriages, abs=1e-4)
    assert snapshot.cause == ''
    rig.do('cleanup')
    assert rig.state is ControllerState.UNCONFIGURED
    wait_until(lambda: {drive.nmt_state for drive in rig.drives} == {NmtState.PRE_OPERATIONAL},
               'the drives to become pre-operational')
    rig.do('configure')


def test_the_carriages_go_exactly_where_the_targets_say(rig):
    rig.source.speed = MOVING
    at_rest(rig)
    wait_until(lambda: rig.source.positions[0] > HOME[0] + 0.01, 'targets')
    rig.source.speed = 0.0
    target = rig.source.positions
    wait_until(lambda: max(
        abs(a - b) for a, b in zip(rig.carriages, target, strict=True)) < 1e-5, 'arrival')


def test_every_sync_is_answered_by_commands_before_the_next(rig):
    at_rest(rig)
    rig.frames()
    rig.cycles(20)
    ids = [message.arbitration_id for message in rig.frames()]
    first, last = (ids.index(0x080), len(ids) - ids[::-1].index(0x080) - 1)
    per_cycle = ids[first:last].count(0x080)
    for node in (1, 2, 3):
        assert ids[first:last].count(0x200 + node) == pytest.approx(per_cycle, abs=2)


def test_halt_holds_the_carriages_and_activate_goes_on(rig):
    moving(rig)
    assert 'next: clear_faults' in rig.do('halt')
    assert rig.state is ControllerState.HALTED
    held = rig.controller.snapshot().axes[0].target
    rig.cycles(5)
    assert rig.controller.snapshot().axes[0].target == held
    rig.do('activate')
    wait_until(lambda: abs(rig.carriages[0] - held) > 0.005, 'motion after the halt')


@pytest.mark.parametrize('cycles', [0, 1, 2, 4, 8, 12])
def test_a_halt_while_activating_is_accepted_and_powers_off(make_rig, cycles):
    rig = make_rig(settings=replace(SETTINGS, hold_cycles=30))
    inactive(rig)
    activation = rig.controller.request('activate')
    rig.cycles(cycles)
    assert rig.do('halt') == 'The activation is given up; power: confirmed off; next: activate'
    with pytest.raises(DriveStateError, match='cancelled by halt'):
        activation.result(PATIENCE)
    assert rig.state is ControllerState.INACTIVE
    assert rig.drive_states == [State.SWITCH_ON_DISABLED] * 3
    rig.do('activate')


def test_a_halt_where_nothing_moves_is_accepted_and_cancels_nothing(rig):
    inactive(rig)
    assert 'Nothing moves on' in rig.do('halt')
    rig.controller.stop('enough')
    rig.until_stopped()
    clearing = rig.controller.request('clear_faults')
    assert rig.rejection('halt') is None
    assert 'cleared' in clearing.result(PATIENCE)


def test_close_powers_off_in_order(rig):
    moving(rig)
    rig.controller.close()
    assert rig.state is ControllerState.CLOSED
    assert rig.drive_states == [State.SWITCH_ON_DISABLED] * 3
    with pytest.raises(DriveStateError, match='closed'):
        rig.do('configure')


def test_close_while_configuring_and_before_ends_at_once(make_rig):
    make_rig().controller.close()
    rig = make_rig()
    job = rig.controller.request('configure')
    rig.controller.close()
    with pytest.raises(ManipulatorError):
        job.result(PATIENCE)
    assert rig.state is ControllerState.CLOSED


@pytest.mark.parametrize('request_name', [
    'cleanup', 'activate', 'deactivate', 'home', 'halt', 'clear_faults'])
def test_requests_before_configure_say_so(rig, request_name):
    with pytest.raises(DriveStateError, match=f'{request_name} is not possible.*next: configure'):
        rig.do(request_name)


@pytest.mark.parametrize('request_name', ['configure', 'cleanup', 'home', 'activate', 'self_test'])
def test_requests_that_do_not_fit_while_active_change_nothing(rig, request_name):
    at_rest(rig)
    with pytest.raises(DriveStateError, match=f'{request_name} is not possible'):
        rig.do(request_name)
    assert rig.state is ControllerState.ACTIVE
    assert rig.drive_states == [State.OPERATION_ENABLED] * 3


def test_a_second_request_is_rejected_while_one_is_under_way(rig):
    first = rig.controller.request('configure')
    with pytest.raises(DriveStateError, match='while configure is under way'):
        rig.do('home')
    first.result(PATIENCE)


def test_clearing_without_a_fault_says_that_there_is_none(rig):
    inactive(rig)
    assert rig.do('clear_faults') == (
        'There is no fault to clear; power: confirmed off; next: activate')


@pytest.mark.parametrize('rate', [200, 500])
def test_faster_cycles_work_as_well(make_rig, rate):
    rig = make_rig(settings=replace(SETTINGS, rate=rate))
    moving(rig)
    rig.do('deactivate')
    assert rig.controller.snapshot().bus_load <= 0.5


def test_settings_that_contradict_the_drive_type_are_rejected_at_once():
    axes = (replace(DEFAULT_AXES[0], homing_method=-5), *DEFAULT_AXES[1:])
    with pytest.raises(ParameterError, match='homing_method = -5'):
        Session(SETTINGS, axes, BusAccess(None), MechanismChecks(Source()))
    with pytest.raises(ParameterError, match='bus load'):
        Session(SETTINGS, DEFAULT_AXES, BusAccess(None, 125_000), MechanismChecks(Source()))
    with pytest.raises(ParameterError, match='no drive profile nonsense'):
        Session(
            SETTINGS, (replace(DEFAULT_AXES[0], profile='nonsense'), *DEFAULT_AXES[1:]),
            BusAccess(None), MechanismChecks(Source()))
