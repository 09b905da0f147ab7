"""
Forward kinematics of three carriage positions, on `math`.

Of the cubic in `closure`, one root lies at or below −1; the greatest of the other two, where they
are real, is the branch with N > 0 on which the machine is assembled. f is convex right of it and
f(1) ≥ 0, so Newton's method from c = 1 descends to it without a bracket. θ comes from atan2 and
never from acos, so nothing is lost near θ = 0; one Newton step on the links polishes the pose.
"""

from __future__ import annotations

from math import atan2, cos, isfinite, sqrt

from facade_manipulator.errors import UnreachableError
from facade_manipulator.kinematics.assembly import assembly_modes
from facade_manipulator.kinematics.closure import closure_constant, cubic, newton_step, unit
from facade_manipulator.kinematics.geometry import Carriages, Geometry, not_finite, Pose
from facade_manipulator.kinematics.jacobian import parallel_singularity

STEP_TOLERANCE = 1e-9  # what such a step leaves is its square: the polish removes it
ITERATIONS = 100


def forward_kinematics(geometry: Geometry, carriages: Carriages) -> Pose:
    """
    Pose of the carriages on the machine's branch: y > 0, N > 0, working mode PLUS_MINUS.

    Parameters
    ----------
    geometry : Geometry
    carriages : Carriages
        [m].

    Returns
    -------
    Pose
        [m, m, rad].

    Raises
    ------
    ParameterError
        If a position is not finite (a ValueError).
    UnreachableError
        If the links cannot be joined, or only on another branch or in another working mode.
    SingularityError
        If the pose is exactly singular.

    """
    q1, q2, q3 = carriages
    if not isfinite(q1 + q2 + q3):
        raise not_finite(Carriages(q1, q2, q3))
    left, right = q1 - q3, q2 - q3
    if right <= left:
        y, theta = _crossed(geometry, Carriages(q1, q2, q3))
    else:
        y, theta = _solve(geometry, left, right)
    return Pose(q3, y, theta)


def _solve(geometry: Geometry, left: float, right: float) -> tuple[float, float]:
    """Return (y, θ) for left = q1 − q3 below right = q2 − q3."""
    half = geometry.platform_half_length
    distance, double_offset = right - left, left + right
    u = _versine(geometry, distance, double_offset)
    y2 = (closure_constant(geometry, distance) - 0.25 * double_offset * double_offset
          + half * distance * (1.0 - u))
    if y2 <= 0.0:
        raise UnreachableError('y squared', y2, 0.0, 'm2', 'not above')
    y = sqrt(y2)
    cosine = 1.0 - u
    sine = double_offset * (2.0 * half * cosine - distance) / (4.0 * half * y)
    sine, cosine = unit(sine, cosine)
    _check_working_mode(left + half * cosine, half * cosine - right)
    dy, dtheta = newton_step(geometry, left, right, y, sine, cosine)
    return y + dy, atan2(sine, cosine) + dtheta


def _versine(geometry: Geometry, distance: float, double_offset: float) -> float:
    """Return u = 1 − cos θ of the branch with N > 0, by Newton's method from u = 0."""
    f0, f1, f2, f3 = cubic(geometry, distance, double_offset)
    u = 0.0
    for _ in range(ITERATIONS):
        slope = f1 - u * (2.0 * f2 - 3.0 * u * f3)
        if slope <= 0.0 or u > 2.0:
            break
        step = (f0 - u * (f1 - u * (f2 - u * f3))) / slope
        u += step
        if step < STEP_TOLERANCE:
            return u
    raise UnreachableError(
        'closure residual of the links', f0 - u * (f1 - u * (f2 - u * f3)), 0.0, 'm2', 'above')


def _check_working_mode(projection1: float, projection2: float) -> None:
    """Both carriages must stand inside their platform joints."""
    if projection1 <= 0.0:
        raise UnreachableError(
            'q1 - q3 + b cos(theta)', projection1, 0.0, 'm', 'of another working mode, not above')
    if projection2 <= 0.0:
        raise UnreachableError(
            'q3 - q2 + b cos(theta)', projection2, 0.0, 'm', 'of another working mode, not above')


def _crossed(geometry: Geometry, carriages: Carriages) -> tuple[float, float]:
    """Return (y, θ) of carriages that passed each other: there the cubic's roots change places."""
    q1, q2, q3 = carriages
    half = geometry.platform_half_length
    for _, y, theta in assembly_modes(geometry, carriages):
        inside = min(q1 - q3 + half * cos(theta), q3 - q2 + half * cos(theta)) > 0.0
        if y > 0.0 and inside and parallel_singularity(geometry, Pose(q3, y, theta)) > 0.0:
            return y, theta
    raise UnreachableError('q2 - q1', q2 - q1, 0.0, 'm', 'not above')
