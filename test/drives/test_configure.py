"""The drive controller checks the drives: at configure, and in its self-test."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from bus_world import SETTINGS
from drive_faults import configured, in_motion
import pytest

from facade_manipulator.canopen import pdo
from facade_manipulator.drives import commissioning
from facade_manipulator.drives.axis_settings import AXIS_NAMES, DEFAULT_AXES
from facade_manipulator.drives.configuration import drive_writes
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.errors import DriveError, DriveIdentityError, DriveTimeoutError
from facade_manipulator.simulation.drives.drive import (
    simulated_drives,
    SimulatedDrive,
    SimulatedIdentity,
)
from facade_manipulator.simulation.drives.motor import SimulationSettings


def test_drives_just_switched_on_are_configured(rig):
    for drive in rig.drives:
        drive.reboot()
    rig.request('configure')
    assert rig.state is ControllerState.INACTIVE
    assert rig.rejection('home') is None


def test_drives_are_configured_without_a_reset(make_rig):
    rig = make_rig(settings=replace(SETTINGS, reset_nodes=False))
    rig.frames()
    rig.request('configure')
    frames = rig.frames()
    assert not [one for one in frames if one.cob_id == 0 and one.data[0] == 0x81]
    assert not [one for one in frames if one.cob_id == 0x701 and one.data[0] == 0]


def test_drive_with_other_identity_is_rejected(make_rig):
    axes = tuple(replace(axis, serial_number=100 + axis.node_id) for axis in DEFAULT_AXES)
    rig = make_rig(axes=axes)
    rig.request('configure')
    assert not rig.snapshot.notes
    rig.request('cleanup')
    rig.drives[0].set_identity(SimulatedIdentity(serial_number=102))
    with pytest.raises(DriveIdentityError, match='the drive of q2, the axes are swapped'):
        rig.request('configure')


@pytest.mark.parametrize('others', [DEFAULT_AXES, (DEFAULT_AXES[0], DEFAULT_AXES[1])])
def test_two_drives_on_one_node_id_are_found(make_rig, others):
    rig = make_rig(drives=simulated_drives((*others, DEFAULT_AXES[1])))
    with pytest.raises(DriveIdentityError, match=r'q2 \(node 2\) sent \d boot-up messages'):
        rig.request('configure')


@pytest.mark.parametrize('has_kernel_sync', [False, True])
def test_loop_sends_heartbeats_whoever_sends_sync(make_rig, has_kernel_sync):
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
    assert rig.state is ControllerState.STOPPED
    with pytest.raises(DriveError, match='The faults remain'):
        rig.request('clear_faults')
    rig.drives[0].remove_cause()
    assert 'next: home, activate' in rig.request('clear_faults')
    assert rig.state is ControllerState.INACTIVE


def test_no_drive_misses_the_master_after_cleanup(rig):
    configured(rig)
    rig.request('cleanup')
    rig.frames()
    rig.run(3.0 * SETTINGS.heartbeat_timeout)  # nothing must happen
    emergencies = [frame for frame in rig.frames() if 0x81 <= frame.cob_id <= 0xFF]
    assert emergencies == []
    rig.request('configure')
    assert [axis.error_code for axis in rig.snapshot.axes] == [0, 0, 0]


class LateDrive(SimulatedDrive):
    """A drive that takes each SDO request 0.1 s after it has come."""

    requests: deque = deque()

    def receive(self, cob_id, data, now):
        if cob_id != pdo.sdo_request_cob_id(self.node_id):
            return super().receive(cob_id, data, now)
        self.requests.append((now + 0.1, data))
        return []

    def advance(self, now):
        answers = []
        while self.requests and self.requests[0][0] <= now:
            answers += super().receive(
                pdo.sdo_request_cob_id(self.node_id), self.requests.popleft()[1], now)
        return answers + super().advance(now)

    @property
    def deadline(self):
        return min([super().deadline, *(due for due, _ in self.requests)])


@pytest.mark.parametrize('request_', ['configure', 'self_test'])
def test_slow_drive_ends_the_request_in_time(
        make_rig, monkeypatch, request_):
    monkeypatch.setattr(commissioning, 'TURN_TIMEOUT', 0.5)
    drives = simulated_drives(DEFAULT_AXES)
    rig = make_rig(drives=[drives[0], LateDrive(DEFAULT_AXES[1], SimulationSettings()), drives[2]])
    begun = rig.clock.now
    if request_ == 'configure':
        with pytest.raises(DriveTimeoutError, match='q2 .* answers too slowly'):
            rig.request('configure')
    else:
        failed = {one.name: one.message for one in rig.request('self_test') if not one.passed}
        assert 'answers too slowly' in failed['q2 objects'] and 'q1 objects' not in failed
    assert rig.clock.now - begun < 10.0
    assert rig.state is ControllerState.UNCONFIGURED


def test_self_test_names_identity_objects_bus_and_cycle(rig):
    configured(rig)
    notes = rig.snapshot.notes
    assert any('q2 (node 2) accepts any drive: set its serial_number, now 2' in n for n in notes)
    findings = rig.request('self_test')
    assert [finding.name for finding in findings] == [
        *(f'{name} {what}' for name in AXIS_NAMES for what in ('identity', 'objects')),
        'bus', 'cycle', 'faults']
    assert all(finding.passed for finding in findings if finding.name != 'cycle')
    assert 'serial number 2' in findings[2].message
    writes = drive_writes(load_profile('simulated'), rig.axes[1], SETTINGS)
    assert f'has {sum(bool(one.compared) for one in writes)} objects' in findings[3].message


def test_self_test_finds_a_changed_object(rig):
    configured(rig)
    rig.drives[1].objects.values[0x6065, 0] = 5
    failed = [finding for finding in rig.request('self_test') if not finding.passed]
    assert 'q2 objects' in [finding.name for finding in failed]
    assert '6065h:00 reads back as 5' in failed[0].message
