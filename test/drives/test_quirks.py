"""Drives that depart from CiA 402, without the quirk of the profile and with it."""

from __future__ import annotations

from drive_faults import in_motion
from drive_parts import axes_with
import pytest

from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import State
from facade_manipulator.errors import DriveError
from facade_manipulator.simulation.drives.drive import simulated_drives


def hide_mode(drive):
    mode = drive.objects.readers[0x6061, 0]
    drive.objects.readers[0x6061, 0] = lambda: (
        mode() if drive.state is State.OPERATION_ENABLED else 0)


def need_bits(drive):
    csp = drive.axis.cyclic
    latch, status = csp.latch, csp.status

    def has_bits():
        return drive.axis._controlword & 0x30 == 0x30

    csp.latch = lambda: has_bits() and latch()
    csp.status = lambda: has_bits() * status()


@pytest.mark.parametrize(('depart', 'quirks'), [
    (hide_mode, {'hides_mode': True}), (need_bits, {'csp_bits': 0x30})])
def test_drive_with_its_quirk_homes_moves_and_powers_off(make_rig, tmp_path, depart, quirks):
    axes = axes_with(tmp_path, quirks=quirks)
    drives = simulated_drives(axes)
    for drive in drives:
        depart(drive)
    rig = make_rig(axes=axes, drives=drives)
    in_motion(rig)
    rig.request('deactivate')
    assert rig.state is ControllerState.INACTIVE


@pytest.mark.parametrize(('depart', 'request_name', 'message'), [
    (hide_mode, 'home', 'q1 did not select its mode of operation in time: .* in mode 0 instead'),
    (need_bits, 'activate', 'q1 does not follow its targets, bit 12 is 0')])
def test_drive_without_its_quirk_is_stopped_with_the_reason(
        make_rig, depart, request_name, message):
    rig = make_rig()
    rig.request('configure')
    if request_name == 'activate':
        rig.request('home')
    depart(rig.drives[0])
    with pytest.raises(DriveError, match=message):
        rig.request(request_name)
    rig.until_stopped()
