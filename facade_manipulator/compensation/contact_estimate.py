"""The force on the wall from the drives' torque, for a head without a force sensor."""

from __future__ import annotations

import math

from facade_manipulator.kinematics import Carriages, Mechanism, Pose, Wrench
from facade_manipulator.motion.limits import Triple
from facade_manipulator.parameters import parameter, settings

STICTION_SPEED = 0.002  # m/s, below which the Coulomb friction fades, its sign being unknown


@settings
class FrictionSettings:
    """Friction of the three carriages: measure it by slow strokes off the wall."""

    coulomb: tuple[float, ...] = parameter(
        'Friction that does not depend on speed: q1, q2, q3', default=(0.0, 0.0, 0.0), unit='N',
        minimum=0.0, maximum=1e4, elements=Carriages._fields)
    viscous: tuple[float, ...] = parameter(
        'Friction per speed: q1, q2, q3', default=(0.0, 0.0, 0.0), unit='N s/m',
        minimum=0.0, maximum=1e5, elements=Carriages._fields)
    efficiency: float = parameter(
        'Efficiency of gear and screw together, as of the axes', default=0.8, minimum=0.51,
        maximum=1.0)


def contact_wrench(
    mechanism: Mechanism, friction: FrictionSettings, pose: Pose, velocities: Triple,
    forces: Triple,
) -> Wrench:
    """
    Return what the wall does to the head: −Jᵀ(τ / η' − friction), in the head's frame.

    A drive gives the force that it bears if it drives the load. Where the load drives it, friction
    of gear and screw bears a part, and η' = 2 η − 1 of the load is seen; at rest something between
    that and 1. Inertia is not in it: differentiated velocities are no better than none.

    Parameters
    ----------
    mechanism : Mechanism
    friction : FrictionSettings
    pose : Pose
        Of the head in frame `rail` [m, m, rad].
    velocities, forces : tuple of float, shape (3,)
        Of the carriages along the rail [m/s, N].

    Raises
    ------
    LimitError
        The pose is not one of the mechanism.

    """
    net = (
        _load(force, velocity, friction.efficiency)
        - coulomb * _sign(velocity) - viscous * velocity
        for force, velocity, coulomb, viscous in zip(
            forces, velocities, friction.coulomb, friction.viscous, strict=True))
    fx, fy, mz = mechanism.end_effector_force(pose, Carriages(*net))
    cosine, sine = math.cos(pose.theta), math.sin(pose.theta)
    return Wrench(-cosine * fx - sine * fy, sine * fx - cosine * fy, -mz)


def _load(force: float, velocity: float, efficiency: float) -> float:
    """Return the load of a drive that gives a force."""
    drives = 0.5 + 0.5 * math.copysign(_sign(velocity), force * velocity)
    return force / (drives + (1.0 - drives) * (2.0 * efficiency - 1.0))


def _sign(velocity: float) -> float:
    return math.tanh(velocity / STICTION_SPEED)
