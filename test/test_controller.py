from dataclasses import replace
import math
import random
import threading
import time

import can
from drive_rig import (
    at_rest,
    HOME,
    inactive,
    MOVING,
    moving,
    PATIENCE,
    Rig,
    SETTINGS,
    SITUATIONS,
    Source,
    STRICT,
)
import pytest
from support import wait_until

from facade_manipulator.drives import pdo
from facade_manipulator.drives.cia402 import Controlword, State, Status
from facade_manipulator.drives.controller import DriveController
from facade_manipulator.drives.nmt import NmtState
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.settings import AXIS_NAMES, DEFAULT_AXES
from facade_manipulator.drives.simulated_drive import Identity, SimulatedDrive
from facade_manipulator.drives.simulated_faults import FrameLoss
from facade_manipulator.drives.simulated_group import simulated_drives
from facade_manipulator.drives.simulated_motor import SimulationSettings
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.errors import (
    BusError,
    DriveFaultError,
    DriveIdentityError,
    DriveObjectError,
    DriveStateError,
    DriveTimeoutError,
    LimitError,
    ManipulatorError,
    ParameterError,
)


@pytest.fixture
def make_rig(request):
    rigs = []

    def make(**details) -> Rig:
        rigs.append(Rig(f'{request.node.name}-{len(rigs)}', **details))
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.close()
    if hasattr(request.node, 'rep_call') and request.node.rep_call.failed:
        return
    assert not [t for t in threading.enumerate() if t.name == 'drive control']


@pytest.fixture
def rig(make_rig) -> Rig:
    return make_rig()


situations = pytest.mark.parametrize('situation', SITUATIONS)


# --- the ordinary day

def test_an_ordinary_day_from_configure_to_cleanup(rig):
    assert rig.state is ControllerState.UNCONFIGURED
    assert 'power is off' in rig.do('configure')
    assert rig.state is ControllerState.INACTIVE
    assert rig.drive_states == [State.SWITCH_ON_DISABLED] * 3
    answer = rig.do('home')
    assert all(f'{name} is homed' in answer for name in AXIS_NAMES)
    rig.source.speed = MOVING
    assert 'follow' in rig.do('activate')
    assert rig.state is ControllerState.ACTIVE
    wait_until(lambda: rig.carriages[0] > HOME[0] + 0.02, 'the carriages to follow')
    assert 'power is off' in rig.do('deactivate')
    assert rig.drive_states == [State.SWITCH_ON_DISABLED] * 3
    snapshot = rig.controller.snapshot()
    assert snapshot.positions == pytest.approx(rig.carriages, abs=1e-4)
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


def test_nothing_moves_before_all_axes_are_homed(rig):
    rig.do('configure')
    with pytest.raises(DriveStateError, match='q1 and q2 and q3 must be homed: call home'):
        rig.do('activate')
    assert rig.drive_states == [State.SWITCH_ON_DISABLED] * 3


def test_halt_holds_the_carriages_and_activate_goes_on(rig):
    moving(rig)
    assert 'activate to go on' in rig.do('halt')
    assert rig.state is ControllerState.HALTED
    held = rig.controller.snapshot().axes[0].target
    rig.cycles(5)
    assert rig.controller.snapshot().axes[0].target == held
    rig.do('activate')
    wait_until(lambda: abs(rig.carriages[0] - held) > 0.005, 'motion after the halt')


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
    job = rig.controller.configure()
    rig.controller.close()
    with pytest.raises(ManipulatorError):
        job.result(PATIENCE)
    assert rig.state is ControllerState.CLOSED


@pytest.mark.parametrize('request_name', [
    'cleanup', 'activate', 'deactivate', 'home', 'halt', 'clear_faults'])
def test_requests_before_configure_say_so(rig, request_name):
    with pytest.raises(DriveStateError, match=f'{request_name} is not possible: configure'):
        rig.do(request_name)


@pytest.mark.parametrize('request_name', ['configure', 'cleanup', 'home', 'activate'])
def test_requests_that_do_not_fit_while_active_change_nothing(rig, request_name):
    at_rest(rig)
    with pytest.raises(DriveStateError, match=f'{request_name} is not possible'):
        rig.do(request_name)
    assert rig.state is ControllerState.ACTIVE
    assert rig.drive_states == [State.OPERATION_ENABLED] * 3


def test_a_second_request_is_refused_while_one_is_under_way(rig):
    first = rig.controller.configure()
    with pytest.raises(DriveStateError, match='while configure is under way'):
        rig.do('home')
    first.result(PATIENCE)


def test_clearing_without_a_fault_says_that_there_is_none(rig):
    inactive(rig)
    assert rig.do('clear_faults') == 'There is no fault to clear.'


@pytest.mark.parametrize('rate', [200, 500])
def test_faster_cycles_work_as_well(make_rig, rate):
    rig = make_rig(settings=replace(SETTINGS, rate=rate, max_missed_cycles=10))
    moving(rig)
    rig.do('deactivate')
    assert rig.controller.snapshot().bus_load <= 0.5


def test_settings_that_contradict_the_drive_type_are_refused_at_once():
    axes = (replace(DEFAULT_AXES[0], homing_method=-5), *DEFAULT_AXES[1:])
    with pytest.raises(ParameterError, match='homing_method = -5'):
        DriveController(SETTINGS, axes, None, Source())
    with pytest.raises(ParameterError, match='bus load'):
        DriveController(SETTINGS, DEFAULT_AXES, None, Source(), bitrate=125_000)
    with pytest.raises(ParameterError, match='no drive profile nonsense'):
        DriveController(
            SETTINGS, (replace(DEFAULT_AXES[0], profile='nonsense'), *DEFAULT_AXES[1:]), None,
            Source())


def test_the_self_test_names_identity_objects_bus_and_cycle(rig):
    inactive(rig)
    findings = rig.do('self_test')
    assert [finding.name for finding in findings] == [
        *(f'{name} {what}' for name in AXIS_NAMES for what in ('identity', 'objects')),
        'bus', 'cycle', 'faults']
    assert all(finding.passed for finding in findings if finding.name != 'cycle')
    assert 'serial number 2' in findings[2].sentence


def test_the_self_test_finds_an_object_that_somebody_has_changed(rig):
    inactive(rig)
    with rig.simulator.access() as drives:
        drives[1].objects.values[0x6065, 0] = 5
    failed = [finding for finding in rig.do('self_test') if not finding.passed]
    assert 'q2 objects' in [finding.name for finding in failed]
    assert '6065h:00 reads back as 5' in failed[0].sentence


def test_the_self_test_is_refused_while_powered(rig):
    at_rest(rig)
    with pytest.raises(DriveStateError, match='deactivate first'):
        rig.do('self_test')


# --- configure refuses

def test_a_drive_that_does_not_answer_is_named_and_configure_can_be_tried_again(rig):
    rig.drives[1].is_silent = True
    with pytest.raises(DriveTimeoutError, match=r'q2 \(node 2\) sent no boot-up'):
        rig.do('configure')
    assert rig.state is ControllerState.UNCONFIGURED
    rig.drives[1].is_silent = False
    rig.do('configure')
    assert rig.state is ControllerState.INACTIVE


def test_a_drive_with_another_identity_is_refused(make_rig):
    axes = tuple(replace(axis, serial_number=100 + axis.node_id) for axis in DEFAULT_AXES)
    rig = make_rig(axes=axes)
    rig.do('configure', 'cleanup')
    with rig.simulator.access() as drives:
        drives[0].set_identity(Identity(serial_number=102))
    with pytest.raises(DriveIdentityError, match='the drive of q2, the axes are swapped'):
        rig.do('configure')
    with rig.simulator.access() as drives:
        drives[0].set_identity(Identity(serial_number=999))
    with pytest.raises(DriveIdentityError, match='serial_number = 999 .*101'):
        rig.do('configure')


def drives_without(index: int, number: int) -> list[SimulatedDrive]:
    """Return three drives of which one lacks an object."""
    drives = simulated_drives(DEFAULT_AXES)
    axis = DEFAULT_AXES[number]
    settings = SimulationSettings(start_position=axis.home_position, missing_objects=(index,))
    drives[number] = SimulatedDrive(
        axis.node_id, load_profile(axis.profile), axis, settings=settings)
    return drives


def test_a_drive_that_lacks_a_required_object_is_refused_by_its_name(make_rig):
    rig = make_rig(drives=drives_without(0x60C5, 2))
    with pytest.raises(DriveObjectError, match=r'q3 \(node 3\) refuses object 60C5h'):
        rig.do('configure')
    assert rig.state is ControllerState.UNCONFIGURED


def test_two_drives_on_one_node_id_are_found(make_rig):
    rig = make_rig(drives=simulated_drives((*DEFAULT_AXES, DEFAULT_AXES[1])))
    with pytest.raises(DriveIdentityError, match=r'q2 \(node 2\) sent \d boot-up messages'):
        rig.do('configure')


def test_a_missing_interface_is_said_and_configure_can_be_tried_again(rig):
    rig.bus_is_missing = True
    with pytest.raises(BusError, match='No such device'):
        rig.do('configure')
    assert rig.state is ControllerState.UNCONFIGURED
    rig.bus_is_missing = False
    rig.do('configure')


def test_a_drive_in_fault_is_configured_but_stopped(rig):
    with rig.simulator.access() as drives:
        drives[0].axis.torque_off = True
    assert 'but stopped' in rig.do('configure')
    assert rig.state is ControllerState.STOPPED
    with pytest.raises(DriveFaultError, match='The faults remain'):
        rig.do('clear_faults')
    with rig.simulator.access() as drives:
        drives[0].remove_cause()
    assert 'next: home q1 and q2 and q3, then activate' in rig.do('clear_faults')
    assert rig.state is ControllerState.INACTIVE


# --- what goes wrong in one axis stops all three

@situations
def test_a_lost_position_takes_the_power_from_all_and_asks_for_home(rig, situation):
    SITUATIONS[situation](rig)
    with rig.simulator.access() as drives:
        drives[0].lose_position(0.01)
    rig.until_stopped()
    wait_until(lambda: State.QUICK_STOP_ACTIVE not in rig.drive_states, 'power off')
    assert rig.controller.snapshot().unhomed == ('q1',)
    assert 'home q1, then activate' in rig.do('clear_faults')
    with pytest.raises(DriveStateError, match='q1 must be homed'):
        rig.do('activate')
    rig.do('home')


@situations
def test_a_silent_drive_stops_the_others_and_asks_to_configure_again(make_rig, situation):
    rig = make_rig(settings=STRICT)
    SITUATIONS[situation](rig)
    rig.drives[2].is_silent = True
    rig.until(ControllerState.STOPPED)
    snapshot = rig.controller.snapshot()
    assert 'q3 (node 3) did not answer 3 cycles in a row, bound 3' in snapshot.cause
    assert 'configure again' in snapshot.next_step
    wait_until(lambda: State.OPERATION_ENABLED not in rig.drive_states, 'all to stop')
    assert 'configure again' in rig.refusal('clear_faults')
    rig.drives[2].is_silent = False
    rig.do('cleanup', 'configure')


@situations
def test_a_drive_that_restarts_by_itself_is_no_longer_homed(rig, situation):
    SITUATIONS[situation](rig)
    with rig.simulator.access() as drives:
        drives[1].reboot()
    rig.until(ControllerState.STOPPED)
    wait_until(lambda: 'restarted' in rig.all_causes, 'the boot-up message')
    assert 'q2' in rig.controller.snapshot().unhomed
    wait_until(lambda: State.OPERATION_ENABLED not in rig.drive_states, 'all to stop')
    assert 'configure again' in rig.refusal('clear_faults')
    rig.do('cleanup', 'configure', 'home')


def test_drives_that_all_fall_silent_are_blamed_on_the_bus(rig):
    at_rest(rig)
    with rig.simulator.access() as drives:
        for drive in drives:
            drive.is_silent = True
    rig.until(ControllerState.STOPPED)
    assert 'no drive answers any more' in rig.controller.snapshot().cause
    with rig.simulator.access() as drives:
        for drive in drives:
            drive.is_silent = False
    rig.do('clear_faults', 'activate')


def test_a_drive_whose_heartbeat_stops_is_missed(make_rig):
    rig = make_rig(settings=STRICT)
    at_rest(rig)
    with rig.simulator.access() as drives:
        drives[0].objects.values[0x1017, 0] = 0
        drives[0]._producer.deadline = math.inf
    rig.until_stopped()
    assert 'q1 (node 1) sent no heartbeat for' in rig.controller.snapshot().cause
    assert 'bound 150 ms' in rig.controller.snapshot().cause


def test_a_drive_that_leaves_nmt_operational_stops_all(rig):
    at_rest(rig)
    rig.forge(pdo.heartbeat_cob_id(2), bytes([NmtState.PRE_OPERATIONAL]))
    rig.until_stopped()
    assert 'q2 (node 2) is no longer operational' in rig.controller.snapshot().cause
    rig.do('clear_faults')


def test_a_position_that_jumps_is_not_believed_and_asks_for_home(rig):
    at_rest(rig)
    with rig.simulator.access() as drives:
        drives[2].axis.reference.offset += 40_000
    rig.until_stopped()
    assert 'q3 (node 3): the position has jumped by 0.09' in rig.controller.snapshot().cause
    wait_until(lambda: rig.drive_states == [State.SWITCH_ON_DISABLED] * 3, 'power off')
    assert rig.controller.snapshot().unhomed == ('q3',)
    rig.do('clear_faults', 'home')


def test_an_undefined_statusword_stops_all(rig):
    at_rest(rig)
    with rig.simulator.access() as drives:
        drives[0].objects.readers[0x6041, 0] = lambda: 0x0025
        drives[0]._pdo.forget()
    rig.until(ControllerState.STOPPED)
    assert 'q1: statusword 0x0025 names no state' in rig.all_causes


# --- whoever commands us

@pytest.mark.parametrize(('distort', 'sentence'), [
    (lambda p: (math.nan, p[1], p[2]), 'target of q1 = nan m is not a finite number'),
    (lambda p: (p[0], math.inf, p[2]), 'target of q2 = inf m is not a finite number'),
    (lambda p: (p[0], p[1], 0.6), r'target of q3 = 0.6 m is above the bound 0.5 m'),
    (lambda p: (p[0] + 0.02, p[1], p[2]), r'step of the target of q1 in one cycle = 0.02 m is '
                                         'above the bound 0.0066 m'),
])
def test_a_target_that_must_not_go_to_the_drives_stops_all(rig, distort, sentence):
    at_rest(rig)
    rig.frames()
    rig.source.distort = distort
    rig.until_stopped()
    assert sentence in rig.controller.snapshot().cause
    for message in rig.frames():
        if message.arbitration_id & 0x780 == 0x200:
            frame = pdo.decode_rpdo1(bytes(message.data))
            axis = DEFAULT_AXES[(message.arbitration_id & 0x7F) - 1]
            assert axis.to_metres(frame.target_counts) == pytest.approx(
                HOME[axis.node_id - 1], abs=1e-4)


def test_a_source_that_fails_stops_all_and_the_loop_goes_on(rig):
    at_rest(rig)

    def fail(positions):
        raise RuntimeError('out of ideas')

    rig.source.distort = fail
    rig.until_stopped()
    assert 'RuntimeError: out of ideas' in rig.controller.snapshot().cause
    rig.source.distort = None
    rig.do('clear_faults', 'activate')


def test_the_callers_check_of_targets_is_the_last_word(make_rig):
    def check(positions):
        if positions[0] > HOME[0] + 0.005:
            raise LimitError('q1', positions[0], -0.095, 'm', 'above')

    rig = make_rig(check_targets=check)
    rig.source.speed = MOVING
    at_rest(rig)
    rig.until_stopped()
    assert 'q1 = -0.09' in rig.controller.snapshot().cause
    assert rig.carriages[0] < HOME[0] + 0.006


def test_carriages_that_stand_where_they_must_not_are_not_powered(make_rig):
    def check(positions):
        raise LimitError('q3 - q1', 0.01, 0.02, 'm', 'below')

    rig = make_rig(check_targets=check)
    inactive(rig)
    with pytest.raises(DriveStateError, match='q3 - q1 = 0.01 m is below the bound 0.02 m'):
        rig.do('activate')
    assert rig.state is ControllerState.INACTIVE


@situations
def test_stop_is_latched_with_its_cause_until_it_is_cleared(rig, situation):
    SITUATIONS[situation](rig)
    rig.controller.stop('the operator pressed the red button', 'release the button')
    rig.until_stopped()
    snapshot = rig.controller.snapshot()
    assert snapshot.cause == 'the operator pressed the red button'
    assert snapshot.next_step == 'release the button'
    rig.do('clear_faults')
    rig.source.speed = 0.0
    rig.do('activate')


def test_an_executor_that_hangs_stops_the_drives(make_rig):
    rig = make_rig(settings=STRICT)
    moving(rig)
    rig.beats.clear()
    rig.until_stopped()
    assert 'the executor has not run for' in rig.controller.snapshot().cause
    assert 'bound 100 ms' in rig.controller.snapshot().cause


def test_an_executor_that_hangs_while_nothing_has_power_stops_nothing(rig):
    inactive(rig)
    rig.beats.clear()
    rig.cycles(20)
    assert rig.state is ControllerState.INACTIVE


def test_an_error_that_nobody_foresaw_stops_the_drives_and_not_the_thread(make_rig):
    trouble = []

    def on_cycle():
        if trouble:
            raise KeyError(trouble.pop())

    rig = make_rig(on_cycle=on_cycle)
    at_rest(rig)
    trouble.append('surprise')
    rig.until_stopped()
    assert "the control loop failed: KeyError: 'surprise'" in rig.controller.snapshot().cause
    rig.do('clear_faults', 'activate')


def test_a_loop_that_stood_still_blames_this_computer_and_no_drive(make_rig):
    pauses = []

    def on_cycle():
        if pauses:
            time.sleep(pauses.pop())

    rig = make_rig(on_cycle=on_cycle)
    at_rest(rig)
    pauses.append(1.2 * SETTINGS.heartbeat_timeout)
    rig.until_stopped()
    assert 'the control loop stood still for' in rig.controller.snapshot().cause
    assert 'take load off this computer' in rig.controller.snapshot().next_step
    rig.do('clear_faults', 'activate')


def test_a_fourth_clearing_within_a_minute_is_refused(rig):
    inactive(rig)
    for _ in range(3):
        rig.controller.stop('again')
        rig.until_stopped()
        rig.do('clear_faults')
    rig.controller.stop('again')
    rig.until_stopped()
    assert 'possible in' in rig.refusal('clear_faults')


# --- homing

def test_homing_by_switch_finds_the_home_position(make_rig):
    axes = tuple(
        replace(axis, homing_method=17, home_position=-0.45, homing_speed=0.5,
                homing_zero_speed=0.2, homing_acceleration=10.0) for axis in DEFAULT_AXES)
    rig = make_rig(axes=axes)
    rig.do('configure')
    assert 'is not homed' not in rig.do('home')
    assert rig.controller.snapshot().unhomed == ()


def test_axes_of_a_higher_rank_wait(make_rig):
    axes = tuple(replace(axis, homing_rank=rank)
                 for axis, rank in zip(DEFAULT_AXES, (2, 1, 3), strict=True))
    order = []

    def check(positions, homed):
        if homed not in order:
            order.append(homed)

    rig = make_rig(axes=axes, check_homing=check)
    inactive(rig)
    assert order[:3] == [
        (False, False, False), (False, True, False), (True, True, False)]


def test_homing_stops_when_the_caller_sees_a_collision_coming(make_rig):
    def check(positions, homed):
        raise LimitError('q2 - q3', 0.01, 0.02, 'm', 'below')

    rig = make_rig(check_homing=check)
    rig.do('configure')
    with pytest.raises(DriveFaultError, match='homing stopped: q2 - q3 = 0.01 m.*q1 is not homed'):
        rig.do('home')
    rig.until_stopped()


def slow_homing() -> tuple:
    return tuple(replace(axis, homing_method=17, homing_speed=0.02) for axis in DEFAULT_AXES)


def test_a_homing_that_takes_too_long_stops_all(make_rig):
    rig = make_rig(axes=tuple(replace(axis, homing_timeout=0.3) for axis in slow_homing()))
    rig.do('configure')
    with pytest.raises(DriveFaultError, match='homing took longer than 0.3 s'):
        rig.do('home')
    assert rig.controller.snapshot().unhomed == AXIS_NAMES


def test_a_halt_gives_homing_up(make_rig):
    rig = make_rig(axes=slow_homing())
    rig.do('configure')
    homing = rig.controller.home()
    wait_until(lambda: State.OPERATION_ENABLED in rig.drive_states, 'power')
    wait_until(lambda: rig.refusal('halt') is None, 'the halt')
    with pytest.raises(DriveStateError, match='given up for halt'):
        homing.result(PATIENCE)
    assert rig.state is ControllerState.INACTIVE
    assert rig.controller.snapshot().unhomed == AXIS_NAMES


def test_a_fault_while_homing_stops_all(make_rig):
    rig = make_rig(axes=slow_homing())
    rig.do('configure')
    homing = rig.controller.home()
    wait_until(lambda: rig.drive_states == [State.OPERATION_ENABLED] * 3, 'power')
    with rig.simulator.access() as drives:
        drives[2].inject_fault(0x2310)
    with pytest.raises(DriveFaultError, match='current is too high'):
        homing.result(PATIENCE)
    rig.until_stopped()
    rig.do('clear_faults')
    assert rig.controller.snapshot().unhomed == AXIS_NAMES


def test_homing_again_does_not_take_the_old_success_for_the_new(rig):
    inactive(rig)
    assert 'is not homed' not in rig.do('home')


# --- the bus goes away

@situations
def test_a_lost_bus_is_found_again_and_stays_stopped_until_cleared(make_rig, situation):
    rig = make_rig(settings=replace(SETTINGS, reopen_after=0.2))
    SITUATIONS[situation](rig)
    rig.bus_is_missing = True
    rig.buses[-1].shutdown()
    rig.until(ControllerState.BUS_LOST)
    assert rig.controller.snapshot().bus_error
    wait_until(lambda: State.OPERATION_ENABLED not in rig.drive_states,
               'the drives to miss the heartbeat')
    with pytest.raises(ManipulatorError):
        rig.do('clear_faults')
    rig.bus_is_missing = False
    rig.until(ControllerState.STOPPED)
    rig.do('clear_faults')
    assert rig.state is ControllerState.INACTIVE
    rig.source.speed = 0.0
    rig.do('activate')


def test_bus_off_is_a_lost_bus(make_rig):
    rig = make_rig(settings=replace(SETTINGS, reopen_after=0.2))
    at_rest(rig)
    rig.listener.send(can.Message(
        arbitration_id=0x040, data=bytes(8), is_error_frame=True, is_extended_id=False))
    rig.until(ControllerState.BUS_LOST, ControllerState.STOPPED)
    assert 'bus-off' in rig.controller.snapshot().cause
    wait_until(lambda: rig.refusal('clear_faults') is None, 'clearing')


def test_a_queue_that_stays_full_is_a_lost_bus(make_rig):
    rig = make_rig(settings=replace(SETTINGS, reopen_after=0.2))
    at_rest(rig)

    def full(message, timeout=None):
        raise can.CanOperationError('Transmit buffer full')

    rig.buses[-1].send = full
    rig.until(ControllerState.BUS_LOST)
    assert 'no node acknowledges frames' in rig.controller.snapshot().cause
    wait_until(lambda: State.OPERATION_ENABLED not in rig.drive_states, 'the drives to stop')


def test_a_lost_bus_can_be_cleaned_up_and_closed(make_rig):
    rig = make_rig()
    at_rest(rig)
    rig.bus_is_missing = True
    rig.buses[-1].shutdown()
    rig.until(ControllerState.BUS_LOST)
    rig.do('cleanup')
    assert rig.state is ControllerState.UNCONFIGURED


def test_close_while_the_bus_is_lost(make_rig):
    rig = make_rig()
    at_rest(rig)
    rig.bus_is_missing = True
    rig.buses[-1].shutdown()
    rig.until(ControllerState.BUS_LOST)
    rig.controller.close()
    assert rig.state is ControllerState.CLOSED


def test_a_drive_that_was_restarted_behind_a_lost_bus_must_be_configured_again(make_rig):
    rig = make_rig(settings=replace(SETTINGS, reopen_after=0.2))
    inactive(rig)
    rig.bus_is_missing = True
    rig.buses[-1].shutdown()
    rig.until(ControllerState.BUS_LOST)
    with rig.simulator.access() as drives:
        drives[1].reboot()
    rig.bus_is_missing = False
    rig.until(ControllerState.STOPPED)
    assert 'configure again' in rig.refusal('clear_faults')


# --- a bad wire

@pytest.mark.parametrize('share', [0.01, 0.05, 0.2])
@pytest.mark.parametrize('kind', ['dropped', 'doubled', 'delayed'])
def test_frames_that_get_lost_late_or_doubled_never_command_out_of_limits(rig, kind, share):
    moving(rig)
    rig.frames()
    with rig.simulator.access() as drives:
        for drive in drives:
            loss = FrameLoss(**{kind: share}, seed=drive.node_id)
            drive.set_frame_loss(sending=loss, receiving=loss)
    rig.cycles(50)
    last = {}
    for message in rig.frames():
        if message.arbitration_id & 0x780 != 0x200:
            continue
        frame = pdo.decode_rpdo1(bytes(message.data))
        before = last.get(message.arbitration_id, frame.target_counts)
        enabled = frame.controlword & 0x0F == Controlword.ENABLE_OPERATION
        bound = 1.1 * 0.6 * SETTINGS.period * DEFAULT_AXES[0].counts_per_metre + 1
        assert not enabled or abs(frame.target_counts - before) <= bound
        last[message.arbitration_id] = frame.target_counts


def random_frame(rng: random.Random) -> can.Message:
    kind = rng.random()
    near = (0x080, 0x180, 0x280, 0x380, 0x580, 0x700)
    cob_id = rng.choice(near) + rng.randrange(4) if kind < 0.1 else rng.randrange(0x800)
    if kind > 0.95:
        return can.Message(
            arbitration_id=rng.randrange(1 << 29) & ~0x40, is_error_frame=True,
            data=rng.randbytes(8))
    return can.Message(
        arbitration_id=cob_id, is_extended_id=kind > 0.9, is_remote_frame=kind > 0.85,
        data=rng.randbytes(rng.randrange(9)) if kind <= 0.85 else b'')


@situations
def test_random_frames_raise_nothing_and_move_nothing_out_of_limits(rig, situation, caplog):
    SITUATIONS[situation](rig)
    rng = random.Random(situation)
    for _ in range(5000):
        rig.listener.send(random_frame(rng))
    rig.cycles(5)
    assert 'control loop failed' not in caplog.text
    assert max(abs(position) for position in rig.carriages) < 0.2
    assert rig.controller._thread.is_alive()


def test_statusword_bits_of_the_drives_are_told(rig):
    at_rest(rig)
    axis = rig.controller.snapshot().axes[0]
    assert axis.state is State.OPERATION_ENABLED
    assert axis.statusword & Status.DRIVE_FOLLOWS
    assert axis.homed
    assert axis.serial_number == 1
    assert axis.heartbeat_age < 0.2
    assert isinstance(axis.force, float)

