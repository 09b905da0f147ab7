"""What a wrench of the head on the wall asks of the carriages, and what it can be."""

from __future__ import annotations

import math

import numpy as np

from facade_manipulator.errors import ForceLimitError, ParameterError, SingularityError
from facade_manipulator.kinematics.geometry import Carriages, Pose, Wrench
from facade_manipulator.kinematics.mechanism import Mechanism

GRAVITY = 9.81  # m/s²


def carriage_forces(mechanism: Mechanism, pose: Pose, wrench: Wrench) -> Carriages:
    """
    Carriage forces τ = J⁻ᵀ F along the rail with which the head exerts a wrench [N].

    On what it touches, in frame rail [N, N, N m]. Friction and weight are not in it.

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.
    SingularityError
        If the pose is exactly singular.

    """
    try:
        forces = np.linalg.solve(mechanism.jacobian(pose).T, wrench)
    except np.linalg.LinAlgError:
        raise SingularityError('|N|', 0.0, 0.0, 'm2', 'not above') from None
    return Carriages(*forces.tolist())


def certify_load(
    mechanism: Mechanism, pose: Pose, wrench: Wrench, force_limit: float
) -> Carriages:
    """
    Certify a pose in which the head is to exert a wrench for long.

    Parameters
    ----------
    mechanism : Mechanism
    pose : Pose
    wrench : Wrench
        As of `carriage_forces`.
    force_limit : float
        Continuous force of a carriage's drive along the rail [N].

    Returns
    -------
    Carriages
        Positions [m].

    Raises
    ------
    ParameterError
        If a number is not finite, or the limit not positive.
    ForceLimitError
        If a drive is too weak.
    LimitError
        As `certify`.

    """
    if not (math.isfinite(force_limit) and force_limit > 0.0):
        raise ParameterError(f'force_limit = {force_limit} N is not a positive force')
    if not all(map(math.isfinite, wrench)):
        raise ParameterError(f'wrench = {tuple(wrench)} is not finite')
    carriages = mechanism.certify(pose)
    forces = carriage_forces(mechanism, pose, wrench)
    for name, force in zip(Carriages._fields, forces, strict=True):
        if abs(force) > force_limit:
            raise ForceLimitError(
                f'force of {name} for the wrench', abs(force), force_limit, 'N', 'above')
    return carriages
