"""
Closure of both links: compute the platform pose from three carriage positions.

The problem reduces to a cubic in c = cos θ, which is not in the paper. With D = q2 − q1, S = q1 +
q2 − 2 q3, e = S²/4 and K0 = l² − b² − D²/4::

    y²  = K0 − e + b D c,      y s = S (2 b c − D)/(4 b),      f(c) = 0,
    f(c) = b D c³ + K0 c² − D (b + e/b) c + e (1 + D²/(4b²)) − K0.

The code computes u = 1 − c, because near θ = 0 it keeps the digits that c loses::

    f = f0 − f1 u + f2 u² − f3 u³,    f0 = e (1 − D/(2b))²,    f1 = 2 (b D + K0) − e D/b,
    f2 = 3 b D + K0,                  f3 = b D,                y² = K0 + f3 − e − f3 u.

One root u is at or above 2. The lesser of the other two, if they are real, belongs to the branch
with N > 0 on which the machine is assembled. f is convex below that root and f(0) ≥ 0, so Newton's
method converges to it from u = 0 without a bracket. Near θ = 0 the cubic is a parabola except for
its last term. One Newton step from the parabola's smaller root leads to the solution, or to a
better start than u = 0. θ is computed with atan2, because acos would lose digits near θ = 0.

The cubic requires equal sides. Newton's steps on the closure of both links, s_i² + u_i² = l_i²
with the terms of `links`, refine its solution. They also lead from the mean lengths to the lengths
of each side.
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt

from facade_manipulator.errors import SingularityError, UnreachableError
from facade_manipulator.kinematics.geometry import Sides
from facade_manipulator.kinematics.links import branch_number, links

MAXIMUM_REACH = 200.0  # m, maximum l + b of a geometry; no power of it overflows


# m and rad: a Newton step on the links below this size changes no digit that matters
POLISHED = 1e-8


def assemble(sides: Sides, left: float, right: float) -> tuple[float, float]:
    """
    Return y and θ [m, rad] on the machine's branch: A1 before A2, y > 0, N > 0.

    Parameters
    ----------
    sides : Sides
        [m].
    left, right : float
        Positions q1 − q3 and q2 − q3 of A1 and A2 from A3 [m].

    Raises
    ------
    UnreachableError
        If the links cannot be joined, or only on another branch or in another working mode.
    SingularityError
        If N is exactly 0 or, with sides that differ, not above 0.

    """
    link1, link2, half1, half2 = sides
    length = 0.5 * (link1 + link2)
    half = 0.5 * (half1 + half2)
    y, sine, cosine = _close(length, half, left, right)

    dy, dtheta = _newton_step(sides, left, right, y, sine, cosine)
    theta = atan2(sine, cosine)
    if abs(dtheta) + abs(dy) <= POLISHED:
        return y + dy, theta + dtheta

    y, theta = _polish(sides, left, right, y, theta)
    if link1 != link2 or half1 != half2:
        require_branch(sides, left, right, y, theta)
    return y, theta


FLAT = 1e-6  # m, distance from the rail below which the rounding of y² decides
# tolerance of a root of the cubic; a double root has half the digits
ROOT_TOLERANCE = 1e-7


def platforms(
    length: float, half: float, left: float, right: float
) -> list[tuple[float, float]]:
    """
    Return y and θ [m, rad] of all platforms in front of the rail, for equal sides.

    Any working mode is possible.
    """
    import numpy as np

    f0, f1, f2, f3, y0_square = _cubic(length, half, left, right)
    sides = (length, length, half, half)
    found = []
    for root in np.roots([-f3, f2, -f1, f0]).tolist():
        u = min(2.0, max(0.0, root.real))
        y_square = y0_square - f3 * u
        if abs(root - u) > ROOT_TOLERANCE or y_square < -ROOT_TOLERANCE:
            continue

        y = sqrt(max(0.0, y_square))
        cosine = 1.0 - u
        theta = atan2(sqrt(u * (2.0 - u)), cosine)
        # At y = 0 the lengths do not depend on y, and Newton's method diverges.
        if y > FLAT:
            theta = atan2(_sine(half, left, right, y, cosine), cosine)
            y, theta = _polish(sides, left, right, y, theta)
        found.append((y, theta))
    return found


def _cubic(
    length: float, half: float, left: float, right: float
) -> tuple[float, float, float, float, float]:
    """Return the coefficients f0 to f3 of the cubic in u = 1 − cos θ, and y² at u = 0 [m²]."""
    distance = right - left  # D
    e = 0.25 * (left + right) * (left + right)
    slack = 1.0 - 0.5 * distance / half
    product = half * distance
    constant = (length - half) * (length + half) - 0.25 * distance * distance  # K0
    f0 = e * slack * slack
    f1 = 2.0 * (product + constant) - e * distance / half
    f2 = 3.0 * product + constant
    return f0, f1, f2, product, constant + product - e


def _close(
    length: float, half: float, left: float, right: float
) -> tuple[float, float, float]:
    """Return y [m], sin θ and cos θ on the machine's branch, for equal sides."""
    f0, f1, f2, f3, y0_square = _cubic(length, half, left, right)
    u = _least_root(f0, f1, f2, f3)
    square = y0_square - f3 * u
    if square <= 0.0:
        raise UnreachableError('y squared', square, 0.0, 'm2', 'not above')
    y = sqrt(square)
    cosine = 1.0 - u
    sine = _sine(half, left, right, y, cosine)

    norm = sqrt(sine * sine + cosine * cosine)
    sine /= norm
    cosine /= norm
    projection1 = left + half * cosine
    projection2 = half * cosine - right
    if projection1 <= 0.0 or projection2 <= 0.0:
        raise _working_mode_error(projection1, projection2)
    return y, sine, cosine


def _sine(half: float, left: float, right: float, y: float, cosine: float) -> float:
    """Return sin θ = S (2 b c − D)/(4 b y) with c = cos θ; lengths in m."""
    return (left + right) * (2.0 * half * cosine - right + left) / (4.0 * half * y)


def _newton_step(
    sides: Sides, left: float, right: float, y: float, sine: float, cosine: float
) -> tuple[float, float]:
    """
    Return a Newton step (Δy, Δθ) [m, rad] for the equations s_i² + u_i² = l_i² of both links.

    Raises a SingularityError if N is exactly 0 there.
    """
    link1, link2, half1, half2 = sides
    u1 = y - half1 * sine
    u2 = y + half2 * sine
    s1 = left + half1 * cosine
    s2 = half2 * cosine - right
    residual1 = s1 * s1 + u1 * u1 - link1 * link1
    residual2 = s2 * s2 + u2 * u2 - link2 * link2

    # half the derivatives of the residuals by θ; those by y are u1 and u2
    turn1 = half1 * (u1 * cosine + s1 * sine)
    turn2 = half2 * (u2 * cosine - s2 * sine)
    determinant = u1 * turn2 + u2 * turn1
    if determinant == 0.0:
        raise SingularityError('|N|', 0.0, 0.0, 'm2', 'not above')

    scale = -0.5 / determinant
    dy = scale * (residual1 * turn2 + residual2 * turn1)
    dtheta = scale * (residual2 * u1 - residual1 * u2)
    return dy, dtheta


def _polish(
    sides: Sides, left: float, right: float, y: float, theta: float
) -> tuple[float, float]:
    """Return y and θ [m, rad] after Newton steps, repeated while they become smaller."""
    last = 1.0
    while True:
        dy, dtheta = _newton_step(sides, left, right, y, sin(theta), cos(theta))
        size = abs(dtheta) + abs(dy)
        if size >= last:
            return y, theta
        last = size
        y += dy
        theta += dtheta


CLOSED = 1e-9  # m², tolerance of a link's squared length


def require_branch(
    sides: Sides, left: float, right: float, y: float, theta: float
) -> None:
    """
    Require that the links close on the machine's branch for a platform at y and θ.

    Its inverse kinematics must be `left` and `right`, the positions of A1 and A2 from A3. These
    positions and y are in m, θ is in rad. Raises an UnreachableError or a SingularityError.
    """
    try:
        at = links(sides, y, theta)
    except ValueError:
        raise _branch_error() from None
    _, cosine, _, _, s1, s2 = at
    _, _, half1, half2 = sides
    projection1 = left + half1 * cosine
    projection2 = half2 * cosine - right
    error1 = abs(projection1 * projection1 - s1 * s1)
    error2 = abs(projection2 * projection2 - s2 * s2)
    if max(error1, error2) >= CLOSED or min(y, projection1, projection2) <= 0.0:
        raise _branch_error()
    require_regular(branch_number(at, half1, half2))


def _branch_error() -> UnreachableError:
    """Return the error for carriages whose platform is on another branch only."""
    return UnreachableError('assembly modes on the branch', 0, 1, '', 'below')


def require_regular(number: float) -> None:
    """Raise a SingularityError unless N [m²] is positive, as on the machine's branch."""
    if number <= 0.0:
        raise SingularityError(
            'N', number, 0.0, 'm2', 'at or beyond the parallel singularity, not above'
        )


# such a step leaves an error of its square, and the refinement squares that error
STEP_TOLERANCE = 1e-5
ITERATIONS = 100


def _least_root(f0: float, f1: float, f2: float, f3: float) -> float:
    """Return the smallest root u of f0 − f1 u + f2 u² − f3 u³, which is on the branch N > 0."""
    slope = f1
    u = 0.0
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


def _working_mode_error(projection1: float, projection2: float) -> UnreachableError:
    """
    Return the error for links whose projections [m] are not both positive.

    The error names the lesser projection, which belongs to the carriage farther beyond its joint
    B.
    """
    name = 'q1 - q3'
    projection = projection1
    if projection2 < projection1:
        name = 'q3 - q2'
        projection = projection2
    return UnreachableError(
        f'{name} + b cos(theta)',
        projection,
        0.0,
        'm',
        'in another working mode, because it is not above',
    )
