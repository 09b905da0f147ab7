"""Kinematics of the machine with its calibration errors."""

from functools import partial
import math

from hypothesis import assume, given
from hypothesis import strategies as st
from mechanism import DESIGN, NO_GAP, passes, workspace_poses
import numpy as np
import pytest

from facade_manipulator.errors import (
    CarriageGapError,
    ParameterError,
    SingularityError,
    StrokeLimitError,
    UnreachableError,
)
from facade_manipulator.kinematics import (
    assembly_modes,
    Carriages,
    forward_kinematics,
    Geometry,
    inverse_kinematics,
    jacobian,
    local_conditioning_index,
    Mechanism,
    Pose,
    Twist,
)

HEAD = Pose(0.02, 0.25, 0.05)
forces = st.tuples(*[st.floats(-100.0, 100.0)] * 3)
rates = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


def errors(size, count):
    return st.tuples(*[st.floats(-size, size)] * count)


@st.composite
def machines(draw):
    """Draw a machine, nominal or with a few times the errors of a workshop, and a pose."""
    if draw(st.booleans()):
        geometry = Geometry(
            carriage_gap=0.0,
            stroke=(-0.6, 0.6),
            link_errors=draw(errors(2e-3, 2)),
            platform_errors=draw(errors(2e-3, 2)),
            carriage_offsets=draw(errors(3e-3, 3)),
            rail_angle=draw(st.floats(-0.02, 0.02)),
            tool=draw(errors(0.05, 3)),
        )
    else:
        geometry = DESIGN
    machine = Mechanism(geometry)
    pose = machine.head(draw(workspace_poses(NO_GAP)))
    assume(passes(machine.certify, pose))
    return machine, pose


@given(machines())
def test_functions_of_a_geometry_ignore_its_errors(drawn):
    machine, pose = drawn
    with_errors = machine.geometry
    drawing = Geometry(carriage_gap=0.0, stroke=(-0.6, 0.6))
    assume(passes(Mechanism(drawing).certify, pose))
    carriages = inverse_kinematics(drawing, pose)
    assert inverse_kinematics(with_errors, pose) == carriages
    assert forward_kinematics(with_errors, carriages) == forward_kinematics(
        drawing, carriages
    )
    assert (jacobian(with_errors, pose) == jacobian(drawing, pose)).all()


@given(machines())
def test_forward_kinematics_undoes_inverse_kinematics(drawn):
    machine, pose = drawn
    machine.check(machine.certify(pose))
    assert machine.forward_kinematics(
        machine.inverse_kinematics(pose)
    ) == pytest.approx(pose, abs=1e-12)


@given(machines())
def test_jacobian_is_the_derivative_of_inverse_kinematics(drawn):
    machine, pose = drawn
    step = 1e-7
    matrix = machine.jacobian(pose)
    assume(abs(matrix).max() < 20.0)
    for column, unit in zip(matrix.T, np.eye(3), strict=True):
        ahead = Pose(*(pose + step * unit))
        back = Pose(*(pose - step * unit))
        change = np.subtract(
            machine.inverse_kinematics(ahead), machine.inverse_kinematics(back)
        )
        slope = change / (2.0 * step)
        assert column == pytest.approx(slope, rel=3e-4, abs=3e-4)


@given(machines(), forces, rates)
def test_carriage_velocity_and_force_match_the_head(drawn, wrench, velocity):
    machine, pose = drawn
    matrix = machine.jacobian(pose)
    moved = matrix @ velocity
    tolerance = 1e-9 * (1.0 + np.abs(matrix).max())
    found = machine.carriage_velocity(pose, Twist(*velocity))
    assert found == pytest.approx(moved, abs=tolerance)
    assume(np.linalg.cond(matrix) < 1e3)
    needed = machine.carriage_forces(pose, wrench)
    power = np.dot(wrench, velocity)
    assert np.dot(needed, moved) == pytest.approx(power, abs=1e-7)
    assert machine.end_effector_force(pose, needed) == pytest.approx(wrench, abs=1e-7)


@given(machines())
def test_inverse_kinematics_keeps_the_measured_lengths(drawn):
    machine, pose = drawn
    geometry = machine.geometry
    x, y, theta = machine.platform(pose)
    q1, q2, q3 = machine.on_rail(machine.inverse_kinematics(pose))
    l1, l2 = geometry.link_lengths
    b1, b2 = geometry.half_lengths
    rise_1 = b1 * math.sin(theta)
    rise_2 = b2 * math.sin(theta)
    span_1 = b1 * math.cos(theta)
    span_2 = b2 * math.cos(theta)
    assert math.hypot(x - span_1 - q1, y - rise_1) == pytest.approx(l1)
    assert math.hypot(x + span_2 - q2, y + rise_2) == pytest.approx(l2)
    assert q3 == pytest.approx(x, abs=1e-14)


@given(workspace_poses())
def test_vanishing_errors_give_the_nominal_kinematics(pose):
    assume(local_conditioning_index(DESIGN, pose) > 0.06)
    drawing = Mechanism(DESIGN)
    almost = Mechanism(Geometry(tool=(1e-300, 0.0, 0.0)))
    assert almost.certify(pose) == pytest.approx(drawing.certify(pose), abs=1e-14)
    nominal = jacobian(DESIGN, pose)
    assert almost.jacobian(pose) == pytest.approx(nominal, rel=1e-12, abs=1e-12)


def made(**given):
    return Mechanism(Geometry(**given))


def test_each_calibration_error_moves_the_head():
    at = made().inverse_kinematics(HEAD)
    moved = made(carriage_offsets=(1e-3, 1e-3, 1e-3)).forward_kinematics(at)
    expected = (HEAD.x + 1e-3, HEAD.y, HEAD.theta)
    assert moved == pytest.approx(expected, abs=1e-12)
    turned = made(rail_angle=0.1).forward_kinematics(at)
    assert turned.theta == pytest.approx(HEAD.theta + 0.1)
    distance = math.hypot(HEAD.x, HEAD.y)
    assert math.hypot(turned.x, turned.y) == pytest.approx(distance)
    ahead = made(tool=(0.0, 0.08, 0.0)).forward_kinematics(at)
    assert ahead.y == pytest.approx(HEAD.y + 0.08 * math.cos(HEAD.theta))


def test_limits_apply_to_the_calibrated_machine():
    with pytest.raises(UnreachableError, match=r'\|y\| \+ b \|sin theta\|'):
        made(link_errors=(-0.01, -0.01)).certify(Pose(0.0, 0.345, 0.0))
    made().certify(Pose(0.0, 0.345, 0.0))
    with pytest.raises(StrokeLimitError):
        made(carriage_offsets=(0.03, 0.0, 0.0)).certify(Pose(-0.32, 0.3, 0.0))
    with pytest.raises(CarriageGapError):
        made(carriage_offsets=(0.01, 0.0, 0.0)).check(Carriages(-0.025, 0.1, 0.0))
    with pytest.raises(SingularityError, match='behind the rail'):
        made(tool=(0.0, 0.08, 0.0)).certify(Pose(0.0, 0.07, 0.0))


@pytest.mark.parametrize('error', [{'rail_angle': 0.01}, {'link_errors': (1e-3, 0.0)}])
def test_carriages_without_a_pose_are_rejected(error):
    with pytest.raises(UnreachableError):
        made(**error).check(Carriages(-0.49, 0.49, 0.0))
    with pytest.raises(UnreachableError):
        made(**error).forward_kinematics(Carriages(-1000.0, 1000.0, 0.0))


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize('place', range(3))
@pytest.mark.parametrize('error', [{}, {'rail_angle': 0.01}])
def test_coordinate_that_is_not_finite_is_named(error, place, bad):
    machine = made(**error)
    values = [0.0, 0.25, 0.0]
    values[place] = bad
    for kind, function in (
        (Pose, machine.certify),
        (Pose, machine.inverse_kinematics),
        (Carriages, machine.check),
        (Carriages, machine.forward_kinematics),
        (Carriages, partial(assembly_modes, DESIGN)),
    ):
        with pytest.raises(
            ParameterError, match=f'{kind._fields[place]} = {bad} is not a finite'
        ):
            function(kind(*values))
