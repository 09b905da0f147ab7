"""The force on the wall from the drives' torque, for a head without a force sensor."""

from __future__ import annotations

import math

from facade_manipulator.kinematics import Carriages, end_effector_force, Geometry, Pose, Wrench
from facade_manipulator.motion import Triple
from facade_manipulator.parameters import parameter, settings

STICTION_SPEED = 0.002  # m/s, below which the Coulomb friction fades, its sign being unknown


@settings
class FrictionSettings:
    """Friction of the three carriages: measure it by slow strokes off the wall."""

    coulomb: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), 'Friction that does not depend on speed: q1, q2, q3', unit='N',
        minimum=0.0, maximum=1e4, elements=Carriages._fields)
    viscous: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), 'Friction per speed: q1, q2, q3', unit='N s/m',
        minimum=0.0, maximum=1e5, elements=Carriages._fields)


def contact_wrench(
    geometry: Geometry, friction: FrictionSettings, pose: Pose, velocities: Triple, forces: Triple
) -> Wrench:
    """
    Return what the wall does to the head: −Jᵀ(τ − friction), in the head's frame.

    Inertia is not in it: at the accelerations of compensation it is small beside friction.

    Parameters
    ----------
    geometry : Geometry
    friction : FrictionSettings
    pose : Pose
        Of the head in frame `rail` [m, m, rad].
    velocities, forces : tuple of float, shape (3,)
        Of the carriages along the rail [m/s, N].

    Raises
    ------
    LimitError
        The pose is none of the mechanism.

    """
    net = (
        force - coulomb * math.tanh(velocity / STICTION_SPEED) - viscous * velocity
        for force, velocity, coulomb, viscous in zip(
            forces, velocities, friction.coulomb, friction.viscous, strict=True))
    fx, fy, mz = end_effector_force(geometry, pose, Carriages(*net))
    cosine, sine = math.cos(pose.theta), math.sin(pose.theta)
    return Wrench(-cosine * fx - sine * fy, sine * fx - cosine * fy, -mz)
