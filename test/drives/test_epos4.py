"""The three drives of the published machine, enforced as their maker describes them."""

from __future__ import annotations

from dataclasses import replace

from drive_faults import in_motion
import pytest

from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.errors import DriveIdentityError, DriveObjectError
from facade_manipulator.simulation.drives.drive import simulated_drives, SimulatedIdentity

AXES = tuple(replace(axis, profile='epos4') for axis in DEFAULT_AXES)
MILLI_RPM = 0xFDB44700


@pytest.fixture
def epos4(make_rig):
    return make_rig(axes=AXES, drives=simulated_drives(AXES))


def test_epos4_drives_home_and_move(epos4):
    assert {drive.objects.values[0x1018, 1] for drive in epos4.drives} == {0xFB}
    in_motion(epos4)
    epos4.request('deactivate')
    assert epos4.state is ControllerState.INACTIVE
    assert epos4.drives[0].objects.values[0x6085, 0] == round(6.0 / 0.02 * 4.3 * 60.0)  # rpm/s


def test_epos4_with_other_unit_is_rejected(epos4):
    epos4.drives[1].objects.stored[0x60A9, 0] = MILLI_RPM
    with pytest.raises(DriveObjectError, match=(
            r'q2 \(node 2\): .*60A9h:00 = FDB44700h.*00B44700h')) as error:
        epos4.request('configure')
    assert 'q1' not in str(error.value)
    assert 'FDB44700h' in {
        finding.name: finding.message for finding in epos4.request('self_test')}['q2 objects']


def test_drive_of_another_maker_is_rejected(epos4):
    epos4.drives[2].set_identity(SimulatedIdentity(0x17F, 1, 1, 3))
    with pytest.raises(DriveIdentityError, match='vendor_id = 383 is not the configured 251'):
        epos4.request('configure')
