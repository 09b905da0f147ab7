"""Differences that die out."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.compensation.correction import Blend
from facade_manipulator.kinematics import Pose
from facade_manipulator.kinematics.planar import MotionState, ZERO_STATE

LIMITS = (0.5, 0.5, 1.0)
START = 100.0
poses = st.tuples(*[st.floats(-0.2, 0.2)] * 3).map(lambda values: Pose(*values))
courses = st.tuples(poses, poses).map(lambda parts: MotionState(*parts))


@given(courses, st.floats(0.0, 1.0))
def test_a_blend_begins_with_the_whole_difference_and_dies_out(difference, constant):
    blend = Blend(LIMITS)
    blend.begin(START, difference, constant)
    begun, end = blend.at(START), blend.at(START + 30.0)
    assert begun.position == pytest.approx(tuple(difference.position), abs=1e-12)
    assert begun.velocity == pytest.approx(tuple(difference.velocity), abs=1e-9)
    assert (*end.position, *end.velocity) == pytest.approx((0.0,) * 6, abs=1e-5)


@given(courses, st.floats(0.0, 1.0))
def test_a_blend_accelerates_gently(difference, constant):
    blend = Blend(LIMITS)
    blend.begin(START, difference, constant)
    times = np.arange(START, START + 5.0, 0.002)
    velocities = np.array([blend.at(time).velocity for time in times])
    accelerations = abs(np.diff(velocities, axis=0)).max(axis=0) / 0.002
    assert (accelerations <= 2.01 * np.array(LIMITS)).all()


@given(courses, st.floats(0.01, 2.0))
def test_the_velocity_is_the_derivative_of_the_place(difference, elapsed):
    blend = Blend(LIMITS)
    blend.begin(START, difference, 0.1)
    time, step = START + elapsed, 1e-5
    slope = [(b - a) / (2.0 * step) for a, b in zip(
        blend.at(time - step).position, blend.at(time + step).position, strict=True)]
    assert blend.at(time).velocity == pytest.approx(slope, abs=1e-4)


def test_nothing_is_left_of_a_cleared_blend():
    blend = Blend(LIMITS)
    assert blend.at(START) == ZERO_STATE
    blend.begin(START, MotionState(Pose(0.1, 0.0, 0.0), Pose(0.0, 0.0, 0.0)), 0.5)
    blend.clear()
    assert blend.at(START) == ZERO_STATE


@given(courses, courses)
def test_courses_add_and_subtract(a, b):
    back = a.plus(b).minus(b)
    assert back.position == pytest.approx(tuple(a.position), abs=1e-12)
    assert back.velocity == pytest.approx(tuple(a.velocity), abs=1e-12)
