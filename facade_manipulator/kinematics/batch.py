"""
Kinematics of many poses at once, on numpy.

The formulas are those of `inverse` and `forward`. Rows are worked in blocks that stay in the
processor's cache, in place, with one trigonometric call per pose.
"""

from __future__ import annotations

from collections.abc import Iterator
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

BLOCK = 4096  # rows; ten or so buffers of 32 KiB stay in the second-level cache


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
    poses = _rows(poses, 'poses')
    carriages = np.empty(poses.shape)
    valid = np.empty(len(poses), bool)
    buffers = np.empty((5, min(BLOCK, len(poses))))
    with np.errstate(all='ignore'):
        for rows in _blocks(len(poses)):
            _inverse_block(geometry, poses[rows], carriages[rows], valid[rows], buffers)
    return carriages, valid


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
    carriages = _rows(carriages, 'carriages')
    poses = np.empty(carriages.shape)
    valid = np.empty(len(carriages), bool)
    buffers = np.empty((13, min(BLOCK, len(carriages))))
    with np.errstate(all='ignore'):
        for rows in _blocks(len(carriages)):
            _forward_block(geometry, carriages[rows], poses[rows], valid[rows], buffers)
    return poses, valid


def _rows(values: np.ndarray, name: str) -> np.ndarray:
    values = np.asarray(values, float)
    if values.ndim != 2 or values.shape[1] != 3:
        raise ParameterError(f'{name} has the shape {values.shape}, not (n, 3)')
    return values


def _blocks(count: int) -> Iterator[slice]:
    for start in range(0, count, BLOCK):
        yield slice(start, min(start + BLOCK, count))


def _inverse_block(
    geometry: Geometry, poses: np.ndarray, out: np.ndarray, valid: np.ndarray,
    buffers: np.ndarray,
) -> None:
    half, square = geometry.platform_half_length, geometry.link_length ** 2
    x, y, theta = poses.T
    rise, span, root1, root2, work = buffers[:, :len(poses)]
    # With t = tan(θ/2): b sin θ = t w and b cos θ = w − b, where w = 2 b/(1 + t²).
    np.multiply(theta, 0.5, out=work)
    np.tan(work, out=work)
    np.multiply(work, work, out=span)
    span += 1.0
    np.divide(2.0 * half, span, out=span)
    np.multiply(work, span, out=rise)
    span -= half
    np.subtract(y, rise, out=root1)
    np.add(y, rise, out=root2)
    for root in (root1, root2):
        np.multiply(root, root, out=root)
        np.subtract(square, root, out=root)
    np.minimum(root1, root2, out=work)
    np.greater(work, 0.0, out=valid)
    np.sqrt(root1, out=root1)
    np.sqrt(root2, out=root2)
    root1 -= span
    span -= root2
    np.add(x, root1, out=out[:, 0])
    np.add(x, span, out=out[:, 1])
    out[:, 2] = x
    valid &= np.isfinite(x)
    if not valid.all():
        out[~valid] = np.nan


def _forward_block(
    geometry: Geometry, carriages: np.ndarray, out: np.ndarray, valid: np.ndarray,
    buffers: np.ndarray,
) -> None:
    left, right, sine, cosine, y = buffers[:5, :len(carriages)]
    work = buffers[5:, :len(carriages)]
    np.subtract(carriages[:, 0], carriages[:, 2], out=left)
    np.subtract(carriages[:, 1], carriages[:, 2], out=right)
    _solve(geometry, left, right, (sine, cosine, y), work)
    _polish(geometry, left, right, (sine, cosine, y), work, valid)
    dy, dtheta, size = work[:3]
    out[:, 0] = carriages[:, 2]
    np.add(y, dy, out=out[:, 1])
    np.arctan2(sine, cosine, out=y)
    np.add(y, dtheta, out=out[:, 2])
    np.abs(dy, out=dy)
    np.abs(dtheta, out=size)
    size += dy
    valid &= size <= POLISHED
    if not valid.all():
        out[~valid] = np.nan
        hard = (size > POLISHED) | (carriages[:, 1] <= carriages[:, 0])
        for row in np.flatnonzero(hard):
            out[row] = _answer(geometry, carriages[row])
        np.isfinite(out[:, 1], out=valid)


def _solve(
    geometry: Geometry, left: np.ndarray, right: np.ndarray,
    result: tuple[np.ndarray, np.ndarray, np.ndarray], work: np.ndarray,
) -> None:
    """Write (sin θ, cos θ, y) of the cubic's branch N > 0 into `result`."""
    half = geometry.platform_half_length
    sine, cosine, y = result
    f0, f1, f2, f3, u = work[:5]
    distance, offset = y, sine
    np.subtract(right, left, out=distance)
    np.add(left, right, out=offset)
    # f0 = e slack², f1 = 2 (f3 + K0) − e D/b, f2 = 3 f3 + K0, f3 = b D; e and slack pass through.
    np.multiply(offset, offset, out=f0)
    f0 *= 0.25
    np.multiply(distance, half, out=f3)
    np.multiply(distance, distance, out=f2)
    f2 *= -0.25
    f2 += (geometry.link_length - half) * (geometry.link_length + half)
    np.add(f2, f3, out=cosine)
    np.multiply(f0, distance, out=f1)
    f1 *= -1.0 / half
    f1 += cosine
    f1 += cosine
    cosine -= f0  # y² = K0 + f3 − e − f3 u
    f2 += f3
    f2 += f3
    f2 += f3
    np.multiply(distance, -0.5 / half, out=u)
    u += 1.0
    u *= u
    f0 *= u
    _versines((f0, f1, f2, f3), u, work[5:8])
    np.multiply(f3, u, out=f0)
    np.subtract(cosine, f0, out=f0)
    np.subtract(1.0, u, out=cosine)
    # sin θ = S (2 b c − D)/(4 b y)
    np.multiply(cosine, 2.0 * half, out=u)
    u -= distance
    sine *= u
    np.sqrt(f0, out=y)
    np.multiply(y, 4.0 * half, out=u)
    sine /= u
    np.multiply(sine, sine, out=f0)
    np.multiply(cosine, cosine, out=f1)
    f0 += f1
    np.sqrt(f0, out=f0)
    sine /= f0
    cosine /= f0


def _versines(
    coefficients: tuple[np.ndarray, ...], u: np.ndarray, work: np.ndarray
) -> None:
    """Write u = 1 − cos θ of the greatest root into `u`; NaN where there is none."""
    f0, f1, f2, f3 = coefficients
    slope, step, cubic_part = work
    np.multiply(f1, f1, out=slope)
    np.multiply(f0, f2, out=u)
    u *= 4.0
    slope -= u
    np.sqrt(slope, out=slope)  # NaN, as everything after it, where the parabola has no root
    np.add(f1, slope, out=step)
    np.divide(f0, step, out=u)
    u += u
    np.multiply(u, u, out=cubic_part)  # step = f3 u³/(slope + 3 f3 u²)
    cubic_part *= f3
    np.multiply(cubic_part, u, out=step)
    cubic_part *= 3.0
    slope += cubic_part
    step /= slope
    u -= step
    easy = step < STEP_TOLERANCE
    easy &= f1 > 0.0
    if not easy.all():
        hard = np.flatnonzero(~easy)
        u[hard] = _descend(u[hard], *(coefficient[hard] for coefficient in coefficients))


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
    result: tuple[np.ndarray, np.ndarray, np.ndarray], work: np.ndarray, valid: np.ndarray,
) -> None:
    """Leave one Newton step (Δy, Δθ) in ``work[:2]``; valid in the right order and mode."""
    half, square = geometry.platform_half_length, geometry.link_length ** 2
    sine, cosine, y = result
    residual1, residual2, u1, u2, e1, e2, scratch = work[:7]
    uncrossed = right > left
    np.multiply(cosine, half, out=scratch)
    left += scratch
    np.subtract(scratch, right, out=right)  # from here on left and right are s1 and s2
    np.minimum(left, right, out=u1)
    np.greater(u1, 0.0, out=valid)
    valid &= uncrossed
    np.multiply(sine, half, out=scratch)
    np.subtract(y, scratch, out=u1)
    np.add(y, scratch, out=u2)
    _residual(left, u1, square, residual1, scratch)
    _residual(right, u2, square, residual2, scratch)
    np.multiply(u1, cosine, out=e1)
    left *= sine
    e1 += left
    np.multiply(u2, cosine, out=e2)
    right *= sine
    e2 -= right
    np.multiply(u1, e2, out=left)
    np.multiply(u2, e1, out=right)
    left += right
    np.divide(-0.5, left, out=left)  # −1/(2 N)
    u1 *= residual2
    u2 *= residual1
    e2 *= residual1
    e1 *= residual2
    e1 += e2
    np.subtract(u1, u2, out=residual2)
    np.multiply(e1, left, out=residual1)
    residual2 *= left
    residual2 *= 1.0 / half


def _residual(
    projection: np.ndarray, height: np.ndarray, square: float, out: np.ndarray,
    scratch: np.ndarray,
) -> None:
    """Write |A B|² − l² of one link into `out`."""
    np.multiply(projection, projection, out=out)
    np.multiply(height, height, out=scratch)
    out += scratch
    out -= square


def _answer(geometry: Geometry, carriages: np.ndarray) -> tuple[float, float, float]:
    """Answer one row by the scalar path: carriages that passed each other, or poses near N = 0."""
    try:
        return forward_kinematics(geometry, Carriages(*carriages.tolist()))
    except (LimitError, ParameterError):
        return math.nan, math.nan, math.nan
