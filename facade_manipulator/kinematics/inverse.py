"""
Inverse kinematics of one pose (eqs 7-9 of the paper), on `math`.

References
----------
Park et al., "Design of a 3-DOF Parallel Manipulator to Compensate for Disturbances in Facade
Cleaning", section II-A.

"""

from __future__ import annotations

from math import cos, isfinite, sin, sqrt

from facade_manipulator.errors import UnreachableError
from facade_manipulator.kinematics.geometry import Carriages, Geometry, not_finite, Pose
from facade_manipulator.kinematics.modes import WorkingMode

# s, c, u1, u2, s1, s2 of `links`: plain tuples, because naming the fields would cost as much as
# computing them.
Links = tuple[float, float, float, float, float, float]
_new_tuple = tuple.__new__


def inverse_kinematics(
    geometry: Geometry, pose: Pose, working_mode: WorkingMode = WorkingMode.PLUS_MINUS
) -> Carriages:
    """
    Carriage positions of a pose.

    Answers for reach and the working mode alone; `certify` answers for the machine.

    Parameters
    ----------
    geometry : Geometry
    pose : Pose
        [m, m, rad].
    working_mode : WorkingMode

    Returns
    -------
    Carriages
        [m].

    Raises
    ------
    ParameterError
        If the pose is not finite (a ValueError).
    UnreachableError
        If a link is too short: ``|y| + b |sin θ|`` is not below l (eq. 19).

    """
    x = pose[0]
    _, cosine, _, _, projection1, projection2 = links(geometry, pose, working_mode)
    span = geometry.platform_half_length * cosine
    # Carriages(...) in half the time: the machine asks for this at every setpoint.
    return _new_tuple(Carriages, (x - span + projection1, x + span - projection2, x))


def links(
    geometry: Geometry, pose: Pose, working_mode: WorkingMode = WorkingMode.PLUS_MINUS
) -> Links:
    """
    Return the two links of a pose, as every formula of the velocities needs them.

    With s = sin θ and c = cos θ: heights u1 = y − b s and u2 = y + b s of B1 and B2 above the
    rail, and the links' signed projections on it, s1 = q1 − x + b c and s2 = x + b c − q2 [m].
    In the mode PLUS_MINUS both projections are positive.

    Returns
    -------
    s, c, u1, u2, s1, s2

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    """
    x, y, theta = pose
    if not isfinite(x + y + theta):
        raise not_finite(Pose(x, y, theta))
    sine = sin(theta)
    length = geometry.link_length
    rise = geometry.platform_half_length * sine
    height1 = y - rise
    height2 = y + rise
    square = length * length
    root1 = square - height1 * height1
    root2 = square - height2 * height2
    if root1 <= 0.0 or root2 <= 0.0:
        raise UnreachableError(
            '|y| + b |sin theta|', abs(y) + abs(rise), length, 'm', 'not below')
    return (
        sine, cos(theta), height1, height2,
        working_mode.sign1 * sqrt(root1), -working_mode.sign2 * sqrt(root2),
    )
