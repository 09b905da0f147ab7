"""Control of the package, which holds the head on the wall of the simulated world."""

from dataclasses import replace
import math

from closed_loop import ClosedLoop, DRIVE_LAG
import numpy as np
import pytest

from facade_manipulator.compensation.contact_phases import PressMode
from facade_manipulator.kinematics import Pose
from facade_manipulator.simulation.world.scenario import load_scenario, Motion

pytestmark = pytest.mark.long

GOAL = Pose(0.0, 0.25, 0.0)


def attenuation(cycles):
    """Return the attenuation of x, y and θ [dB]."""
    errors = np.array([one.error for one in cycles])
    without = np.array([one.uncompensated for one in cycles])
    power = (errors**2).mean(axis=0)
    power_without = (without**2).mean(axis=0)
    return 10.0 * np.log10(power_without / power)


@pytest.mark.parametrize(
    ('name', 'drive_lag', 'least'),
    [
        ('gusts', DRIVE_LAG, (30.0, 16.0, 20.0)),
        ('breeze', DRIVE_LAG, (45.0, 30.0, 30.0)),
        ('breeze', 0.03, (30.0, 16.0, 20.0)),
    ],
)
def test_sway_is_attenuated_by_the_required_decibels(name, drive_lag, least):
    loop = ClosedLoop(load_scenario(name), drive_lag=drive_lag)
    cycles = loop.follow(GOAL, 15.0)
    assert (attenuation(cycles[900:]) > least).all()
    assert loop.follower.brakes == 0
    assert loop.rejections == []


def path_on_the_wall(wrong_every, size):
    """Return the head's path [m, m, rad] with bursts of wrong estimates."""
    scenario = load_scenario('burst')
    estimator = replace(
        scenario.estimator, wrong_every=wrong_every, wrong_offset=(size, size, size)
    )
    loop = ClosedLoop(replace(scenario, estimator=estimator))
    return np.array([one.head for one in loop.follow(GOAL, 12.0)])


def test_bursts_of_wrong_estimates_do_not_move_the_head():
    undisturbed = path_on_the_wall(math.inf, 0.0)  # two workers would each compute it
    for size in (-0.012, 0.2):
        moved = path_on_the_wall(5.0, size) - undisturbed
        assert np.abs(moved).max() < 0.002, f'bursts of {size} m and rad'


def test_strong_shake_along_x_leaves_y_and_yaw():
    """Full compensation of 20 mm at 2 Hz exceeds the carriages: y errs by 11 mm RMS."""
    shake = Motion(x=((0.02, 2.0, 0.0),))
    loop = ClosedLoop(replace(load_scenario('three_tones'), motion=shake))
    cycles = loop.follow(GOAL, 14.0)
    errors = np.array([one.error for one in cycles[700:]])
    assert (abs(errors[:, 1:]) < (1e-3, 2e-3)).all()


def pressed(stiffness, duration):
    """Return the loop and the force on the wall of each cycle [N]."""
    scenario = load_scenario('pressing')
    compensator = dict(scenario.compensator)
    compensator['contact.stiffness'] = min(stiffness, 5000.0)
    wall = replace(scenario.wall, brush_stiffness=stiffness)
    loop = ClosedLoop(replace(scenario, wall=wall, compensator=compensator))
    forces = [-one.wrench.fy for one in loop.mission(duration)]
    return loop, np.array(forces)


@pytest.mark.parametrize('stiffness', [600.0, 2000.0])
def test_force_is_held_while_the_gondola_yields(stiffness):
    loop, forces = pressed(stiffness, 21.0)
    assert loop.compensator.contact.pressing.mode is PressMode.HOLDING
    held = forces[-600:]
    assert np.sqrt(((held - 30.0) ** 2).mean()) < 2.0
    assert forces.max() < 40.0
    assert loop.world.rail.y < -0.02
    assert loop.follower.brakes == 0


def test_rigid_wall_ends_in_a_retract_with_its_reason():
    loop, forces = pressed(1e5, 16.0)
    pressing = loop.compensator.contact.pressing
    assert forces.max() < 45.0
    assert pressing.mode is PressMode.RETRACTED
    assert 'next: increase contact.stiffness' in pressing.reason
