"""
Forward kinematics: the pose of the platform for three carriage positions, on `math`.

The closure of both links reduces to a cubic in c = cos θ, which is not in the paper. With D = q2 −
q1, S = q1 + q2 − 2 q3, e = S²/4 and K0 = l² − b² − D²/4::

    y²  = K0 − e + b D c,      y s = S (2 b c − D)/(4 b),      f(c) = 0,
    f(c) = b D c³ + K0 c² − D (b + e/b) c + e (1 + D²/(4b²)) − K0.

One root is at or below −1. The larger of the other two, if they are real, belongs to the branch
with N > 0 on which the machine is assembled. f is convex right of that root and f(1) ≥ 0, so
Newton's method converges to it from c = 1 without a bracket. Near θ = 0 the cubic is a parabola
except for its last term. One Newton step from the parabola's smaller root leads to the solution,
or to a better start than c = 1. θ is computed by atan2 instead of acos, which would lose digits
near θ = 0. One Newton step on the links refines the pose.
"""

from __future__ import annotations

from math import atan2, cos, isfinite, sin, sqrt

from facade_manipulator.errors import (
    ManipulatorError,
    SingularityError,
    UnreachableError,
)
from facade_manipulator.kinematics.geometry import Carriages, Geometry, not_finite, Pose

FARTHEST = 200.0  # m, maximum l + b of a geometry; no power of it overflows
# such a step leaves an error of its square, and the refinement squares that error
STEP_TOLERANCE = 1e-5
POLISHED = (
    1e-8  # a Newton step on the links below this size changes no digit that matters
)
ITERATIONS = 100
FLAT = 1e-6  # m, distance from the rail below which the rounding of y² decides
ROOT_TOLERANCE = (
    1e-7  # tolerance of a root of the cubic; a double root has half the digits
)

_new_tuple = tuple.__new__  # creates a named tuple in half the time of its constructor


def forward_kinematics(geometry: Geometry, carriages: Carriages) -> Pose:
    """
    Return the pose on the machine's branch [m, m, rad]: A1 before A2, y > 0, N > 0.

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
    left, right = q1 - q3, q2 - q3
    if -FARTHEST < left < right < FARTHEST:
        length, half = geometry.link_length, geometry.platform_half_length
        y, theta = assemble((length, length, half, half), left, right)
    else:  # NaN fails every comparison and arrives here
        raise not_in_order(Carriages(q1, q2, q3))
    return _new_tuple(Pose, (q3, y, theta))


def assembly_modes(geometry: Geometry, carriages: Carriages) -> tuple[Pose, ...]:
    """
    Return all poses of the platform for three carriages [m, m, rad], at most four.

    Two poses are in front of the rail and two are their mirror images behind it; any working mode
    is possible. Poses are sorted by decreasing cos θ, then by decreasing y. If the machine can
    take one of them, the first is the pose of `forward_kinematics`.

    Raises
    ------
    ParameterError
        If a position is not finite (a ValueError).

    """
    q1, q2, q3 = carriages
    if not all(map(isfinite, carriages)):
        raise not_finite(Carriages(q1, q2, q3))
    length, half = geometry.link_length, geometry.platform_half_length
    distance, skew = q2 - q1, q1 + q2 - 2.0 * q3  # D and S
    e, product = 0.25 * skew * skew, half * distance
    constant = (length - half) * (length + half) - 0.25 * distance * distance  # K0
    import numpy as np

    modes = []
    for root in np.roots(
        [
            product,
            constant,
            -distance * (half + e / half),
            e * (1.0 + 0.25 * distance * distance / (half * half)) - constant,
        ]
    ).tolist():
        cosine = min(1.0, max(-1.0, root.real))
        y_square = constant - e + product * cosine
        if abs(root - cosine) > ROOT_TOLERANCE or y_square < -ROOT_TOLERANCE:
            continue
        y = sqrt(max(0.0, y_square))
        theta = atan2(sqrt(1.0 - cosine * cosine), cosine)
        # At y = 0 the lengths do not depend on y, and Newton's method diverges.
        if y > FLAT:
            theta = atan2(
                skew * (2.0 * half * cosine - distance) / (4.0 * half * y), cosine
            )
            y, theta = _polish((length, length, half, half), q1 - q3, q2 - q3, y, theta)
        modes += [Pose(q3, y, theta), Pose(q3, -y, -theta)]
    return tuple(sorted(modes, key=lambda pose: (-cos(pose.theta), -pose.y)))


def assemble(
    lengths: tuple[float, float, float, float], left: float, right: float
) -> tuple[float, float]:
    """
    Return y and θ of a platform for left = q1 − q3 < right = q2 − q3 [m, rad].

    Parameters
    ----------
    lengths : tuple
        Lengths of both links and both halves of the platform, on the sides of A1 and A2 [m]. If
        the sides differ, Newton's method starts from the solution for the mean lengths.
    left, right : float
        Positions of A1 and A2 from A3 [m].

    """
    link1, link2, half1, half2 = lengths
    y, sine, cosine = close(0.5 * (link1 + link2), 0.5 * (half1 + half2), left, right)
    dy, dtheta = _newton_step(lengths, left, right, y, sine, cosine)
    theta = atan2(sine, cosine)
    if abs(dtheta) + abs(dy) > POLISHED:
        return _polish(lengths, left, right, y, theta)
    return y + dy, theta + dtheta


def close(
    length: float, half: float, left: float, right: float
) -> tuple[float, float, float]:
    """
    Return y [m], sin θ and cos θ by the root u = 1 − cos θ of f0 − f1 u + f2 u² − f3 u³.

    Near θ = 0, u keeps the digits that cos θ loses; y² decreases by f3 u.
    """
    distance = right - left
    e = 0.25 * (left + right) * (left + right)
    slack = 1.0 - 0.5 * distance / half
    product = half * distance  # f3
    constant = (length - half) * (length + half) - 0.25 * distance * distance  # K0
    u = _least_root(
        e * slack * slack,
        2.0 * (product + constant) - e * distance / half,
        3.0 * product + constant,
        product,
    )
    square = constant + product - e - product * u
    if square <= 0.0:
        raise UnreachableError('y squared', square, 0.0, 'm2', 'not above')
    y = sqrt(square)
    cosine = 1.0 - u
    sine = (left + right) * (2.0 * half * cosine - right + left) / (4.0 * half * y)
    norm = sqrt(sine * sine + cosine * cosine)
    sine /= norm
    cosine /= norm
    if left + half * cosine <= 0.0 or half * cosine - right <= 0.0:
        raise _other_working_mode(left + half * cosine, half * cosine - right)
    return y, sine, cosine


def _newton_step(
    lengths: tuple[float, float, float, float],
    left: float,
    right: float,
    y: float,
    sine: float,
    cosine: float,
) -> tuple[float, float]:
    """
    Return one Newton step (Δy, Δθ) on the closure s_i² + u_i² = l_i² of both links.

    Raises a SingularityError if N is exactly 0 there.
    """
    link1, link2, half1, half2 = lengths
    u1, u2 = y - half1 * sine, y + half2 * sine
    s1, s2 = left + half1 * cosine, half2 * cosine - right
    residual1 = s1 * s1 + u1 * u1 - link1 * link1
    residual2 = s2 * s2 + u2 * u2 - link2 * link2
    turn1 = half1 * (u1 * cosine + s1 * sine)
    turn2 = half2 * (u2 * cosine - s2 * sine)
    number = u1 * turn2 + u2 * turn1
    if number == 0.0:
        raise SingularityError('|N|', 0.0, 0.0, 'm2', 'not above')
    scale = -0.5 / number
    return (
        scale * (residual1 * turn2 + residual2 * turn1),
        scale * (residual2 * u1 - residual1 * u2),
    )


def _polish(
    lengths: tuple[float, float, float, float],
    left: float,
    right: float,
    y: float,
    theta: float,
) -> tuple[float, float]:
    """Return y and θ after Newton steps that are repeated while they shrink [m, rad]."""
    last = 1.0
    while True:
        dy, dtheta = _newton_step(lengths, left, right, y, sin(theta), cos(theta))
        size = abs(dtheta) + abs(dy)
        if size >= last:
            return y, theta
        last, y, theta = size, y + dy, theta + dtheta


def _least_root(f0: float, f1: float, f2: float, f3: float) -> float:
    """Return the least root u of f0 − f1 u + f2 u² − f3 u³: it has the branch with N > 0."""
    slope, u = f1, 0.0
    square = f1 * f1 - 4.0 * f0 * f2
    # If f1 > 0, f2 is also positive and f is convex up to the parabola's smaller root. A step back
    # from there is at most a third of the way, so u stays above 0 and below the root.
    if f1 > 0.0 < square:
        slope = sqrt(square)
        u = 2.0 * f0 / (f1 + slope)
        cubic_part = f3 * u * u
        step = cubic_part * u / (slope + 3.0 * cubic_part)
        u -= step
        if step < STEP_TOLERANCE:
            return u
        slope = f1 - u * (2.0 * f2 - 3.0 * u * f3)
    for _ in range(ITERATIONS):
        if slope <= 0.0 or u > 2.0:
            break
        step = (f0 - u * (f1 - u * (f2 - u * f3))) / slope
        u += step
        if step < STEP_TOLERANCE:
            return u
        slope = f1 - u * (2.0 * f2 - 3.0 * u * f3)
    residual = f0 - u * (f1 - u * (f2 - u * f3))
    if residual > 0.0:
        raise UnreachableError(
            'closure residual of the links', residual, 0.0, 'm2', 'above'
        )
    return u  # The cubic has this root, but y is not real there: the caller reports y.


def _other_working_mode(projection1: float, projection2: float) -> UnreachableError:
    """Return the error that names the carriage outside its platform joint."""
    name = 'q1 - q3' if projection1 <= 0.0 else 'q3 - q2'
    return UnreachableError(
        f'{name} + b cos(theta)',
        min(projection1, projection2),
        0.0,
        'm',
        'of another working mode, not above',
    )


def not_in_order(carriages: Carriages) -> ManipulatorError:
    """Return the error that describes carriages in the wrong order or beyond all reach."""
    q1, q2, q3 = carriages
    if not all(map(isfinite, carriages)):
        return not_finite(carriages)
    apart = max(abs(q1 - q3), abs(q2 - q3))
    if apart > FARTHEST:
        return UnreachableError(
            'distance of a carriage from q3', apart, FARTHEST, 'm', 'above'
        )
    return UnreachableError('q2 - q1', q2 - q1, 0.0, 'm', 'not above')
