"""Planar poses form a group at all angles."""

import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.kinematics import MotionState, Pose, Twist
from facade_manipulator.kinematics.planar import (
    add,
    compose,
    difference,
    invert,
    millimetres,
    relative,
    subtract,
    wrap_angle,
    ZERO_POSE,
)

coordinates = st.floats(-10.0, 10.0)
angles = st.floats(-20.0, 20.0)
poses = st.builds(Pose, coordinates, coordinates, angles)


def same(pose):
    return pytest.approx(tuple(pose), abs=1e-12)


@given(poses, poses, poses)
def test_planar_poses_form_a_group(a, b, c):
    assert compose(a, invert(a)) == same(ZERO_POSE) == compose(invert(a), a)
    associated = compose(a, compose(b, c))
    assert compose(compose(a, b), c) == same(associated)
    assert compose(a, relative(a, b)) == same(b)
    assert relative(a, b) == same(compose(invert(a), b))


@given(poses, poses, poses, poses)
def test_motion_states_add_and_subtract(a, v, b, w):
    one = MotionState(a, Twist(*v))
    other = MotionState(b, Twist(*w))
    assert one.plus(other).velocity == same(add(v, w))
    assert one.plus(other).position == same(add(a, b))
    change = one.minus(other)
    assert change.position == same(subtract(a, b))
    assert change.velocity == same(subtract(v, w))
    assert add(b, subtract(a, b)) == same(a)  # without wrapping


@given(angles)
def test_wrapped_angle_is_the_same_direction(theta):
    wrapped = wrap_angle(theta)
    assert abs(wrapped) <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(theta), abs=1e-12)
    assert math.sin(wrapped) == pytest.approx(math.sin(theta), abs=1e-12)


@given(poses, poses)
def test_pose_difference_takes_the_shorter_turn(a, b):
    change = difference(a, b)
    assert b.x + change.x == pytest.approx(a.x, abs=1e-12)
    assert b.y + change.y == pytest.approx(a.y, abs=1e-12)
    assert abs(change.theta) <= math.pi
    turned = math.cos(b.theta + change.theta)
    assert turned == pytest.approx(math.cos(a.theta), abs=1e-12)


def test_pose_as_text_has_no_negative_zero():
    assert millimetres(Pose(-1e-9, -4e-5, -1e-6)) == (
        'x +0.0 mm, y +0.0 mm, theta +0.00 deg'
    )
