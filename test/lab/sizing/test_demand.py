"""What the carriages must do: exact kinematics, statics by virtual work, energy, scaling laws."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
from mechanism import DESIGN
import numpy as np
import pytest

from facade_manipulator import kinematics
from facade_manipulator.kinematics import GRAVITY, Pose, Wrench, ZERO_POSE
from facade_manipulator.lab.gondola import load_scenario, MissionSettings, Sway
from facade_manipulator.lab.gondola.motion import SwaySettings
from facade_manipulator.lab.sizing.demand import (
    demand,
    head_forces,
    Payload,
    ROOM,
    STEP,
    Task,
    task,
    tasks,
)

MECHANISM = kinematics.mechanism_of(DESIGN)
STANDING = MissionSettings(duration=10.0, goals=(0.0, 0.25, 0.0))
STROKES = MissionSettings(duration=10.0)
NOTHING = Payload(head_mass=0.0, head_inertia=0.0, carriage_mass=0.0, friction=0.0)


def sway(frequency=0.2, amplitude=0.05):
    return Sway(SwaySettings(**{
        f'{axis}_{part}': (value,) for axis, size, phase in (
            ('x', amplitude, 0.3), ('y', 0.3 * amplitude, 1.0), ('yaw', 0.5 * amplitude, 2.0))
        for part, value in (('amplitude', size), ('frequency', frequency), ('phase', phase))}))


def at_rest(_):
    return ZERO_POSE


def test_carriages_are_where_the_exact_kinematics_puts_them():
    motion = sway().at
    of = task(motion, STROKES)
    found = demand(DESIGN, of, Payload())
    for row in range(0, len(of.head), 111):
        pose = kinematics.relative(motion(STEP * row), Pose(*of.head[row]))
        assert found.pose[row] == pytest.approx(pose, abs=1e-12)
        assert found.position[row] == pytest.approx(
            tuple(MECHANISM.inverse_kinematics(pose)), abs=1e-12)


def test_the_stroke_is_enough_whenever_a_goal_comes():
    of = task(sway().at, STROKES)
    low, high = demand(DESIGN, of, Payload()).stroke
    later = [demand(DESIGN, Task(of.rail, np.roll(of.head, 100 * seconds, axis=0)), Payload())
             for seconds in range(10)]
    assert min(one.position.min() for one in later) - ROOM >= low
    assert max(one.position.max() for one in later) + ROOM <= high
    assert high - low < 1.1 * np.ptp([one.position for one in later]) + 2.0 * ROOM
    still = demand(DESIGN, task(at_rest, STROKES), Payload())
    assert still.stroke[0] <= still.position.min() - ROOM


@given(st.floats(0.1, 0.29), st.floats(-0.15, 0.15), st.floats(-50.0, 50.0),
       st.floats(-50.0, 50.0), st.floats(-5.0, 5.0))
def test_forces_are_those_of_the_statics_by_virtual_work(y, theta, fx, fy, mz):
    pose, wrench = Pose(0.02, y, theta), Wrench(fx, fy, mz)
    at = kinematics.link_arrays(DESIGN, np.array([y]), np.array([theta]))
    found, = head_forces(DESIGN, at, np.array([wrench]))
    expected = kinematics.carriage_forces(MECHANISM, pose, wrench)
    assert found == pytest.approx(tuple(expected), abs=1e-9)
    assert MECHANISM.jacobian(pose).T @ found == pytest.approx(tuple(wrench), abs=1e-9)


def test_from_rest_to_rest_the_power_is_the_work_on_the_wall():
    mission = MissionSettings(
        duration=8.0, goal_period=4.0, goals=(0.0, 0.2, 0.0, 0.1, 0.26, 0.05))
    of = task(at_rest, mission)._replace(wrench=np.array((0.0, 30.0, 0.0)))
    payload = Payload(friction=0.0)
    found = demand(DESIGN, of, payload)
    assert np.abs(found.power).max() > 1.0
    assert found.power.sum() * STEP == pytest.approx(30.0 * 0.06, rel=2e-3)
    with_friction = demand(DESIGN, of, replace(payload, friction=10.0))
    way = np.abs(np.diff(found.position, axis=0)).sum()
    assert (with_friction.power - found.power).sum() * STEP == pytest.approx(10.0 * way, rel=5e-3)


def test_a_force_pushes_the_brush_in_and_the_gondola_back():
    scenario = load_scenario('pressing')
    gondola, mission = scenario.gondola, replace(scenario.mission, goals=(0.1, 0.22, 0.0))
    scenario = scenario._replace(
        mission=mission, sway=replace(scenario.sway, x_amplitude=(0.0, 0.0)))
    free, pressed = tasks(scenario, Payload())
    assert free.head[-1] == pytest.approx((0.1, 0.19, 0.0))
    assert pressed.head[-1] == pytest.approx((0.1, 0.19 + 30.0 / 600.0, 0.0), rel=1e-3)
    assert pressed.wrench == pytest.approx(np.tile((0.0, 30.0, 0.0), (len(free.head), 1)))
    back = 30.0 / gondola.stiffness[1] + 30.0 * gondola.rail_height ** 2 / (
        gondola.mass * GRAVITY * gondola.body_height)
    added = pressed.rail - free.rail
    assert added[:, :2] == pytest.approx(np.tile((0.0, -back), (len(added), 1)))
    assert added[:, 2] == pytest.approx(-30.0 * 0.1 / gondola.stiffness[2])


def test_strokes_under_force_swing_the_gondola_by_their_friction():
    scenario = load_scenario('pressing')
    free, pressed = tasks(scenario, Payload(wall_force=40.0))
    assert pressed.wrench[:, 1] == pytest.approx(40.0)
    friction = scenario.facade.friction * 40.0
    assert np.abs(pressed.wrench[:, 0]).max() == pytest.approx(friction, rel=1e-3)
    swing = np.abs(pressed.rail - free.rail)[:, 0].max()
    assert 1.0 < swing * scenario.gondola.stiffness[0] / friction < 4.0


def test_a_head_that_stands_on_the_wall_costs_no_force_however_the_rail_moves():
    of = task(sway().at, STANDING)
    light, heavy = (demand(DESIGN, of, Payload(head_mass=mass)) for mass in (0.0, 50.0))
    assert np.abs(heavy.force - light.force).max() < 1e-9


def test_the_middle_carriage_stands_still_under_a_head_that_stands_still():
    """Its mass costs nothing: what it moves along the rail is what the rail moves back."""
    still = Sway(SwaySettings(y_amplitude=(), y_frequency=(), y_phase=(), yaw_amplitude=(),
                              yaw_frequency=(), yaw_phase=())).at
    found = demand(DESIGN, task(still, STANDING), replace(NOTHING, carriage_mass=10.0))
    assert np.abs(found.acceleration[:, 2]).max() > 0.05
    assert np.abs(found.force[5:-5]).max() < 1e-3


def test_twice_as_fast_is_twice_the_speed_and_four_times_the_acceleration():
    slow, fast = (demand(DESIGN, task(sway(frequency, 0.01).at, STANDING), NOTHING)
                  for frequency in (0.2, 0.4))
    for name, factor in (('speed', 2.0), ('acceleration', 4.0)):
        ratio = np.abs(getattr(fast, name)).max(axis=0) / np.abs(getattr(slow, name)).max(axis=0)
        assert ratio == pytest.approx(factor, rel=0.01)


def test_a_rail_that_stands_farther_away_has_the_head_farther_out():
    of = task(sway().at, STANDING)
    near, far = (demand(DESIGN, of, NOTHING, offset) for offset in (0.0, 0.02))
    moved = Task(of.rail, of.head + (0.0, 0.02, 0.0))
    assert far.position == pytest.approx(demand(DESIGN, moved, NOTHING).position)
    assert not np.allclose(far.position, near.position)


@pytest.mark.parametrize(('why', 'goals', 'amplitude'), [
    ('reach', (0.0, 0.34, 0.0), 0.01), ('carriage gap', (0.0, 0.05, 0.0), 0.01),
    ('yaw', (0.0, 0.25, 0.0), 1.0)])
def test_what_the_mechanism_cannot_do_has_no_demand(why, goals, amplitude):
    mission = replace(STANDING, goals=goals)
    assert demand(DESIGN, task(sway(0.2, amplitude).at, mission), NOTHING) is None, why
