import dataclasses
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.kinematics.planar import compose, invert, wrap_angle

coordinates = st.floats(-10.0, 10.0)
planar_poses = st.builds(Pose, coordinates, coordinates, st.floats(-math.pi, math.pi))
IDENTITY = Pose(0.0, 0.0, 0.0)


def close(a, b):
    turn = wrap_angle(a.theta - b.theta)
    return math.hypot(a.x - b.x, a.y - b.y) < 1e-12 and abs(turn) < 1e-12


def test_the_default_geometry_is_the_design():
    geometry = Geometry()
    assert (geometry.link_length, geometry.platform_half_length) == (0.352, 0.348)
    assert geometry.stroke == (-0.5, 0.5)
    assert geometry.stroke_length == 1.0


def test_a_geometry_cannot_be_changed():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Geometry().link_length = 1.0


def test_a_gap_of_zero_and_a_stroke_as_a_list_are_allowed():
    geometry = Geometry(stroke=[-1, 1], carriage_gap=0)
    assert geometry.stroke == (-1.0, 1.0)
    assert hash(geometry) == hash(Geometry(stroke=(-1.0, 1.0), carriage_gap=0.0))


@pytest.mark.parametrize(('fields', 'words'), [
    ({'link_length': -0.352}, 'link_length = -0.352 m'),
    ({'link_length': 0.0}, 'link_length = 0 m'),
    ({'link_length': math.nan}, 'link_length = nan'),
    ({'link_length': '0.3 m'}, "link_length = '0.3 m'"),
    ({'platform_half_length': math.inf}, 'platform_half_length = inf'),
    ({'platform_half_length': None}, 'platform_half_length = None'),
    ({'carriage_gap': -0.001}, 'carriage_gap = -0.001 m'),
    ({'carriage_gap': 0.348}, 'not below platform_half_length'),
    ({'carriage_gap': 0.3, 'stroke': (-0.3, 0.3)}, 'no room for three carriages'),
    ({'stroke': (0.5, -0.5)}, 'is empty'),
    ({'stroke': (0.5, 0.5)}, 'is empty'),
    ({'stroke': (-0.5, math.inf)}, 'stroke = inf'),
    ({'stroke': (-0.5, 0.0, 0.5)}, 'not a pair'),
    ({'stroke': 1.0}, 'not a pair'),
    ({'stroke': ('a', 'b')}, 'is not a number'),
])
def test_a_geometry_that_makes_no_sense_is_a_value_error_naming_the_value(fields, words):
    with pytest.raises(ValueError, match=words) as error:
        Geometry(**fields)
    assert isinstance(error.value, ParameterError)


@given(planar_poses)
def test_a_pose_and_its_inverse_compose_to_the_identity(a):
    assert close(compose(a, invert(a)), IDENTITY)
    assert close(compose(invert(a), a), IDENTITY)
    assert close(invert(invert(a)), a)


@given(planar_poses, planar_poses, planar_poses)
def test_composition_is_associative(a, b, c):
    left, right = compose(compose(a, b), c), compose(a, compose(b, c))
    assert math.hypot(left.x - right.x, left.y - right.y) < 1e-11
    assert close(compose(a, IDENTITY), a) and close(compose(IDENTITY, a), a)


def test_composition_turns_the_second_pose_into_the_first_frame():
    assert close(compose(Pose(1.0, 2.0, math.pi / 2), Pose(3.0, 0.0, 0.1)),
                 Pose(1.0, 5.0, math.pi / 2 + 0.1))


@given(st.floats(-100.0, 100.0))
def test_a_wrapped_angle_is_the_same_direction_within_half_a_turn(theta):
    wrapped = wrap_angle(theta)
    assert -math.pi <= wrapped <= math.pi
    assert math.cos(wrapped - theta) == pytest.approx(1.0)
