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


def head_stiffness(mechanism: Mechanism, pose: Pose, screw: float, link: float) -> np.ndarray:
    """
    Stiffness K = Jᵀ C⁻¹ J of the head, its drives holding still, shape (3, 3).

    Parameters
    ----------
    mechanism : Mechanism
    pose : Pose
    screw, link : float
        Axial stiffness of a screw and of a link [N/m].

    Returns
    -------
    ndarray, shape (3, 3)
        From (dx, dy, dθ) to (Fx, Fy, Mz) [N/m, N/rad, N m/rad].

    References
    ----------
    J.-P. Merlet, "Parallel Robots", 2nd ed., Springer 2006, chapter 9.

    """
    rates = mechanism.jacobian(pose)
    compliance = _compliance(mechanism, pose, screw, link)
    return rates.T @ (rates / compliance[:, None])


def _compliance(mechanism: Mechanism, pose: Pose, screw: float, link: float) -> np.ndarray:
    """
    Return the yield of each carriage's chain per force along the rail [m/N].

    A link that leans by α to the rail bears f/cos α and yields along the rail by 1/cos α of its
    own yield.
    """
    link1, link2 = mechanism.geometry.link_lengths
    half1, half2 = mechanism.geometry.half_lengths
    q1, q2, _ = mechanism.on_rail(mechanism.inverse_kinematics(pose))
    platform = mechanism.platform(pose)
    lean1 = (q1 - platform.x + half1 * math.cos(platform.theta)) / link1
    lean2 = (platform.x + half2 * math.cos(platform.theta) - q2) / link2
    return np.array([
        1.0 / screw + 1.0 / (link * lean1 ** 2), 1.0 / screw + 1.0 / (link * lean2 ** 2),
        1.0 / screw])
