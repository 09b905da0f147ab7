"""Homing method 37 with a carriage that is not at its home position."""

from bus_world import HOME, Rig
import pytest

from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.simulation.drives import hand

PUSHED = 0.03  # m


def test_unparked_carriage_has_a_wrong_position_without_message():
    rig = Rig()
    assert all(axis.homing_method == 37 for axis in rig.axes)
    hand.act('push q2 30', {'q2': rig.drives[1]})
    rig.run(1.0)
    rig.request('configure', 'home', 'activate')
    positions = [axis.position for axis in rig.snapshot.axes]
    assert positions == pytest.approx(HOME, abs=1e-4)
    assert rig.carriages[1] == pytest.approx(HOME[1] + PUSHED, abs=1e-4)
    assert rig.state is ControllerState.ACTIVE and rig.snapshot.causes == ()
