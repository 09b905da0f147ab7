"""Tracking of the head on its path, and its lag."""

import math

import numpy as np
import pytest

from facade_manipulator.compensation import following as module
from facade_manipulator.compensation.following import Following
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import add, Pose

PERIOD = 0.01


def course(time):
    y = 0.25 + 0.01 * math.sin(1.3 * time)
    return Pose(0.1 * math.sin(0.7 * time), y, 0.03 * math.sin(time))


def run(duration, head, path=course):
    following = Following()
    following.begin(1000.0)
    for now in np.arange(1000.0, 1000.0 + duration, PERIOD):
        following.publish(now + 0.06, path(now + 0.06))
        following.add_head(now, now, head(now))
    return following, now


@pytest.mark.parametrize(
    ('lag', 'measured'),
    [
        (-0.01, -0.01),
        (0.0, 0.0),
        (0.004, 0.004),
        (0.03, 0.03),
        (0.1, module.Following.GREATEST_LAG),
    ],
)
def test_lag_of_the_head_is_measured_within_a_bound(lag, measured):
    following, now = run(20.0, lambda time: course(time - lag))
    assert following.lag == pytest.approx(measured, abs=5e-4)
    assert not following.is_off_path(now)


@pytest.mark.parametrize('lag', [-0.01, 0.03])
def test_lag_of_a_head_that_starts_has_no_jump(lag):
    following = Following()
    lags = []
    following.begin(1000.0)

    def path(time):
        return Pose(0.01 * max(time - 1001.0, 0.0) ** 2, 0.25, 0.0)

    for now in np.arange(1000.0, 1006.0, PERIOD):
        following.publish(now + 0.06, path(now + 0.06))
        following.add_head(now, now, path(now - lag))
        lags.append(following.lag)
    assert lags[-1] == pytest.approx(lag, rel=0.05)
    assert np.abs(np.diff(lags)).max() < 0.05 * abs(lag)


@pytest.mark.parametrize('duration', [PERIOD, 3.0])
def test_head_at_rest_on_the_path_has_no_lag(duration):
    path = Pose(1e-4, 0.25, 0.0)
    head = Pose(0.0, 0.25, 0.0)
    following, _ = run(duration, lambda time: path, lambda time: head)
    assert following.lag == 0.0


@pytest.mark.parametrize('offset', [Pose(0.05, 0.0, 0.0), Pose(0.0, 0.0, 0.1)])
def test_head_off_its_path_is_detected_after_a_delay(offset):
    for duration, is_off_path in ((0.4, False), (1.0, True)):
        following, now = run(duration, lambda time: add(course(time), offset))
        assert following.is_off_path(now) == is_off_path
    following.begin(now)
    assert not following.is_off_path(now)


def test_unmeasured_head_is_not_off_its_path():
    following, now = run(1.0, course)
    assert following.newest(now + 0.1)[1] == pytest.approx(tuple(course(now)))
    assert following.newest(now + 1.0) is None
    assert not following.is_off_path(now + 1.0)
    with pytest.raises(InputError, match='0.050 s older'):
        following.add_head(now, now - 0.05, course(now))


def test_head_from_the_future_does_not_exclude_later_poses():
    """A pose that was stamped before the clock was set back is ahead of all later poses."""
    following, now = run(1.0, course)
    with pytest.raises(InputError, match='1.000 s from the future'):
        following.add_head(now, now + 1.0, course(now))
    following.add_head(now + PERIOD, now + PERIOD, course(now + PERIOD))
    assert following.newest(now + PERIOD)[0] == now + PERIOD


def test_stale_head_is_rejected():
    following, now = run(1.0, course)
    with pytest.raises(InputError, match='1.000 s old'):
        following.add_head(now + 2.0, now + 1.0, course(now))
