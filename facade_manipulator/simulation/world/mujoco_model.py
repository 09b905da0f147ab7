"""MuJoCo model built from config/gondola.xml and the values of a scenario."""

from __future__ import annotations

import math

import mujoco

from facade_manipulator.kinematics import (
    Geometry,
    GRAVITY,
    inverse_kinematics,
    links,
    Pose,
)
from facade_manipulator.package_files import config_path
from facade_manipulator.simulation.world.scenario import Scenario


def build_model(
    geometry: Geometry, scenario: Scenario, is_prescribed: bool
) -> mujoco.MjModel:
    """Return the model of a mechanism and a scenario; a carrier moves a prescribed gondola."""
    spec = mujoco.MjSpec.from_file(str(config_path('gondola.xml')))
    _set_mechanism(spec, geometry)

    length = scenario.gondola.cable_length
    load = 0.5 * GRAVITY * sum(body.mass for body in spec.bodies)  # N, on each cable
    for name, side in (('1', -1.0), ('2', 1.0)):
        spec.site(f'hook{name}').pos[2] = spec.site(f'eye{name}').pos[2] + length
        cable = spec.tendon(f'cable{name}')
        # the stiffness in the file is that of 30 m
        cable.stiffness[0] *= 30.0 / length
        cable.springlength = (0.0, length - load / cable.stiffness[0])

        for site in (f'track{name}', f'guide{name}'):
            spec.site(site).pos[0] = side * scenario.gondola.guide_lever
        spec.joint(f'bristle{name}').stiffness[0] = 0.5 * scenario.wall.brush_stiffness

    spec.body('wall').pos[1] = scenario.wall.distance
    spec.equality('carrier').active = is_prescribed
    return spec.compile()


def initial_state(
    model: mujoco.MjModel, geometry: Geometry, head: Pose
) -> mujoco.MjData:
    """Return the equilibrium in still air with the head at a pose in frame rail [m, rad]."""
    data = mujoco.MjData(model)
    q1, q2, q3 = inverse_kinematics(geometry, head)
    _, _, height1, height2, projection1, projection2 = links(geometry, head)
    for name, value in (
        ('q1', q1),
        ('q2', q2),
        ('q3', q3),
        ('out', head.y),
        ('yaw', head.theta),
        ('link1', -math.atan2(height1, projection1)),
        ('link2', math.atan2(height2, projection2)),
    ):
        data.joint(name).qpos = value
    data.ctrl[:] = q1, q2, q3
    mujoco.mj_forward(model, data)

    # a counterweight in the box puts the centre of gravity below the cables
    box = model.body('gondola')
    offset = data.body('gondola').subtree_com[:2]
    box.ipos[:2] -= offset * box.subtreemass / box.mass
    mujoco.mj_setConst(model, mujoco.MjData(model))
    mujoco.mj_forward(model, data)
    return data


def _set_mechanism(spec: mujoco.MjSpec, geometry: Geometry) -> None:
    for name, sign in (('1', -1.0), ('2', 1.0)):
        link = sign * geometry.link_length
        half = sign * geometry.platform_half_length
        spec.body(f'link{name}').ipos[0] = 0.5 * link
        spec.geom(f'link{name}').fromto[3] = link
        spec.site(f'link{name}').pos[0] = link
        spec.site(f'platform{name}').pos[0] = half
        spec.geom('platform').fromto[0 if sign < 0.0 else 3] = half
