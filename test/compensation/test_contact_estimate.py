from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.compensation.contact_estimate import contact_wrench, FrictionSettings
from facade_manipulator.drives.units import AxisScale
from facade_manipulator.errors import UnreachableError
from facade_manipulator.kinematics import Geometry, mechanism_of, Pose, Wrench
from facade_manipulator.lab.gondola.reaction import carriage_loads
from facade_manipulator.simulation.drives.motor import SimulatedMotor, SimulationSettings

GEOMETRY = Geometry()
MACHINE = mechanism_of(GEOMETRY)
SCALE = AxisScale()
MADE = mechanism_of(Geometry(rail_angle=0.02, tool=(0.01, 0.05, 0.03)))
STILL = (0.0, 0.0, 0.0)
FRICTIONLESS = FrictionSettings(efficiency=1.0)
poses = st.builds(Pose, st.floats(-0.2, 0.2), st.floats(0.15, 0.3), st.floats(-0.1, 0.1))
triples = st.tuples(*[st.floats(-50.0, 50.0)] * 3)


@pytest.mark.parametrize('machine', [MACHINE, MADE])
@given(pose=poses, forces=triples, rates=triples)
def test_the_power_of_the_wall_is_minus_the_power_of_the_drives(machine, pose, forces, rates):
    wrench = contact_wrench(machine, FRICTIONLESS, pose, STILL, forces)
    c, s = math.cos(pose.theta), math.sin(pose.theta)
    on_wall = (c * wrench.fx - s * wrench.fy) * rates[0] \
        + (s * wrench.fx + c * wrench.fy) * rates[1] + wrench.mz * rates[2]
    by_drives = sum(f * v for f, v in zip(
        forces, machine.carriage_velocity(pose, Pose(*rates)), strict=True))
    assert on_wall == pytest.approx(-by_drives, abs=1e-8 * (1.0 + abs(by_drives)))


@given(poses, st.tuples(*[st.floats(0.01, 0.5)] * 3))
def test_forces_that_only_overcome_friction_are_no_contact(pose, velocities):
    friction = FrictionSettings(
        coulomb=(4.0, 5.0, 6.0), viscous=(10.0, 20.0, 30.0), efficiency=0.7)
    forces = tuple(c + k * v for c, k, v in zip(
        friction.coulomb, friction.viscous, velocities, strict=True))
    wrench = contact_wrench(MACHINE, friction, pose, velocities, forces)
    assert wrench == pytest.approx((0.0, 0.0, 0.0), abs=0.02)


FRICTION = FrictionSettings(coulomb=(4.0,) * 3, viscous=(10.0,) * 3)


def pressed_by_drives(friction, seconds=20.0):
    """Return errors of the force that simulated drives show on a wall in sway and strokes [N]."""
    motors = [SimulatedMotor(SimulationSettings(), SCALE) for _ in range(3)]
    errors, last = [], None
    for k in range(round(seconds / 0.01)):
        time = 0.01 * k
        pose = Pose(0.1 * math.sin(0.7 * time) + 0.1 * math.sin(0.9 * time),
                    0.23 + 0.015 * math.sin(1.3 * time), 0.03 * math.sin(time))
        carriages = MACHINE.inverse_kinematics(pose)
        wall = Wrench(9.0 * math.tanh(20.0 * math.sin(0.7 * time)), -30.0, 0.0)
        loads = carriage_loads(MACHINE, pose, wall)
        if last is None:
            for motor, place in zip(motors, carriages, strict=True):
                motor.place(place)
        else:
            for motor, place, before, load in zip(motors, carriages, last, loads, strict=True):
                move(motor, before, place, load)
            wrench = contact_wrench(
                MACHINE, friction, pose,
                tuple(motor.velocity / SCALE.counts_per_metre for motor in motors),
                tuple(SCALE.force_per_torque_unit * round(motor.torque) for motor in motors))
            errors.append(wall.fy - wrench.fy)
        last = carriages
    return np.array(errors[100:])


def move(motor, before, place, load):
    motor.external_force, counts = load, SCALE.counts_per_metre
    speed = (place - before) / 0.01 * counts
    for k in range(10):
        motor.follow(before * counts + speed * 0.001 * (k + 1), speed, 0.001,
                     motor.peak_speed, motor.peak_acceleration)


def test_the_force_from_the_drives_is_true_to_a_newton_and_a_half_on_a_smooth_path():
    errors = pressed_by_drives(FRICTION)
    assert abs(errors.mean()) < 0.5
    assert errors.std() < 1.5


@pytest.mark.long
@pytest.mark.parametrize('friction', [
    FrictionSettings(), replace(FRICTION, efficiency=1.0)])
def test_without_friction_or_efficiency_it_is_worse(friction):
    known, unknown = (
        np.sqrt((pressed_by_drives(each) ** 2).mean()) for each in (FRICTION, friction))
    assert unknown > 1.2 * known


def test_a_pose_that_the_mechanism_does_not_have_is_rejected():
    with pytest.raises(UnreachableError):
        contact_wrench(MACHINE, FrictionSettings(), Pose(0.0, 0.4, 0.0), STILL, STILL)
