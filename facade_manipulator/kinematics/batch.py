"""
Kinematics of many poses at once, on numpy.

The formulas are those of `inverse` and `forward`, in plain numpy with one trigonometric call per
pose. Rows are worked in blocks whose temporary arrays stay in the processor's cache.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import math

import numpy as np

from facade_manipulator.errors import LimitError, ParameterError
from facade_manipulator.kinematics.forward import (
    forward_kinematics,
    ITERATIONS,
    POLISHED,
    STEP_TOLERANCE,
)
from facade_manipulator.kinematics.geometry import Carriages, Geometry

BLOCK = 4096  # rows; ten or so temporary arrays of 32 KiB stay in the second-level cache


def inverse_kinematics_batch(
    geometry: Geometry, poses: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """
    Carriage positions of many poses in the working mode PLUS_MINUS.

    Parameters
    ----------
    geometry : Geometry
    poses : array_like, shape (n, 3)
        x, y, θ [m, m, rad].

    Returns
    -------
    carriages : ndarray, shape (n, 3)
        q1, q2, q3 [m]; rows of NaN where not valid.
    valid : ndarray of bool, shape (n,)
        Where the pose is finite and within reach, as `inverse_kinematics` answers.

    Raises
    ------
    ParameterError
        If `poses` does not have three columns.

    """
    return _by_blocks(partial(_inverse_block, geometry), _rows(poses, 'poses'))


def forward_kinematics_batch(
    geometry: Geometry, carriages: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """
    Poses of many carriage positions on the machine's branch.

    Parameters
    ----------
    geometry : Geometry
    carriages : array_like, shape (n, 3)
        q1, q2, q3 [m].

    Returns
    -------
    poses : ndarray, shape (n, 3)
        x, y, θ [m, m, rad]; rows of NaN where not valid.
    valid : ndarray of bool, shape (n,)
        Where `forward_kinematics` has an answer.

    Raises
    ------
    ParameterError
        If `carriages` does not have three columns.

    """
    return _by_blocks(partial(_forward_block, geometry), _rows(carriages, 'carriages'))


def _rows(values: np.ndarray, name: str) -> np.ndarray:
    values = np.asarray(values, float)
    if values.ndim != 2 or values.shape[1] != 3:
        raise ParameterError(f'{name} has the shape {values.shape}, not (n, 3)')
    return values


def _by_blocks(
    solve: Callable[[np.ndarray, np.ndarray], np.ndarray], values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the answers, NaN where not valid, and the validity of all rows, block by block."""
    answers, valid = np.empty(values.shape), np.empty(len(values), bool)
    with np.errstate(all='ignore'):
        for start in range(0, len(values), BLOCK):
            rows = slice(start, start + BLOCK)
            valid[rows] = solve(values[rows], answers[rows])
            if not valid[rows].all():
                answers[rows][~valid[rows]] = np.nan
    return answers, valid


def _inverse_block(geometry: Geometry, poses: np.ndarray, out: np.ndarray) -> np.ndarray:
    half, square = geometry.platform_half_length, geometry.link_length ** 2
    x, y, theta = poses.T
    # With t = tan(θ/2): b sin θ = t w and b cos θ = w − b, where w = 2 b/(1 + t²).
    t = np.tan(0.5 * theta)
    width = 2.0 * half / (1.0 + t * t)
    rise, span = t * width, width - half
    root1, root2 = square - (y - rise) ** 2, square - (y + rise) ** 2
    out[:, 0] = x - span + np.sqrt(root1)
    out[:, 1] = x + span - np.sqrt(root2)
    out[:, 2] = x
    return (np.minimum(root1, root2) > 0.0) & np.isfinite(x)


def _forward_block(geometry: Geometry, carriages: np.ndarray, out: np.ndarray) -> np.ndarray:
    q1, q2, q3 = carriages.T
    left, right = q1 - q3, q2 - q3
    sine, cosine, y = _solve(geometry, left, right)
    dy, dtheta, valid = _polish(geometry, left, right, (sine, cosine, y))
    out[:, 0] = q3
    out[:, 1] = y + dy
    out[:, 2] = np.arctan2(sine, cosine) + dtheta
    size = np.abs(dy) + np.abs(dtheta)
    valid &= size <= POLISHED
    if not valid.all():
        hard = ~valid & ((size > POLISHED) | (q2 <= q1))
        for row in np.flatnonzero(hard):
            out[row] = _answer(geometry, carriages[row])
        valid |= hard & np.isfinite(out[:, 1])
    return valid


def _solve(
    geometry: Geometry, left: np.ndarray, right: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return sin θ, cos θ and y of the cubic's branch N > 0, in u = 1 − cos θ."""
    half = geometry.platform_half_length
    distance, offset = right - left, right + left
    quarter = 0.25 * offset * offset
    k0 = (geometry.link_length - half) * (geometry.link_length + half) - 0.25 * distance ** 2
    f3 = half * distance
    f2 = 3.0 * f3 + k0
    f1 = 2.0 * (f3 + k0) - quarter * distance / half
    f0 = quarter * (1.0 - distance * (0.5 / half)) ** 2
    u = _versines(f0, f1, f2, f3)
    y = np.sqrt(k0 + f3 - quarter - f3 * u)
    cosine = 1.0 - u
    sine = offset * (2.0 * half * cosine - distance) / (4.0 * half * y)
    norm = np.sqrt(sine * sine + cosine * cosine)
    return sine / norm, cosine / norm, y


def _versines(
    f0: np.ndarray, f1: np.ndarray, f2: np.ndarray, f3: np.ndarray
) -> np.ndarray:
    """Return u = 1 − cos θ of the greatest root; NaN where there is none."""
    slope = np.sqrt(f1 * f1 - 4.0 * f0 * f2)  # NaN where the parabola has no root
    u = 2.0 * f0 / (f1 + slope)
    cubic = f3 * u * u
    step = cubic * u / (slope + 3.0 * cubic)
    u -= step
    easy = (step < STEP_TOLERANCE) & (f1 > 0.0)
    if not easy.all():
        hard = np.flatnonzero(~easy)
        u[hard] = _descend(u[hard], f0[hard], f1[hard], f2[hard], f3[hard])
    return u


def _descend(
    u: np.ndarray, f0: np.ndarray, f1: np.ndarray, f2: np.ndarray, f3: np.ndarray
) -> np.ndarray:
    """Return the least root from u on, or from 0 where u is NaN, by Newton's method."""
    u = np.where(f1 > 0.0, np.fmax(u, 0.0), np.nan)
    for _ in range(ITERATIONS):
        slope = f1 - u * (2.0 * f2 - 3.0 * u * f3)
        slope[slope <= 0.0] = np.nan
        step = (f0 - u * (f1 - u * (f2 - u * f3))) / slope
        u += step
        if not (step > STEP_TOLERANCE).any():
            break
    return u


def _polish(
    geometry: Geometry, left: np.ndarray, right: np.ndarray,
    solution: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return one Newton step (Δy, Δθ), and where order and working mode are right."""
    half, square = geometry.platform_half_length, geometry.link_length ** 2
    sine, cosine, y = solution
    s1, s2 = left + half * cosine, half * cosine - right
    u1, u2 = y - half * sine, y + half * sine
    residual1, residual2 = s1 * s1 + u1 * u1 - square, s2 * s2 + u2 * u2 - square
    e1, e2 = u1 * cosine + s1 * sine, u2 * cosine - s2 * sine
    scale = -0.5 / (u1 * e2 + u2 * e1)  # −1/(2 N)
    dy = (e2 * residual1 + e1 * residual2) * scale
    dtheta = (u1 * residual2 - u2 * residual1) * scale / half
    return dy, dtheta, (np.minimum(s1, s2) > 0.0) & (right > left)


def _answer(geometry: Geometry, carriages: np.ndarray) -> tuple[float, float, float]:
    """Answer one row by the scalar path: carriages that passed each other, or poses near N = 0."""
    try:
        return forward_kinematics(geometry, Carriages(*carriages.tolist()))
    except (LimitError, ParameterError):
        return math.nan, math.nan, math.nan
