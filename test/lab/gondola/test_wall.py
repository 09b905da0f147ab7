"""Measuring the head on the wall from the actual carriage positions."""

import math

import pytest

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Carriages, Geometry, inverse_kinematics, Pose
from facade_manipulator.kinematics.planar import compose, invert
from facade_manipulator.lab.gondola.wall import WallMeasurement, WallSettings

GEOMETRY = Geometry()
GOAL = Pose(0.05, 0.25, 0.02)


def sway(time):
    return Pose(0.1 * math.sin(time), 0.01 * math.cos(time), 0.03 * math.sin(2.0 * time))


def measurement():
    wall = WallMeasurement(GEOMETRY, WallSettings(), sway)
    wall.set_goal(0.0, GOAL)
    return wall


def carriages_for(head_on_the_wall, time):
    return inverse_kinematics(GEOMETRY, compose(invert(sway(time)), head_on_the_wall))


def test_a_perfect_compensation_has_no_error():
    wall = measurement()
    for k in range(100):
        sample = wall.measure(0.1 * k, carriages_for(GOAL, 0.1 * k))
        assert sample.error == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
        assert sample.head == pytest.approx(tuple(GOAL), abs=1e-9)


def test_a_tenth_of_the_error_is_twenty_decibels():
    wall = measurement()
    for k in range(30, 200):
        time = 0.1 * k
        full = compose(sway(time), GOAL)
        rest = Pose(*(g + 0.1 * (f - g) for f, g in zip(full, GOAL, strict=True)))
        wall.measure(time, carriages_for(rest, time))
    report = wall.report()
    assert report['samples'] == 170
    for axis in report['axes'].values():
        assert axis['attenuation_db'] == pytest.approx(20.0, abs=1e-6)
        assert axis['residual_rms'] == pytest.approx(0.1 * axis['disturbance_rms'])


def test_samples_count_once_the_goal_has_stood():
    wall = measurement()
    settled = [wall.measure(t, carriages_for(GOAL, t)).settled for t in (0.0, 2.4, 2.5)]
    assert settled == [False, False, True]
    wall.set_goal(3.0, GOAL)
    assert wall.measure(3.1, carriages_for(GOAL, 3.1)).settled
    wall.set_goal(3.2, GOAL._replace(x=0.0))
    assert not wall.measure(3.3, carriages_for(GOAL, 3.3)).settled
    assert wall.count == 2


def test_before_a_goal_there_is_a_head_but_no_error():
    wall = WallMeasurement(GEOMETRY, WallSettings(), sway)
    sample = wall.measure(1.0, carriages_for(GOAL, 1.0))
    assert sample.error is None
    assert sample.head == pytest.approx(tuple(GOAL), abs=1e-9)
    assert wall.report()['axes']['x']['attenuation_db'] is None


def test_carriages_that_do_not_close_the_mechanism_are_rejected():
    with pytest.raises(ManipulatorError):
        measurement().measure(0.0, Carriages(-0.49, 0.49, 0.0))
