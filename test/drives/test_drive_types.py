"""Drives whose process data and objects are not those of the package's own profiles."""

from __future__ import annotations

import re

from drive_parts import axes_with
import pytest

from facade_manipulator.canopen import pdo
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.errors import DriveTimeoutError
from facade_manipulator.simulation.drives.drive import simulated_drives, SimulatedDrive
from facade_manipulator.simulation.drives.motor import SimulationSettings

MAPS = {
    'the smallest map': {
        'RPDO1': [0x6040, 0x6060, 0x607A], 'TPDO1': [0x6041, 0x6061, 0x6064]},
    'that of CiA 402': {
        'RPDO2': [0x6040, 0x6060], 'RPDO3': [0x6040, 0x607A],
        'TPDO2': [0x6041, 0x6061], 'TPDO3': [0x6041, 0x6064]},
    'with an object of no use': {
        'RPDO1': [0x607A, 0x6040, 0x6060],
        'TPDO4': [0x6064, {'index': 0x1001, 'subindex': 0, 'bits': 8}, 0x6061, 0x6041],
        'TPDO1': [0x606C]},
}
UNMAPPED = (0x606C, 0x60F4, 0x603F, 0x6077)


def move(rig):
    """Home, activate and move for a while; the drives end without power."""
    rig.request('configure', 'home')
    rig.stream()
    rig.request('activate')
    rig.until(lambda: rig.snapshot.axes[1].position > 0.12)
    speed = rig.drives[1].motor.velocity * rig.axes[1].to_metres(1.0)
    assert rig.snapshot.axes[1].velocity == pytest.approx(speed, abs=0.02)
    rig.request('deactivate')


@pytest.mark.parametrize('name', MAPS)
def test_drives_with_other_maps_home_and_move(make_rig, tmp_path, name):
    lacks = UNMAPPED if 'least' in name else ()
    axes = axes_with(tmp_path, pdos=MAPS[name])
    rig = make_rig(axes=axes, drives=simulated_drives(
        axes, SimulationSettings(missing_objects=lacks)))
    move(rig)
    assert rig.state is ControllerState.INACTIVE
    assert [rig.snapshot.axes[0].force,
            rig.snapshot.axes[0].following_error] == [None, None]


def of_the_other_sign(directory):
    """Return axes of drives whose zero is home plus 607Ch, as CiA 402 is printed by Elmo."""
    objects = [item._asdict() for item in load_profile('simulated').objects]
    for one in objects:
        one['value'] = {'home_position': 'home_offset'}.get(one['value'], one['value'])
    return axes_with(directory, objects=objects)


def test_home_offset_of_other_sign_homes(make_rig, tmp_path):
    rig = make_rig(axes=of_the_other_sign(tmp_path))
    move(rig)
    assert rig.drives[0].objects.values[0x607C, 0] == DEFAULT_AXES[0].to_counts(0.1)


def test_wrong_sign_of_home_offset_is_named(make_rig, tmp_path):
    rig = make_rig(drives=simulated_drives(of_the_other_sign(tmp_path)))
    rig.request('configure')
    assert re.search('q1: homing ended .0.2 m from .* takes 607Ch with the other sign',
                     rig.rejection('home'))
    assert 'q1' in rig.snapshot.unhomed


def test_self_test_before_configure_changes_nothing(rig):
    rig.frames()
    findings = {finding.name: finding for finding in rig.request('self_test')}
    assert findings['q2 objects'].passed
    assert 'configure will change' in findings['q2 objects'].message
    assert '6065h:00' in findings['q2 objects'].message
    frames = rig.frames()
    assert {frame.cob_id for frame in frames if frame.cob_id < 0x580} == set()
    assert {frame.data[0] & 0xE0 for frame in frames if 0x600 < frame.cob_id < 0x680} <= {
        0x40, 0x60, 0x80}  # upload, its segments, abort: no download
    assert 0x77F not in {frame.cob_id for frame in frames}
    rig.request('configure', 'cleanup')
    findings = {finding.name: finding for finding in rig.request('self_test')}
    assert findings['q2 objects'].message.endswith('will change 1 of them: 1016h:01')


def silence(drive: SimulatedDrive, cob_id: int) -> None:
    """Let a drive keep one of its TPDOs to itself."""
    answer = drive.receive
    drive.receive = lambda *frame: [
        (sent, data) for sent, data in answer(*frame) if sent != cob_id]


def test_missing_process_data_are_named_at_configure(rig):
    silence(rig.drives[1], pdo.TPDO3.cob_id(2))
    with pytest.raises(DriveTimeoutError, match=r'TPDO3 of q2 \(node 2\) did not come'):
        rig.request('configure')
    assert rig.state is ControllerState.UNCONFIGURED
