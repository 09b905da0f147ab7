"""Following within limits of speed and acceleration."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.compensation.limits import Tracker
from facade_manipulator.kinematics import Pose, subtract

SPEED = (0.4, 0.3, 1.0)
ACCELERATION = (2.0, 1.5, 5.0)
PERIOD = 0.01
targets = st.lists(
    st.tuples(*[st.floats(-0.5, 0.5)] * 3).map(lambda values: Pose(*values)),
    min_size=3, max_size=20)


def follow(targets, period=PERIOD):
    tracker = Tracker(SPEED, ACCELERATION)
    return tracker, [tracker.step(k * period, target) for k, target in enumerate(targets)]


@given(targets)
def test_speed_and_acceleration_keep_their_limits_whatever_the_target_does(goals):
    course = [goal for goal in goals for _ in range(10)]
    _, poses = follow(course)
    velocities = np.diff(poses, axis=0) / PERIOD
    assert (abs(velocities) <= np.array(SPEED) + 1e-9).all()
    accelerations = np.diff(velocities, axis=0) / PERIOD
    assert (abs(accelerations) <= np.array(ACCELERATION) + 1e-6).all()


def test_a_target_within_the_limits_is_followed_exactly():
    course = [
        Pose(0.1 * (1.0 - math.cos(t)), 0.25, 0.1 * (1.0 - math.cos(2.0 * t)))
        for t in np.arange(0.0, 10.0, PERIOD)]
    _, poses = follow(course)
    assert np.array(poses) == pytest.approx(np.array(course))
    assert subtract(course[-1], poses[-1]) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


def test_after_a_step_the_target_is_reached_without_overshoot():
    course = [Pose(0.0, 0.0, 0.0)] * 5 + [Pose(0.2, -0.1, 0.3)] * 300
    _, poses = follow(course)
    assert poses[-1] == pytest.approx((0.2, -0.1, 0.3), abs=1e-9)
    assert max(pose.x for pose in poses) < 0.2 + 1e-3
    assert min(pose.y for pose in poses) > -0.1 - 1e-3


def test_after_a_reset_it_begins_at_the_target():
    tracker, _ = follow([Pose(0.0, 0.0, 0.0)] * 3)
    tracker.reset()
    assert tracker.step(1.0, Pose(0.3, 0.1, 0.2)) == Pose(0.3, 0.1, 0.2)
