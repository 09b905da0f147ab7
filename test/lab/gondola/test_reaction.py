"""The gondola and the head on the wall: conservation laws and what textbooks say."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator import kinematics
from facade_manipulator.kinematics import Geometry, GRAVITY, Pose, Twist, Wrench, ZERO_POSE
from facade_manipulator.lab.gondola.facade import Facade, FacadeSettings, NO_CONTACT
from facade_manipulator.lab.gondola.gondola import GondolaSettings
from facade_manipulator.lab.gondola.reaction import carriage_loads, ModalReaction, PressedGondola

SETTINGS = GondolaSettings()
MACHINE = kinematics.mechanism_of(Geometry())
FREE = replace(SETTINGS, guide_stiffness=0.0)
PENDULUM = replace(  # a point on a cable
    FREE, body_height=0.05, gyration_radius=0.05, rail_height=0.0, cable_length=20.0)
HEIGHT = 0.25


def swing(settings, force, duration, step=0.01):
    """Return times and poses of a gondola under a wrench on its rail, a function of time."""
    reaction = ModalReaction(settings)
    move, times, poses = reaction.stepper(step), np.arange(0.0, duration, step), []
    for time in times:
        move(force(time + 0.5 * step))
        poses.append(reaction.pose)
    return times + step, np.array(poses)


def steady_amplitude(settings, force, period, axis=0, count=40):
    """Return the complex amplitude of the fundamental once everything else has died out."""
    step = period / 200.0
    times, poses = swing(settings, force, count * period, step)
    last = times > (count - 5) * period
    wave = np.exp(-2j * math.pi * times[last] / period)
    return 2.0 * np.mean(poses[last, axis] * wave)


@pytest.mark.parametrize(('axis', 'inertia'), [
    (0, SETTINGS.mass), (1, SETTINGS.mass), (2, SETTINGS.mass * SETTINGS.yaw_radius ** 2)])
def test_a_push_at_the_centre_of_gravity_gives_its_momentum_to_the_mass(axis, inertia):
    reaction = ModalReaction(replace(SETTINGS, damping_ratio=0.0))
    wrench = Wrench(*(100.0 * (axis == i) for i in range(3)))
    move = reaction.stepper(0.001)
    for _ in range(10):
        move(wrench)
    assert inertia * reaction.velocity[axis] == pytest.approx(100.0 * 0.01, rel=1e-3)


def test_the_work_of_the_head_is_the_energy_of_an_undamped_gondola():
    reaction = ModalReaction(replace(SETTINGS, damping_ratio=0.0))
    move, work, wrench = reaction.stepper(0.01), 0.0, Wrench(20.0, -30.0, 5.0)
    for _ in range(1000):
        before = reaction.pose
        move(wrench)
        work += np.dot(wrench, np.subtract(reaction.pose, before))
    assert reaction.energy == pytest.approx(work, rel=1e-9)


def test_without_the_head_energy_stays_or_decays_as_the_damping_says():
    for damping in (0.0, 0.02):
        reaction = ModalReaction(replace(PENDULUM, damping_ratio=damping, rail_height=0.05))
        reaction.stepper(0.01)(Wrench(1000.0, 0.0, 0.0))
        begin, elapsed = reaction.energy, 60.0
        for _ in range(600):
            reaction.stepper(elapsed / 600)(NO_CONTACT)
        frequency = math.sqrt(GRAVITY / (PENDULUM.cable_length + PENDULUM.body_height))
        expected = math.exp(-2.0 * damping * frequency * elapsed)
        assert reaction.energy / begin == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize('settings', [SETTINGS, FREE, replace(SETTINGS, cable_length=100.0)])
def test_a_steady_press_pushes_it_back_by_force_over_stiffness_and_tilts_it(settings):
    _, poses = swing(replace(settings, damping_ratio=0.5), lambda _: (0.0, -30.0, 0.0), 200.0)
    weight = settings.mass * GRAVITY
    tilt = settings.rail_height ** 2 / (weight * settings.body_height)
    hang = 1.0 / (weight / settings.cable_length + settings.guide_stiffness)
    assert poses[-1, 1] == pytest.approx(-30.0 * (hang + tilt), rel=1e-3)


def test_a_rail_before_the_cables_makes_a_moment_of_friction_and_moves_when_it_yaws():
    settings = replace(SETTINGS, rail_offset=0.4, damping_ratio=0.5)
    _, poses = swing(settings, lambda _: (10.0, 0.0, 0.0), 200.0)
    yaw = -4.0 / settings.stiffness[2]
    _, central = swing(replace(settings, rail_offset=0.0), lambda _: (10.0, 0.0, 0.0), 200.0)
    assert poses[-1, 2] == pytest.approx(yaw, rel=1e-3)
    assert poses[-1, 0] - central[-1, 0] == pytest.approx(-0.4 * yaw, rel=1e-3)


def test_at_resonance_a_pendulum_swings_as_far_as_its_damping_lets_it():
    frequency = ModalReaction(PENDULUM)._modes.frequencies[0]
    amplitude = steady_amplitude(
        PENDULUM, lambda t: (9.0 * math.sin(frequency * t), 0.0, 0.0), math.tau / frequency)
    stiffness = PENDULUM.mass * GRAVITY / PENDULUM.cable_length
    assert abs(amplitude) == pytest.approx(
        9.0 / (2.0 * PENDULUM.damping_ratio * stiffness), rel=0.02)


@pytest.mark.parametrize('period', [4.0, 6.0, 12.0])
def test_strokes_swing_it_by_the_odd_harmonics_of_their_friction(period):
    friction, rate = 9.0, math.tau / period
    amplitude = steady_amplitude(
        PENDULUM, lambda t: (math.copysign(friction, math.sin(rate * t)), 0.0, 0.0), period)
    stiffness = PENDULUM.mass * GRAVITY / PENDULUM.cable_length
    ratio = rate / math.sqrt(GRAVITY / (PENDULUM.cable_length + PENDULUM.body_height))
    expected = 4.0 * friction / math.pi / stiffness / abs(
        1.0 - ratio ** 2 + 2j * PENDULUM.damping_ratio * ratio)
    assert abs(amplitude) == pytest.approx(expected, rel=0.02)


def pressed(facade, settings=SETTINGS):
    return PressedGondola(
        lambda _: ZERO_POSE, Facade(replace(facade, present=True, distance=0.23)), settings)


@pytest.mark.long
@pytest.mark.parametrize('stiffness', [300.0, 5e3, 1e5])
def test_a_locked_head_presses_it_away_until_force_and_suspension_are_equal(stiffness):
    settings = replace(SETTINGS, damping_ratio=0.3, rail_height=0.0)
    gondola = pressed(FacadeSettings(stiffness=stiffness, damping=100.0), settings)
    for k in range(3000):
        wrench = gondola.advance(0.01 * k, Pose(0.0, HEIGHT, 0.0))
    hang = settings.mass * GRAVITY / settings.cable_length + settings.guide_stiffness
    together = 1.0 / (1.0 / hang + 1.0 / stiffness)
    assert -wrench.fy == pytest.approx(together * (HEIGHT - 0.23), rel=0.01)
    assert hang * -gondola.at(29.99).y == pytest.approx(-wrench.fy, rel=0.01)


@pytest.mark.long
def test_a_stiff_contact_adds_no_energy():
    """A gondola held between wall and cables swings on as long as without the steps of time."""
    settings = replace(FREE, damping_ratio=0.0, rail_height=0.0, body_height=0.05,
                       gyration_radius=0.05)
    gondola = pressed(FacadeSettings(stiffness=2e4, damping=0.0, friction=0.0), settings)
    forces = np.array([
        -gondola.advance(0.01 * k, Pose(0.0, HEIGHT - 0.015, 0.0)).fy for k in range(3000)])
    assert forces[2000:].max() == pytest.approx(forces[:1000].max(), rel=0.02)


def test_wall_and_brush_give_way_one_after_the_other():
    brush = FacadeSettings(present=True, stiffness=600.0, wall_stiffness=300.0)
    head = Pose(0.0, brush.distance + 0.03, 0.0)
    still = Facade(brush).contact(head, Twist(0.0, 0.0, 0.0))
    moving = Facade(brush).contact(head, Twist(0.0, 0.01, 0.0))
    assert -still.fy == pytest.approx(200.0 * 0.03)
    assert still.fy - moving.fy == pytest.approx(brush.damping / 9.0 * 0.01)


def test_friction_pulls_the_gondola_along_with_the_head():
    gondola = pressed(FacadeSettings())
    for k in range(100):
        gondola.advance(0.01 * k, Pose(0.1 * 0.01 * k, HEIGHT, 0.0))
    assert gondola.wrench.fx < 0.0
    assert gondola.reaction.velocity.x < 0.0


def test_without_the_reaction_the_gondola_stays_and_the_head_feels_the_wall():
    gondola = pressed(FacadeSettings(), replace(SETTINGS, reaction=False))
    for k in range(100):
        gondola.advance(0.01 * k, Pose(0.0, HEIGHT, 0.0))
    assert gondola.wrench.fy == pytest.approx(-600.0 * 0.02, rel=1e-3)
    assert gondola.at(1.0) == ZERO_POSE


@given(st.floats(-0.2, 0.2), st.floats(0.15, 0.3), st.floats(-0.1, 0.1),
       st.tuples(*[st.floats(-50.0, 50.0)] * 3), st.tuples(*[st.floats(-1.0, 1.0)] * 3))
def test_the_wall_gives_the_carriages_the_power_that_it_gives_the_head(x, y, theta, wrench, rates):
    head, wrench = Pose(x, y, theta), Wrench(*wrench)
    loads = carriage_loads(MACHINE, head, wrench)
    c, s = math.cos(theta), math.sin(theta)
    power = (c * wrench.fx - s * wrench.fy) * rates[0] + (
        s * wrench.fx + c * wrench.fy) * rates[1] + wrench.mz * rates[2]
    assert np.dot(loads, MACHINE.carriage_velocity(head, Twist(*rates))) == pytest.approx(
        power, abs=1e-6)


def test_the_past_is_kept_and_a_time_that_is_not_later_changes_nothing():
    gondola = pressed(FacadeSettings())
    poses = {}
    for k in range(200):
        gondola.advance(0.01 * k, Pose(0.0, HEIGHT, 0.0))
        poses[k] = gondola.at(0.01 * k)
    wrench = gondola.wrench
    assert gondola.advance(0.5, Pose(0.0, 0.3, 0.0)) == wrench
    for k in (20, 100, 199):
        assert gondola.at(0.01 * k) == pytest.approx(tuple(poses[k]), abs=1e-12)


def test_after_a_gap_nobody_knows_where_the_head_was_and_the_gondola_swings_freely():
    gondola = pressed(FacadeSettings())
    for k in range(100):
        gondola.advance(0.01 * k, Pose(0.0, HEIGHT, 0.0))
    before = gondola.reaction.energy
    assert gondola.advance(20.0, Pose(0.0, HEIGHT, 0.0)) == NO_CONTACT
    assert 0.0 < gondola.reaction.energy < before
