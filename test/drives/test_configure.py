"""Checks of the drives by the controller at configure."""

from __future__ import annotations

from dataclasses import replace

from bus_world import configured, in_motion, SETTINGS
import pytest

from facade_manipulator.canopen import cob_ids, pdo
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.errors import DriveError
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.simulation.drives.drive import SimulatedDrive


def test_drives_just_switched_on_are_configured(rig):
    for drive in rig.drives:
        drive.reboot()
    configured(rig)
    assert rig.state is ControllerState.INACTIVE
    notes = '; '.join(rig.snapshot.notes)
    assert (
        'q2 (node 2) accepts any drive, so that swapped axes are not found; next: set its '
        'serial_number to 2' in notes
    )


def test_drive_with_other_identity_is_rejected(make_rig):
    axes = [replace(axis, serial_number=100 + axis.node_id) for axis in DEFAULT_AXES]
    rig = make_rig(axes=tuple(axes))
    rig.request('configure')
    assert not rig.snapshot.notes
    rig.request('cleanup')
    rig.drives[0].set_identity(0, 0, 0, 102)
    swapped = (
        'serial_number = 102 is not the configured 101: this is the drive of q2: the axes are '
        'swapped; next: swap the node ids of both drives, or the node_id of both axes, then '
        'configure, home, activate'
    )
    with pytest.raises(DriveError, match=f'{swapped}$'):
        rig.request('configure')


@pytest.mark.parametrize('others', [DEFAULT_AXES, DEFAULT_AXES[:2]])
def test_two_drives_with_one_node_id_are_detected(make_rig, others):
    rig = make_rig(drives=[*map(SimulatedDrive, (*others, DEFAULT_AXES[1]))])
    with pytest.raises(DriveError, match=r'q2 \(node 2\) sent \d boot-up messages'):
        rig.request('configure')


@pytest.mark.parametrize('has_kernel_sync', [False, True])
def test_loop_sends_heartbeats_with_any_sender_of_sync(make_rig, has_kernel_sync):
    rig = make_rig(has_kernel_sync=has_kernel_sync)
    in_motion(rig)
    rig.frames()
    rig.run(0.5)
    sent = [frame.cob_id for frame in rig.frames()]
    assert sent.count(0x080) == pytest.approx(0.5 / SETTINGS.period, abs=2)
    assert sent.count(0x77F) == pytest.approx(0.5 / SETTINGS.heartbeat_period, abs=1)
    assert rig.state is ControllerState.ACTIVE


def test_drive_in_fault_is_configured_but_stopped(rig):
    rig.drives[0].axis.torque_off = True
    assert 'but stopped' in rig.request('configure')
    with pytest.raises(DriveError, match='The faults remain'):
        rig.request('clear_faults')
    assert rig.state is ControllerState.STOPPED
    rig.drives[0].axis.torque_off = False
    assert 'next: home, activate' in rig.request('clear_faults')


# --- objects that a drive rejects

NOT_NOW = 0x08000022  # CiA 301: because of the present device state
REJECTIONS = [0x06010000, 0x08000000, NOT_NOW]


def reject(rig, key, code):
    """Let the drives reject each request for an object with an abort code."""
    deliver = rig.deliver
    place = key[0].to_bytes(2, 'little') + bytes([key[1]])
    abort = b'\x80' + place + code.to_bytes(4, 'little')

    def deliver_aborts(frames):
        changed = []
        for cob_id, data in frames:
            is_answer = cob_id & ~0x7F == cob_ids.SDO_RESPONSE
            is_rejected = is_answer and data[1:4] == place
            changed.append((cob_id, abort if is_rejected else data))
        deliver(changed)

    rig.deliver = deliver_aborts


@pytest.mark.parametrize(
    ('key', 'code'),
    [
        *(((0x100C, 0), code) for code in REJECTIONS),
        ((0x1005, 0), NOT_NOW),
        ((0x1006, 0), NOT_NOW),
        ((0x1018, 4), NOT_NOW),
    ],
)
def test_rejected_object_that_only_informs_is_absent(rig, key, code):
    if key[0] == 0x1006:  # it is read from a drive that sends SYNC
        rig.drives[0].objects.values[0x1005, 0] |= 1 << 30
    reject(rig, key, code)
    rig.request('configure')


def test_operational_drive_that_rejects_1f80_may_have_a_master(rig):
    for drive in rig.drives:
        drive.objects.sdo.download(0x1017, 0, (20).to_bytes(2, 'little'))
    rig.forge(0, bytes([1, 0]))  # NMT start
    reject(rig, (0x1F80, 0), NOT_NOW)
    assert 'q2 (node 2) is operational' in rig.rejection('configure')


@pytest.mark.parametrize('key', [(0x60A8, 0), (0x6092, 1)])
def test_rejected_unit_is_noted_as_not_checked(rig, key):
    reject(rig, key, NOT_NOW)
    configured(rig)
    found = [one for one in rig.snapshot.notes if 'is not checked' in one]
    assert len(found) == 3
    assert f'rejects object {key[0]:04X}h:{key[1]:02X}' in found[0]
    assert '; next: compare' in found[0]
    rig.controller.stop('a reason to prove the units')
    rig.run(0.1)
    assert rig.rejection('clear_faults') is None


@pytest.mark.parametrize('key', [(0x606C, 0), (0x1016, 1)])
def test_rejected_object_that_is_needed_has_a_next_step(rig, key):
    reject(rig, key, NOT_NOW)
    message = rig.rejection('configure')
    assert f'rejects object {key[0]:04X}h:{key[1]:02X}' in message
    assert '(abort 0800 0022h)' in message
    assert '; next: switch the drive off and on' in message


def emergencies(rig):
    """Return the COB-IDs of the drives' emergency messages since the last call."""
    heard = [frame.cob_id for frame in rig.frames()]
    assert heard.count(0x702) > 1  # the bus still carries heartbeats of q2
    return {one for one in heard if 0x81 <= one <= 0xFF}


def test_no_drive_reports_a_lost_master_after_cleanup(rig):
    configured(rig)
    rig.request('cleanup')
    rig.frames()
    rig.run(3.0 * SETTINGS.heartbeat_timeout)
    assert not emergencies(rig)


def test_drives_report_a_master_that_falls_silent(rig):
    configured(rig)
    rig.frames()
    rig.pass_time(3.0 * SETTINGS.heartbeat_timeout)
    assert emergencies(rig) == {0x81, 0x82, 0x83}


def test_slow_drive_ends_configure_in_time(rig, monkeypatch):
    monkeypatch.setattr('facade_manipulator.drives.waiting.TURN_TIMEOUT', 1.0)
    receive = rig.drives[1].receive

    def receive_sdo_late(*frame):
        if frame[0] != cob_ids.SDO_REQUEST + 2:
            return receive(*frame)
        rig.later(0.1, lambda: rig.deliver(receive(*frame)))
        return []

    rig.drives[1].receive = receive_sdo_late
    begun = rig.clock.now
    with pytest.raises(DriveError, match='q2 .* answers too slowly'):
        rig.request('configure')
    assert rig.clock.now - begun < 10.0
    assert rig.state is ControllerState.UNCONFIGURED


def test_missing_process_data_are_named_at_configure(rig):
    receive = rig.drives[1].receive
    lost = pdo.TPDO3.cob_id(2)
    rig.drives[1].receive = lambda *frame: [
        one for one in receive(*frame) if one[0] != lost
    ]
    with pytest.raises(DriveError, match=r'TPDO3 of q2 \(node 2\) did not arrive'):
        rig.request('configure')
    assert rig.state is ControllerState.UNCONFIGURED


def test_self_test_names_the_drive_with_a_changed_object(rig):
    configured(rig)
    assert rig.request('self_test') == dict.fromkeys(AXIS_NAMES, '')
    rig.drives[1].objects.values[0x6065, 0] = 5
    problems = rig.request('self_test')
    assert '6065h:00 reads back as 5' in problems.pop('q2')
    assert problems == {'q1': '', 'q3': ''}


def is_sdo_request(frame):
    """Return whether a frame is an SDO request to a drive."""
    return frame.cob_id - cob_ids.SDO_REQUEST in (1, 2, 3)


def test_self_test_reads_several_objects_in_each_cycle(rig):
    configured(rig)
    rig.frames()
    begin = rig.clock.now
    rig.request('self_test')
    cycles = (rig.clock.now - begin) / rig.settings.period
    requests = [one for one in rig.frames() if is_sdo_request(one)]
    assert len(requests) > 20 * cycles


def test_self_test_queries_all_drives_at_the_same_time(rig):
    configured(rig)
    rig.frames()
    rig.request('self_test')
    first = [one.cob_id for one in rig.frames() if is_sdo_request(one)][:3]
    assert sorted(first) == [0x601, 0x602, 0x603]


DEVICE_TYPE = 0x582, bytes.fromhex('4300100092010200')  # answer of q2 for 1000h


def asks_for_identity(frame):
    """Return whether a frame requests object 1018h of q2, which is read after 1000h."""
    index = int.from_bytes(frame.data[1:3], 'little')
    return frame.cob_id == 0x602 and index == 0x1018


def test_answer_within_a_self_test_continues_it(rig):
    configured(rig)
    rig.drives[1].is_silent = True
    rig.ask('self_test')
    rig.frames()
    rig.deliver([DEVICE_TYPE])
    rig.cycles(3)
    assert any(asks_for_identity(one) for one in rig.frames())


def test_late_answer_after_a_cancelled_self_test_is_ignored(rig):
    configured(rig)
    rig.drives[1].is_silent = True
    job = rig.ask('self_test')
    close = rig.ask('close')
    assert 'cancelled by close' in str(job.exception())
    rig.frames()
    rig.deliver([DEVICE_TYPE])
    assert rig.bus.inbox[-1].cob_id == 0x582
    rig.until(close.done)
    heard = rig.frames()
    assert heard
    assert not any(asks_for_identity(one) for one in heard)


def test_changed_objects_of_two_drives_are_both_named(rig):
    configured(rig)
    rig.controller.stop('enough')
    rig.until_stopped()
    for drive in rig.drives[::2]:
        drive.objects.values[0x6065, 0] = 5
    rig.rejection('clear_faults')
    for title in ('q1 (node 1)', 'q3 (node 3)'):
        assert f'{title}: object 6065h:00 reads back as 5' in rig.all_causes


def test_changed_object_prevents_clear_faults(rig):
    configured(rig)
    rig.controller.stop('enough')
    rig.until_stopped()
    rig.drives[1].objects.values[0x6065, 0] = 5
    assert (
        'The faults remain: q2 (node 2): object 6065h:00 reads back as 5'
        in rig.rejection('clear_faults')
    )
    assert 'then cleanup, configure, home, activate' in rig.snapshot.next_step
