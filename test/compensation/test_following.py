"""The head follows the path with a measured lag."""

import math

import numpy as np
import pytest

from facade_manipulator.compensation.following import (
    Following,
    GREATEST_LAG,
    HeldBack,
    LEAST_ERROR,
    SHOWN_FOR,
)
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Pose, ZERO_POSE

PERIOD = 0.01


def course(time):
    return Pose(0.1 * math.sin(0.7 * time), 0.25 + 0.01 * math.sin(1.3 * time),
                0.03 * math.sin(time))


def run(duration, head):
    following = Following()
    following.begin(1000.0)
    for now in np.arange(1000.0, 1000.0 + duration, PERIOD):
        following.publish(now + 0.06, course(now + 0.06))
        following.add_head(now, head(now))
    return following, now


@pytest.mark.parametrize('lag', [-0.01, 0.0, 0.004, 0.03])
def test_lag_of_the_head_is_measured(lag):
    following, now = run(20.0, lambda time: course(time - lag))
    assert following.lag == pytest.approx(lag, abs=5e-4)
    assert not following.is_off_path(now)


def test_lag_above_the_maximum_is_bounded():
    following, _ = run(20.0, lambda time: course(time - 0.1))
    assert following.lag == GREATEST_LAG


def test_head_at_rest_on_the_path_has_no_lag():
    following = Following()
    for k in range(300):
        following.publish(1000.06 + k * PERIOD, Pose(0.0, 0.25, 0.0))
        following.add_head(1000.0 + k * PERIOD, Pose(1e-4, 0.25, 0.0))
    assert following.lag == 0.0


def test_republished_path_replaces_poses_of_the_same_times(monkeypatch):
    monkeypatch.setattr('facade_manipulator.compensation.following.PATIENCE', 0.1)
    following = Following()
    following.begin(1000.0)
    for time in np.arange(1000.0, 1001.0, PERIOD):
        following.publish(time, Pose(1.0, 0.25, 0.0))
    for time in np.arange(1000.5, 1001.2, PERIOD):
        following.publish(time, Pose(0.0, 0.25, 0.0))
    for stamp in np.arange(1000.505, 1000.9, PERIOD):
        following.add_head(stamp, Pose(0.0, 0.25, 0.0))
        assert not following.is_off_path(stamp)


@pytest.mark.parametrize('offset', [Pose(0.05, 0.0, 0.0), Pose(0.0, 0.0, 0.1)])
def test_head_off_its_path_is_detected_after_a_while(offset):
    def elsewhere(time):
        return Pose(*(a + b for a, b in zip(course(time), offset, strict=True)))

    following, now = run(0.4, elsewhere)
    assert not following.is_off_path(now)
    following, now = run(1.0, elsewhere)
    assert following.is_off_path(now)
    following.begin(now)
    assert not following.is_off_path(now)


def test_unmeasured_head_is_not_off_its_path():
    following, now = run(1.0, course)
    assert following.newest(now + 0.1)[1] == pytest.approx(tuple(course(now)))
    assert following.newest(now + 1.0) is None
    assert not following.is_off_path(now + 1.0)


def test_head_pose_out_of_order_is_rejected():
    following, now = run(0.1, course)
    with pytest.raises(InputError, match='older'):
        following.add_head(now - 0.05, course(now))


def test_single_pose_of_the_head_gives_no_lag():
    following = Following()
    for k in range(10):
        following.publish(k * PERIOD, Pose(k * PERIOD, 0.25, 0.0))
    following.add_head(0.045, Pose(0.03, 0.25, 0.0))
    assert following.lag == 0.0


def test_held_axes_are_reported_for_one_second():
    held = HeldBack()
    assert held.message(0.0) == ''
    held.note(10.0, Pose(-2.0 * LEAST_ERROR, 0.9 * LEAST_ERROR, 0.01), Pose(0.0, 1.0, 0.0))
    assert held.message(10.0 + 0.9 * SHOWN_FOR) == (
        'held back in x, theta at the workspace limit; held back in y by too uncertain an '
        'estimate')
    held.note(11.0, ZERO_POSE, Pose(0.0, 0.0, 0.1))
    assert held.message(10.1 + SHOWN_FOR) == 'held back in theta by too uncertain an estimate'


def test_clock_set_back_clears_the_held_axes():
    held = HeldBack()
    held.note(1000.0, Pose(0.01, 0.0, 0.0), ZERO_POSE)
    assert held.message(10.0) == held.message(1000.0) == ''
