import math

from hypothesis import given
from hypothesis import strategies as st
from mechanism import DESIGN, NO_GAP
import numpy as np
import pytest

from facade_manipulator.errors import ForceLimitError, ParameterError
from facade_manipulator.kinematics import (
    carriage_forces,
    certify_load,
    Geometry,
    mechanism_of,
    Pose,
    Wrench,
)

MACHINE = mechanism_of(DESIGN)
CLOSE = mechanism_of(NO_GAP)
MADE = mechanism_of(Geometry(link_errors=(1e-3, -1e-3), rail_angle=0.01, tool=(0.01, 0.05, 0.0)))
wrenches = st.tuples(*[st.floats(-100.0, 100.0)] * 3).map(lambda values: Wrench(*values))


@pytest.mark.parametrize('machine', [MACHINE, MADE])
@given(wrench=wrenches, rates=st.tuples(*[st.floats(-1.0, 1.0)] * 3))
def test_what_the_carriages_put_in_the_head_gives_out(machine, wrench, rates):
    pose = Pose(0.02, 0.26, 0.03)
    power = np.dot(carriage_forces(machine, pose, wrench), machine.jacobian(pose) @ rates)
    assert power == pytest.approx(np.dot(wrench, rates), abs=1e-9)
    forces = carriage_forces(machine, pose, wrench)
    assert machine.end_effector_force(pose, forces) == pytest.approx(wrench, abs=1e-9)


@pytest.mark.parametrize(('y', 'force'), [(0.06, 20.4), (0.25, 119.0)])
def test_near_the_rail_the_head_presses_less(y, force):
    pose = Pose(0.0, y, 0.0)
    assert certify_load(CLOSE, pose, Wrench(0.0, force, 0.0), 59.0) == CLOSE.certify(pose)
    with pytest.raises(ForceLimitError, match='N is above the bound 59 N'):
        certify_load(CLOSE, pose, Wrench(0.0, 1.01 * force, 0.0), 59.0)


@pytest.mark.parametrize(('wrench', 'limit'), [
    (Wrench(0.0, math.nan, 0.0), 59.0), (Wrench(0.0, 1.0, 0.0), 0.0),
    (Wrench(0.0, 1.0, 0.0), math.nan)])
def test_a_load_that_is_no_number_is_rejected(wrench, limit):
    with pytest.raises(ParameterError):
        certify_load(MACHINE, Pose(0.0, 0.25, 0.0), wrench, limit)
