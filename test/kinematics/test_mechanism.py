from functools import partial
import math

from hypothesis import assume, given
from hypothesis import strategies as st
from mechanism import DESIGN, NO_GAP, workspace_poses
import numpy as np
import pytest

from facade_manipulator.errors import (
    CarriageGapError,
    LimitError,
    ParameterError,
    SingularityError,
    StrokeLimitError,
    UnreachableError,
)
from facade_manipulator.kinematics import (
    Carriages,
    certify,
    Geometry,
    jacobian,
    local_conditioning_index,
    mechanism_of,
    Pose,
)
from facade_manipulator.kinematics.calibrated import CalibratedMechanism, Screw

SPAN = (-0.5, 0.5)
HEAD = Pose(0.02, 0.25, 0.05)


def errors(size, count):
    return st.tuples(*[st.floats(-size, size)] * count)


@st.composite
def machines(draw, knots=9):
    """Draw a machine with errors a few times those of a shop, and a tool as there are."""
    screws = {f'screw_errors_q{k}': tuple(draw(st.lists(
        st.floats(-1e-4, 1e-4), min_size=1, max_size=knots))) for k in (1, 2, 3)}
    return mechanism_of(Geometry(
        carriage_gap=0.0, stroke=(-0.6, 0.6), link_errors=draw(errors(2e-3, 2)),
        platform_errors=draw(errors(2e-3, 2)), carriage_offsets=draw(errors(3e-3, 3)),
        rail_angle=draw(st.floats(-0.02, 0.02)), tool=draw(errors(0.05, 3)),
        rail_bow=draw(st.floats(-2e-3, 2e-3)), slide_angle=draw(st.floats(-0.02, 0.02)), **screws))


@st.composite
def placed_machines(draw, knots=9):
    """Draw a machine and a pose of its head that it may take."""
    machine = draw(machines(knots))
    pose = machine.head(draw(workspace_poses(NO_GAP)))
    try:
        machine.certify(pose)
    except LimitError:
        assume(False)
    return machine, pose


@given(placed_machines())
def test_forward_undoes_inverse_kinematics_of_the_machine_as_it_was_made(placed):
    machine, pose = placed
    assert machine.forward_kinematics(machine.inverse_kinematics(pose)) == pytest.approx(
        pose, abs=1e-12)


@given(placed_machines(knots=2))  # one straight piece: at a knot there is no derivative
def test_the_jacobian_is_the_derivative_of_the_inverse_kinematics(placed):
    machine, pose = placed
    step, matrix = 1e-7, machine.jacobian(pose)
    assume(abs(matrix).max() < 20.0)
    for column, unit in zip(matrix.T, np.eye(3), strict=True):
        ahead, back = (
            np.array(machine.inverse_kinematics(Pose(*(np.array(pose) + sign * step * unit))))
            for sign in (1.0, -1.0))
        assert column == pytest.approx((ahead - back) / (2.0 * step), rel=3e-4, abs=3e-4)


@given(placed_machines())
def test_inverse_kinematics_keeps_the_lengths_that_were_measured(placed):
    machine, pose = placed
    geometry, platform = machine.geometry, machine.platform(pose)
    q1, q2, q3 = machine.on_rail(machine.inverse_kinematics(pose))
    (l1, l2), (b1, b2) = (
        [nominal + error for error in given] for nominal, given in (
            (geometry.link_length, geometry.link_errors),
            (geometry.platform_half_length, geometry.platform_errors)))
    sine, cosine = math.sin(platform.theta), math.cos(platform.theta)
    h1, h2, h3 = (geometry.rail_bow * (1.0 - (q / 0.6) ** 2) for q in (q1, q2, q3))
    lean = math.tan(geometry.slide_angle) - 2.0 * geometry.rail_bow * q3 / 0.6 ** 2
    assert math.hypot(platform.x - b1 * cosine - q1, platform.y - b1 * sine - h1) == (
        pytest.approx(l1))
    assert math.hypot(platform.x + b2 * cosine - q2, platform.y + b2 * sine - h2) == (
        pytest.approx(l2))
    assert q3 - lean * (platform.y - h3) == pytest.approx(platform.x, abs=1e-14)


@given(workspace_poses())
def test_vanishing_errors_lead_to_the_nominal_machine(pose):
    assume(local_conditioning_index(DESIGN, pose) > 0.06)
    exact = CalibratedMechanism(DESIGN)
    assert exact.certify(pose) == pytest.approx(certify(DESIGN, pose), abs=1e-14)
    assert exact.jacobian(pose) == pytest.approx(jacobian(DESIGN, pose), rel=1e-12, abs=1e-12)
    index = local_conditioning_index(DESIGN, pose)
    with pytest.raises(SingularityError, match='conditioning'):
        exact.certify(pose, index * 1.0001)
    exact.certify(pose, index * 0.9999)


def test_beyond_the_parallel_singularity_it_is_as_far_as_the_nominal_machine():
    geometry, pose, beyond = Geometry(0.15, 0.55, carriage_gap=0.0), Pose(0.0, 0.02, 0.1), []
    for check in (CalibratedMechanism(geometry).certify, partial(certify, geometry)):
        with pytest.raises(SingularityError) as error:
            check(pose)
        beyond.append(error.value.value)
    assert beyond[0] == pytest.approx(beyond[1])


def made(**given):
    return mechanism_of(Geometry(**given))


def test_each_error_moves_the_head_as_it_would_in_the_shop():
    at = mechanism_of(DESIGN).inverse_kinematics(HEAD)
    moved = made(carriage_offsets=(1e-3, 1e-3, 1e-3)).forward_kinematics(at)
    assert moved == pytest.approx((HEAD.x + 1e-3, HEAD.y, HEAD.theta), abs=1e-12)
    turned = made(rail_angle=0.1).forward_kinematics(at)
    assert turned.theta == pytest.approx(HEAD.theta + 0.1)
    assert math.hypot(turned.x, turned.y) == pytest.approx(math.hypot(HEAD.x, HEAD.y))
    leaning = made(slide_angle=0.01).inverse_kinematics(HEAD)
    assert leaning == pytest.approx(at._replace(q3=at.q3 + HEAD.y * math.tan(0.01)), abs=1e-12)
    bowed = made(rail_bow=1e-3, stroke=(-5.0, 5.0)).forward_kinematics(at)  # level where it stands
    assert bowed == pytest.approx(HEAD._replace(y=HEAD.y + 1e-3), abs=1e-4)
    ahead = made(tool=(0.0, 0.08, 0.0)).forward_kinematics(at)
    assert ahead.y == pytest.approx(HEAD.y + 0.08 * math.cos(HEAD.theta))


def test_limits_are_those_of_the_machine_that_is_there():
    short = made(link_errors=(-0.01, -0.01))
    with pytest.raises(UnreachableError, match='b1 sin theta'):
        short.certify(Pose(0.0, 0.345, 0.0))
    certify(DESIGN, Pose(0.0, 0.345, 0.0))
    with pytest.raises(StrokeLimitError):
        made(carriage_offsets=(0.03, 0.0, 0.0)).certify(Pose(-0.32, 0.3, 0.0))
    with pytest.raises(CarriageGapError):
        made(carriage_offsets=(0.01, 0.0, 0.0)).check(Carriages(-0.025, 0.1, 0.0))
    with pytest.raises(SingularityError, match='behind the rail'):
        made(tool=(0.0, 0.08, 0.0)).certify(Pose(0.0, 0.07, 0.0))


def test_carriages_on_which_the_links_cannot_be_joined_are_rejected():
    with pytest.raises(UnreachableError):
        made(rail_angle=0.01).check(Carriages(-0.49, 0.49, 0.0))


@pytest.mark.parametrize('bad', [math.nan, math.inf])
def test_what_is_no_number_is_rejected(bad):
    machine = made(rail_angle=0.01)
    for question, argument in (
            (machine.certify, Pose(0.0, bad, 0.0)), (machine.check, Carriages(0.0, bad, 0.1)),
            (machine.forward_kinematics, Carriages(bad, 0.1, 0.0))):
        with pytest.raises(ParameterError):
            question(argument)


@given(st.lists(st.floats(-1e-3, 1e-3), min_size=1, max_size=30), st.floats(-0.01, 0.01),
       st.floats(-0.7, 0.7))
def test_a_screw_leads_back_to_where_its_drive_is(table, offset, driven):
    screw = Screw(offset, SPAN, tuple(table))
    assert screw.driven(screw.actual(driven)) == pytest.approx(driven, abs=1e-12)


def test_a_screw_is_linear_between_its_entries_and_constant_beyond():
    screw = Screw(0.01, (0.0, 1.0), (0.0, 2e-3, 1e-3))
    assert [screw.actual(q) - q for q in (-0.5, 0.0, 0.25, 0.5, 0.75, 1.0, 2.0)] == pytest.approx(
        [0.01, 0.01, 0.011, 0.012, 0.0115, 0.011, 0.011])


def test_play_is_taken_up_in_the_direction_of_motion():
    machine = made(backlash=(1e-4, 2e-4, 0.0))
    assert machine.take_up(Carriages(-0.1, 0.1, 0.0), Carriages(0.3, -0.3, 0.3)) == pytest.approx(
        (-0.09995, 0.0999, 0.0))
    assert machine.take_up(Carriages(-0.1, 0.1, 0.0), Carriages(0.0, 0.0, 0.0)) == (-0.1, 0.1, 0.0)


@pytest.mark.parametrize('side', [0, 1])
def test_the_stroke_has_room_for_the_play_of_its_screw(side):
    shift = (-1.0, 1.0)[side] * (0.5 - 5e-5 - abs(mechanism_of(DESIGN).certify(HEAD)[side]))
    pose = HEAD._replace(x=HEAD.x + shift)
    mechanism_of(DESIGN).certify(pose)
    play = [0.0, 0.0, 0.0]
    play[side] = 0.8e-4
    made(backlash=tuple(play)).certify(pose)
    play[side] = 1.2e-4
    with pytest.raises(StrokeLimitError, match=f'q{side + 1} = '):
        made(backlash=tuple(play)).certify(pose)


@pytest.mark.parametrize(('given', 'message'), [
    ({'link_errors': (0.1, 0.0)}, 'above its maximum'),
    ({'carriage_offsets': (0.0, 0.0)}, '2 elements, expected 3'),
    ({'tool': 'ahead'}, 'not a list'),
    ({'screw_span': (0.5, -0.5)}, 'is empty'),
    ({'screw_errors_q2': (0.0, 0.04) * 9}, 'no screw is as bad'),
    ({'rail_angle': math.nan}, 'not a finite number'),
])
def test_an_error_that_no_machine_has_is_named(given, message):
    with pytest.raises(ParameterError, match=message):
        Geometry(**given)
