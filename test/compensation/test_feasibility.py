"""What a press does in the end is known beforehand."""

from dataclasses import asdict, replace
import math

import numpy as np
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
from facade_manipulator.lab.gondola.gondola import GondolaSettings, modes
from facade_manipulator.lab.gondola.reaction import ModalReaction

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


@pytest.mark.parametrize('suspension', [GUIDED, replace(FREE, cable_length=30.0)])
def test_it_is_what_the_simulated_gondola_does(suspension):
    reaction = ModalReaction(GondolaSettings(
        mass=500.0, cable_length=suspension.cable_length, rail_height=0.0, damping_ratio=0.5,
        guide_stiffness=suspension.guide_stiffness, guide_lever=suspension.guide_lever))
    move = reaction.stepper(0.1)
    for _ in range(3000):
        move((0.0, -30.0, -3.0))
    assert reaction.pose.y == pytest.approx(-suspension.push_back(30.0), rel=1e-3)
    assert reaction.pose.theta == pytest.approx(-suspension.yaw(30.0, 0.1), rel=1e-3)


def test_the_compensator_knows_it_as_soon_as_it_has_the_goal():
    compensator = Compensator(Geometry(), DEFAULTS._replace(impedance=PRESS, suspension=FREE))
    assert compensator.obstacle == ''
    compensator.set_goal(MIDDLE)
    assert 'push the gondola back' in compensator.obstacle
    compensator.change('suspension', GUIDED)
    assert compensator.obstacle == ''
    assert math.isclose(GUIDED.push_back(30.0), 30.0 / (500.0 * 9.81 / 20.0 + 600.0))


def test_the_periods_are_those_of_the_simulated_modes():
    simulated = modes(GondolaSettings(
        **{**asdict(GUIDED), 'mass': 500.0}, body_height=0.05, gyration_radius=0.05))
    periods = math.tau / simulated.frequencies[[0, 2, 4]]
    assert GUIDED.periods == pytest.approx(tuple(periods), rel=0.01)


@pytest.mark.parametrize('period', [4.0, 7.0, 9.0, 12.0, 14.0])
def test_strokes_swing_the_simulated_gondola_about_as_far_as_is_said(period):
    reaction = ModalReaction(GondolaSettings(**{**asdict(GUIDED), 'mass': 500.0}))
    step, force, most = period / 400.0, 30.0, 0.0
    move = reaction.stepper(step)
    for k in range(400 * 40):
        side = math.copysign(1.0, math.sin(math.tau * k / 400.0))
        move((0.3 * force * side, 0.0, force * 0.1 * side))
        if k > 400 * 30:
            most = np.maximum(most, np.abs(reaction.pose))
    said = GUIDED.swing(force, 0.1, period)
    assert 0.3 * said[0] < most[0] < 1.3 * said[0]  # its body tilts, too
    assert most[2] < 1.1 * said[1]


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
