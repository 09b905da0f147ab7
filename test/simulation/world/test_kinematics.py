"""Kinematics and statics of the package, compared with those of the engine."""

import mujoco
import numpy as np
import pytest

from facade_manipulator.kinematics import (
    compose,
    forward_kinematics,
    Geometry,
    inverse_kinematics,
    Mechanism,
    Pose,
    Wrench,
)
from facade_manipulator.package_files import config_path
from facade_manipulator.simulation.world.scenario import Motion, Scenario
from facade_manipulator.simulation.world.world import World

GEOMETRY = Geometry()
OTHER = Geometry(link_length=0.30, platform_half_length=0.25)
POSES = (
    Pose(0.0, 0.25, 0.0),
    Pose(0.12, 0.26, 0.06),
    Pose(-0.1, 0.2, -0.15),
)
STILL = Scenario(motion=Motion(x=((0.0, 1.0, 0.0),)))
SWAY = Motion(x=((0.1, 0.3, 0.0),), y=((0.015, 0.5, 0.0),), theta=((0.035, 0.4, 0.0),))
SWAYING = Scenario(motion=SWAY)


def hold(world, carriages, duration):
    for time in np.arange(1, round(duration / 0.01) + 1) * 0.01:
        world.advance(time, carriages)


def test_mjcf_file_with_its_keyframe_hangs_at_the_origin():
    model = mujoco.MjModel.from_xml_path(str(config_path('gondola.xml')))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key('middle').id)
    mujoco.mj_forward(model, data)
    joint = data.site('platform1').xpos
    assert data.site('link1').xpos == pytest.approx(joint, abs=1e-6)
    mujoco.mj_step(model, data, 200)
    assert data.site('rail').xpos == pytest.approx(np.zeros(3), abs=1e-3)
    x, y, _ = data.site('head').xpos
    assert (x, y) == pytest.approx((0.0, 0.25), abs=1e-3)


@pytest.mark.parametrize(
    ('geometry', 'pose'), [*((GEOMETRY, pose) for pose in POSES), (OTHER, POSES[0])]
)
def test_head_on_swaying_gondola_matches_forward_kinematics(geometry, pose):
    world = World(SWAYING, geometry, head=pose)
    carriages = inverse_kinematics(geometry, pose)
    hold(world, carriages, 0.05)  # the sway begins with a jerk
    for time in 0.05 + np.arange(1, 101) * 0.01:
        world.advance(time, carriages)
        expected = compose(world.rail, forward_kinematics(geometry, world.carriages))
        assert world.head == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    'wrench',
    [
        Wrench(10.0, 0.0, 0.0),
        Wrench(0.0, 30.0, 0.0),
        Wrench(0.0, 0.0, 3.0),
        Wrench(5.0, -20.0, 2.0),
    ],
)
@pytest.mark.parametrize('pose', POSES[:2])
def test_simulated_carriage_forces_balance_a_wrench(pose, wrench):
    world = World(STILL, GEOMETRY, head=pose)
    platform = world.data.body('platform')
    platform.xfrc_applied[[0, 1, 5]] = np.negative(wrench)
    hold(world, inverse_kinematics(GEOMETRY, pose), 0.5)
    expected = Mechanism(GEOMETRY).carriage_forces(world.head, wrench)
    forces = world.data.actuator_force
    assert forces == pytest.approx(np.array(expected), rel=1e-6, abs=1e-5)
