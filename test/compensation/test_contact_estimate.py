import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.compensation.contact_estimate import contact_wrench, FrictionSettings
from facade_manipulator.errors import ParameterError, UnreachableError
from facade_manipulator.kinematics import Geometry, mechanism_of, Pose

GEOMETRY = Geometry()
MACHINE = mechanism_of(GEOMETRY)
MADE = mechanism_of(Geometry(rail_angle=0.02, tool=(0.01, 0.05, 0.03)))
STILL = (0.0, 0.0, 0.0)
poses = st.builds(Pose, st.floats(-0.2, 0.2), st.floats(0.15, 0.3), st.floats(-0.1, 0.1))
triples = st.tuples(*[st.floats(-50.0, 50.0)] * 3)


@pytest.mark.parametrize('machine', [MACHINE, MADE])
@given(pose=poses, forces=triples, rates=triples)
def test_the_power_of_the_wall_is_minus_the_power_of_the_drives(machine, pose, forces, rates):
    wrench = contact_wrench(machine, FrictionSettings(), pose, STILL, forces)
    c, s = math.cos(pose.theta), math.sin(pose.theta)
    on_wall = (c * wrench.fx - s * wrench.fy) * rates[0] \
        + (s * wrench.fx + c * wrench.fy) * rates[1] + wrench.mz * rates[2]
    by_drives = sum(f * v for f, v in zip(
        forces, machine.carriage_velocity(pose, Pose(*rates)), strict=True))
    assert on_wall == pytest.approx(-by_drives, abs=1e-8 * (1.0 + abs(by_drives)))


@given(poses, st.tuples(*[st.floats(0.01, 0.5)] * 3))
def test_forces_that_only_overcome_friction_are_no_contact(pose, velocities):
    friction = FrictionSettings(coulomb=(4.0, 5.0, 6.0), viscous=(10.0, 20.0, 30.0))
    forces = tuple(c + k * v for c, k, v in zip(
        friction.coulomb, friction.viscous, velocities, strict=True))
    wrench = contact_wrench(MACHINE, friction, pose, velocities, forces)
    assert wrench == pytest.approx((0.0, 0.0, 0.0), abs=0.02)


def test_carriages_that_push_outwards_together_press_on_the_wall():
    wrench = contact_wrench(MACHINE, FrictionSettings(), Pose(0.0, 0.25, 0.0), STILL,
                            (-10.0, 10.0, 0.0))
    assert wrench.fy < -10.0  # the wall pushes back
    opposite = contact_wrench(MACHINE, FrictionSettings(), Pose(0.0, 0.25, 0.0), STILL,
                              (10.0, -10.0, 0.0))
    assert opposite.fy == pytest.approx(-wrench.fy)
    assert wrench.fx == pytest.approx(0.0, abs=1e-9) == wrench.mz


def test_a_pose_that_the_mechanism_does_not_have_is_rejected():
    with pytest.raises(UnreachableError):
        contact_wrench(MACHINE, FrictionSettings(), Pose(0.0, 0.4, 0.0), STILL, STILL)


@pytest.mark.parametrize('values', [{'coulomb': (1.0,)}, {'viscous': (-1.0, 0.0, 0.0)}])
def test_friction_that_makes_no_sense_is_rejected(values):
    with pytest.raises(ParameterError, match=next(iter(values))):
        FrictionSettings(**values)
