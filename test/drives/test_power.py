"""Power of a drive: off only if confirmed, and never without the stop for a dead master."""

from __future__ import annotations

from dataclasses import replace

from bus_world import at_rest, in_motion, SETTINGS
import pytest

from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import Controlword, Power, State, UNPOWERED_STATES
from facade_manipulator.errors import BusError, DriveError, DriveStateError

pytestmark = pytest.mark.long

NO_STATE = 0x0005
RELEASE = b'\x23\x16\x10\x01' + bytes(4)  # SDO download of 0 to 1016h:01
IMPATIENT = replace(SETTINGS, step_timeout=0.3)


def obey_nothing(rig):
    rig.drives[1].axis.control = lambda controlword: None


def obey_nothing_on_a_bad_bus(rig):
    def reject_sdo_requests(cob_id, data):
        if cob_id == 0x602 and data != RELEASE:  # the last frame has no answer
            raise BusError('can0 is down')
        return send(cob_id, data)

    obey_nothing(rig)
    send = rig.bus.send
    rig.bus.send = reject_sdo_requests


def fall_silent(rig):
    rig.drives[1].is_silent = True


def name_no_state(rig):
    rig.drives[1].objects.readers[0x6041, 0] = lambda: NO_STATE


def stop_with_power(rig, lie=lambda rig: None):
    """Stop the drives in quick stop active; one drive reports a wrong state from then on."""
    at_rest(rig)
    rig.controller.stop('enough')
    rig.until(lambda: rig.state is ControllerState.STOPPED)
    rig.until(lambda: rig.drive_states == [State.QUICK_STOP_ACTIVE] * 3)
    lie(rig)


@pytest.mark.parametrize(
    'lie', [obey_nothing, obey_nothing_on_a_bad_bus, fall_silent, name_no_state]
)
@pytest.mark.parametrize(
    ('request_', 'state'),
    [('cleanup', ControllerState.UNCONFIGURED), ('close', ControllerState.CLOSED)],
)
def test_end_without_confirmed_power_off_names_the_drive(
    make_rig, lie, request_, state
):
    rig = make_rig(settings=IMPATIENT)
    stop_with_power(rig, lie)
    answer = rig.rejection(request_)
    assert 'the power of q2 (node 2) is not confirmed off' in answer
    assert 'switch the supply off before a person reaches in' in answer
    assert (rig.drive_states[1] is State.QUICK_STOP_ACTIVE) == lie.__name__.startswith(
        'obey'
    )
    assert {rig.drive_states[0], rig.drive_states[2]} <= UNPOWERED_STATES
    assert rig.state is state


@pytest.mark.parametrize(
    'lie', [obey_nothing, obey_nothing_on_a_bad_bus, fall_silent, name_no_state]
)
@pytest.mark.parametrize('request_', ['cleanup', 'close'])
def test_drive_without_confirmed_power_off_still_watches_the_master(
    make_rig, lie, request_
):
    rig = make_rig(settings=IMPATIENT)
    stop_with_power(rig, lie)
    rig.rejection(request_)
    watched = [drive.objects.values[0x1016, 1] & 0xFFFF for drive in rig.drives]
    assert watched == [0, round(1e3 * IMPATIENT.heartbeat_timeout), 0]


def test_close_after_an_unconfirmed_cleanup_names_the_drive_again(make_rig):
    rig = make_rig(settings=IMPATIENT)
    stop_with_power(rig, fall_silent)
    answer = rig.rejection('cleanup').partition('; next')[0]
    assert 'the power of q2 (node 2) is not confirmed off' in answer
    assert answer in rig.rejection('close')


def test_configure_clears_the_report_of_an_unconfirmed_cleanup(make_rig):
    rig = make_rig(settings=IMPATIENT)
    stop_with_power(rig, fall_silent)
    rig.rejection('cleanup')
    rig.repair()
    rig.request('configure', 'cleanup')
    assert 'no drive was configured' in rig.request('close')


@pytest.mark.parametrize('has_started', [False, True])
def test_failed_configure_lets_a_silent_drive_monitor_the_master(rig, has_started):
    job = rig.ask('configure')
    if has_started:
        rig.until(lambda: getattr(rig.controller.bus.exchange, 'has_started', False))
    rig.drives[1].is_silent = True
    with pytest.raises(DriveError):
        rig.finish(job)
    released = [frame.cob_id for frame in rig.frames() if frame.data == RELEASE]
    assert released == [0x601, 0x603]


def test_third_drive_is_switched_off_beside_silent_drives(make_rig):
    rig = make_rig(settings=IMPATIENT)
    stop_with_power(rig, fall_silent)
    rig.drives[0].is_silent = True
    rig.forge(0, bytes([2, 3]))  # NMT stop: no PDO reaches q3
    answer = rig.rejection('cleanup')
    assert 'the power of q1 (node 1) and q2 (node 2) is not confirmed off' in answer
    assert rig.drive_states[2] in UNPOWERED_STATES


def test_power_of_powered_and_silent_drives_is_reported(make_rig):
    rig = make_rig(settings=replace(SETTINGS, max_missed_cycles=3))
    stop_with_power(rig, fall_silent)
    rig.until(lambda: rig.snapshot.power == 'q1 on, q2 unknown, q3 on')
    powers = [axis.power for axis in rig.snapshot.axes]
    assert powers == [Power.ON, Power.UNKNOWN, Power.ON]
    assert 'power: q1 on, q2 unknown, q3 on' in rig.rejection('home')


@pytest.mark.parametrize(('situation', 'number'), [(at_rest, 0), (in_motion, 1)])
def test_drive_deaf_to_rpdo_is_stopped_by_nmt(make_rig, situation, number):
    rig = make_rig(settings=IMPATIENT)
    situation(rig)
    rig.drives[number].is_deaf = True
    rig.frames()
    rig.controller.stop('enough')
    rig.until(lambda: f'q{number + 1} unknown' in rig.snapshot.power)
    rig.until(lambda: rig.drive_states[number] is State.QUICK_STOP_ACTIVE)
    assert f'q{number + 1} did not stop' in rig.all_causes
    assert 'then cleanup, configure, home, activate' in rig.snapshot.next_step
    commands = [frame.data for frame in rig.frames() if frame.cob_id == 0]
    assert commands == [bytes([2, number + 1])]
    assert 'confirmed that their power is off' in rig.request('cleanup')


# --- drives that a silent master uses

ENABLE = (Controlword.SHUTDOWN, Controlword.SWITCH_ON, Controlword.ENABLE_OPERATION)


def write(rig, index, value):
    frame = bytes([0x2B, index & 0xFF, index >> 8, 0, value, 0, 0, 0])
    for node in (1, 2, 3):
        rig.forge(0x600 + node, frame)


@pytest.mark.parametrize(
    ('words', 'state'),
    [
        (ENABLE, State.OPERATION_ENABLED),
        ((*ENABLE, Controlword.QUICK_STOP), State.QUICK_STOP_ACTIVE),
    ],
)
def test_drives_powered_by_a_silent_master_are_left_unchanged(rig, words, state):
    write(rig, 0x605A, 6)
    for word in words:
        write(rig, 0x6040, word)
    rig.until(lambda: rig.drive_states == [state] * 3)
    boots = [drive.objects.nmt.state for drive in rig.drives]
    assert f'q3 (node 3) has power ({state.value})' in rig.rejection('configure')
    assert rig.drive_states == [state] * 3
    assert [drive.objects.nmt.state for drive in rig.drives] == boots
    write(rig, 0x6040, Controlword.DISABLE_VOLTAGE)
    rig.until(lambda: rig.drive_states == [State.SWITCH_ON_DISABLED] * 3)
    rig.request('configure')


def test_drives_operational_for_another_master_are_left_unchanged(rig):
    write(rig, 0x1017, 20)
    rig.forge(0, bytes([1, 0]))
    answer = rig.rejection('configure')
    assert 'q1 (node 1) is operational' in answer
    assert 'q2 (node 2) is operational' in answer


def test_drive_moving_for_another_master_is_left_unchanged(rig):
    rig.drives[1].objects.readers[0x606C, 0] = lambda: -100_000
    assert 'q2 (node 2) moves at -0.233 m/s, which this driver' in rig.rejection(
        'configure'
    )


# --- a dead control loop


@pytest.mark.parametrize('request_', ['home', 'activate'])
@pytest.mark.parametrize('index', [0x1016, 0x6007])
def test_drives_without_dead_master_stop_get_no_power(
    make_rig, axes_with, index, request_
):
    objects = [one._asdict() for one in load_profile('simulated').objects]
    others = [entry for entry in objects if entry['index'] != index]
    rig = make_rig(axes=axes_with(objects=others))
    for drive in rig.drives:
        drive.objects.defaults[0x6007, 0] = 0
        drive.reboot()
    rig.request('configure')
    with pytest.raises(
        DriveStateError,
        match=(
            r'q1 \(node 1\) and q2 \(node 2\) and q3 \(node 3\) would continue .*correct the'
        ),
    ):
        rig.request(request_)
    assert State.OPERATION_ENABLED not in rig.drive_states


def test_all_drives_stop_when_the_loop_dies(rig):
    in_motion(rig)
    rig.pass_time(1.0)  # as after a SIGKILL: the loop sends no further frame
    assert State.OPERATION_ENABLED not in rig.drive_states
