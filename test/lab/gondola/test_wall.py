"""Measuring the head on the wall from where it is on the rail."""

import math

import pytest

from facade_manipulator.kinematics import compose, Pose, relative
from facade_manipulator.lab.gondola.wall import WallMeasurement, WallSettings

GOAL = Pose(0.05, 0.25, 0.02)


def sway(time):
    return Pose(0.1 * math.sin(time), 0.01 * math.cos(time), 0.03 * math.sin(2.0 * time))


def measurement():
    wall = WallMeasurement(WallSettings(), sway)
    wall.set_goal(0.0, GOAL)
    return wall


def test_a_perfect_compensation_has_no_error():
    wall = measurement()
    for k in range(100):
        sample = wall.measure(0.1 * k, relative(sway(0.1 * k), GOAL))
        assert sample.error == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
        assert sample.head == pytest.approx(tuple(GOAL), abs=1e-9)


def test_a_tenth_of_the_error_is_twenty_decibels():
    wall = measurement()
    for k in range(30, 200):
        time = 0.1 * k
        full = compose(sway(time), GOAL)
        rest = Pose(*(g + 0.1 * (f - g) for f, g in zip(full, GOAL, strict=True)))
        wall.measure(time, relative(sway(time), rest))
    report = wall.report()
    assert report['samples'] == 170
    for axis in report['axes'].values():
        assert axis['attenuation_db'] == pytest.approx(20.0, abs=1e-6)
        assert axis['residual_rms'] == pytest.approx(0.1 * axis['disturbance_rms'])


def test_samples_count_once_the_goal_has_stood():
    wall = measurement()
    settled = [wall.measure(t, relative(sway(t), GOAL)).settled for t in (0.0, 2.4, 2.5)]
    assert settled == [False, False, True]
    wall.set_goal(3.0, GOAL)
    assert wall.measure(3.1, relative(sway(3.1), GOAL)).settled
    wall.set_goal(3.2, GOAL._replace(x=0.0))
    assert not wall.measure(3.3, relative(sway(3.3), GOAL)).settled
    assert wall.count == 2


def test_before_a_goal_there_is_a_head_but_no_error():
    wall = WallMeasurement(WallSettings(), sway)
    sample = wall.measure(1.0, relative(sway(1.0), GOAL))
    assert sample.error is None
    assert sample.head == pytest.approx(tuple(GOAL), abs=1e-9)
    assert wall.report()['axes']['x']['attenuation_db'] is None
