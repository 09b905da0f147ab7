"""Reaction of the drives to a dead control loop; drives without a reaction get no power."""

from bus_world import in_motion
import pytest

from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.states import State
from facade_manipulator.errors import DriveStateError


@pytest.fixture
def without(axes_with):
    """Return a function that makes axes whose profile lacks one object."""
    return lambda index: axes_with(objects=[
        one._asdict() for one in load_profile('simulated').objects if one.index != index])


def kill(rig):
    """End the control loop as after a SIGKILL: it sends no further frame."""
    rig.pass_time(1.0)


@pytest.mark.parametrize('request_', ['home', 'activate'])
@pytest.mark.parametrize('index', [0x1016, 0x6007])
def test_drives_without_dead_master_stop_get_no_power(make_rig, without, index, request_):
    rig = make_rig(axes=without(index))
    for drive in rig.drives:
        drive.objects.defaults[0x6007, 0] = 0
        drive.reboot()
    rig.request('configure')
    with pytest.raises(DriveStateError, match=(
            r'q1 \(node 1\) and q2 \(node 2\) and q3 \(node 3\) would continue .*correct the')):
        rig.request(request_)
    assert State.OPERATION_ENABLED not in rig.drive_states


def test_all_drives_stop_when_the_loop_dies(rig):
    in_motion(rig)
    kill(rig)
    assert State.OPERATION_ENABLED not in rig.drive_states
