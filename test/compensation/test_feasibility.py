"""What a press does in the end is known beforehand."""

from dataclasses import replace
import math

import pytest

from facade_manipulator.compensation.compensator import Compensator, DEFAULTS
from facade_manipulator.compensation.impedance import ImpedanceSettings
from facade_manipulator.compensation.suspension import (
    obstacle,
    stroke_obstacle,
    Strokes,
    StrokeWatch,
    SuspensionSettings,
)
from facade_manipulator.kinematics import Geometry, Pose

PRESS = ImpedanceSettings(enabled=True, force=30.0)
FREE = SuspensionSettings(mass=500.0, cable_length=100.0)
GUIDED = SuspensionSettings(
    mass=500.0, cable_length=20.0, guide_stiffness=600.0, guide_lever=0.6)
SIDE, MIDDLE = Pose(0.2, 0.25, 0.0), Pose(0.0, 0.25, 0.0)


def test_a_press_beside_the_middle_of_a_free_gondola_is_said_to_turn_it():
    assert obstacle(FREE, PRESS, Geometry(), SIDE) == (
        '30 N at 0.2 m on 100 m of free cable turns the gondola by 19 deg, bound 5 deg')


def test_a_press_in_the_middle_is_said_to_push_it_out_of_reach():
    assert obstacle(FREE, PRESS, Geometry(), MIDDLE) == (
        '30 N on 100 m of free cable push the gondola back by 612 mm: the goal is then 0.862 m '
        'away, reach 0.352 m')


@pytest.mark.parametrize(('suspension', 'press'), [
    (GUIDED, PRESS), (FREE, replace(PRESS, force=2.0)), (FREE, replace(PRESS, enabled=False)),
    (replace(FREE, mass=0.0), PRESS)])
def test_what_can_be_had_or_is_not_known_is_no_obstacle(suspension, press):
    assert obstacle(suspension, press, Geometry(), MIDDLE._replace(x=0.1)) == ''


def test_the_compensator_knows_it_as_soon_as_it_has_the_goal():
    compensator = Compensator(Geometry(), DEFAULTS._replace(impedance=PRESS, suspension=FREE))
    assert compensator.obstacle == ''
    compensator.set_goal(MIDDLE)
    assert 'push the gondola back' in compensator.obstacle
    compensator.change('suspension', GUIDED)
    assert compensator.obstacle == ''
    assert math.isclose(GUIDED.push_back(30.0), 30.0 / (500.0 * 9.81 / 20.0 + 600.0))


def test_strokes_in_resonance_are_named_with_periods_that_are_not():
    text = stroke_obstacle(GUIDED, PRESS, Strokes(0.1, 9.0))
    assert text.startswith('strokes of +-0.1 m, 9.0 s to and fro, may swing the gondola by 1')
    assert text.endswith('its periods are 9.0 s along the wall and 5.6 s in yaw; '
                         '10.5 s to and fro would not')
    assert stroke_obstacle(GUIDED, PRESS, Strokes(0.1, 10.5)) == ''
    hard = replace(PRESS, force=1000.0, most_sway=0.01)
    assert stroke_obstacle(GUIDED, hard, Strokes(0.1, 9.0)).endswith('press with less force')
    assert stroke_obstacle(replace(GUIDED, mass=0.0), PRESS, Strokes(0.1, 9.0)) == ''


@pytest.mark.parametrize(('goals', 'strokes'), [
    (((0.0, -0.1), (4.5, 0.1), (9.0, -0.1)), Strokes(0.1, 9.0)),
    (((0.0, -0.1), (4.5, 0.1)), None),
    (((0.0, -0.1), (4.5, 0.1), (9.0, -0.081)), Strokes(0.1, 9.0)),
    (((0.0, -0.1), (4.5, 0.1), (9.0, -0.079)), None),
    (((0.0, -0.1), (4.5, 0.1), (9.0, 0.3)), None),
    (((1.0, -0.1), (5.3, 0.1), (10.5, -0.1)), Strokes(0.1, 9.5)),
    (((1.0, -0.1), (5.2, 0.1), (10.5, -0.1)), None),
    (((1.0, -0.1), (6.3, 0.1), (10.5, -0.1)), None),
    (((0.0, 0.0), (4.5, 0.021), (9.0, 0.0)), Strokes(0.0105, 9.0)),
    (((0.0, 0.0), (4.5, 0.019), (9.0, 0.0)), None)])
def test_strokes_are_what_goes_to_and_fro_regularly(goals, strokes):
    watch = StrokeWatch()
    for time, x in goals:
        watch.note(time, MIDDLE._replace(x=x))
    assert watch.strokes == strokes


def test_the_compensator_recognises_strokes():
    compensator = Compensator(Geometry(), DEFAULTS._replace(impedance=PRESS, suspension=GUIDED))
    for stroke in range(3):
        compensator.set_goal(Pose(0.1 if stroke % 2 else -0.1, 0.22, 0.0))
        for k in range(45):
            compensator.update(1000.0 + 4.5 * stroke + 0.1 * k)
    assert 'strokes of +-0.1 m, 9.0 s to and fro' in compensator.obstacle
