"""100 000 poses at once: the package, a Python loop, numpy's bare passes, numba."""

from __future__ import annotations

import math

import numpy as np
from scalar_makers import HALF, inline, LENGTH

COUNT = 100_000
FIRST = 0


def poses(count: int = COUNT) -> np.ndarray:
    """Poses of the machine's everyday work, one in twenty out of reach."""
    random = np.random.default_rng(1)
    result = random.uniform((-0.1, 0.2, -0.15), (0.1, 0.29, 0.15), (count, 3))
    result[19::20, 1] = 0.4
    return result


def reachable(count: int = COUNT) -> np.ndarray:
    """Carriages of poses within reach."""
    from facade_manipulator.kinematics import Geometry, inverse_kinematics_batch

    carriages, valid = inverse_kinematics_batch(Geometry(), poses(count))
    return np.ascontiguousarray(carriages[valid])


def ours_inverse(count: int = COUNT):
    from facade_manipulator.kinematics import Geometry, inverse_kinematics_batch

    geometry, inputs = Geometry(), poses(count)
    return (lambda: inverse_kinematics_batch(geometry, inputs), count,
            inverse_kinematics_batch(geometry, inputs)[0][FIRST])


def ours_forward(count: int = COUNT):
    from facade_manipulator.kinematics import forward_kinematics_batch, Geometry

    geometry, inputs = Geometry(), reachable(count)
    return (lambda: forward_kinematics_batch(geometry, inputs), len(inputs),
            forward_kinematics_batch(geometry, inputs)[0][FIRST])


def loop_inverse():
    inputs = poses()

    def solve():
        valid = np.ones(COUNT, bool)
        result = np.full((COUNT, 3), np.nan)
        for k, pose in enumerate(inputs.tolist()):
            try:
                result[k] = inline(pose)
            except ValueError:
                valid[k] = False
        return result, valid

    return solve, COUNT, solve()[0][FIRST]


def loop_forward():
    inputs = reachable()

    def solve():
        return np.array([cubic(*carriages) for carriages in inputs.tolist()])

    return solve, len(inputs), solve()[FIRST]


def bare_passes():
    """What any inverse kinematics on numpy must do at least: a sine, a cosine, two roots."""
    inputs = poses()
    y, theta = inputs[:, 1].copy(), inputs[:, 2].copy()
    out = np.empty((4, COUNT))

    def run():
        np.sin(theta, out=out[0])
        np.cos(theta, out=out[1])
        np.sqrt(y, out=out[2])
        np.sqrt(y, out=out[3])

    return run, COUNT, []


def cubic(q1, q2, q3):
    """Solve by Newton's method on the cubic in cos θ that the closure leaves."""
    distance, offset = q2 - q1, q1 + q2 - 2.0 * q3
    e = 0.25 * offset * offset
    constant = LENGTH * LENGTH - HALF * HALF - 0.25 * distance * distance
    c = 1.0
    for _ in range(20):
        value = ((HALF * distance * c + constant) * c - distance * (HALF + e / HALF)) * c + (
            e * (1.0 + distance * distance / (4.0 * HALF * HALF)) - constant)
        slope = (3.0 * HALF * distance * c + 2.0 * constant) * c - distance * (HALF + e / HALF)
        step = value / slope
        c -= step
        if abs(step) < 1e-12:
            break
    y = math.sqrt(constant - e + HALF * distance * c)
    return q3, y, math.asin(offset * (2.0 * HALF * c - distance) / (4.0 * HALF * y))


def numba_forward():
    import numba

    one = numba.njit(cubic)

    @numba.njit
    def solve(inputs):
        result = np.empty_like(inputs)
        for k in range(len(inputs)):
            x, y, theta = one(inputs[k, 0], inputs[k, 1], inputs[k, 2])
            result[k, 0], result[k, 1], result[k, 2] = x, y, theta
        return result

    inputs = reachable()
    return lambda: solve(inputs), len(inputs), solve(inputs)[FIRST]


def numba_inverse():
    import numba

    @numba.njit
    def solve(inputs):
        result, valid = np.empty_like(inputs), np.empty(len(inputs), np.bool_)
        for k in range(len(inputs)):
            x, y, theta = inputs[k, 0], inputs[k, 1], inputs[k, 2]
            rise, span = HALF * math.sin(theta), HALF * math.cos(theta)
            root1 = LENGTH * LENGTH - (y - rise) * (y - rise)
            root2 = LENGTH * LENGTH - (y + rise) * (y + rise)
            valid[k] = root1 > 0.0 and root2 > 0.0
            if valid[k]:
                result[k, 0] = x - span + math.sqrt(root1)
                result[k, 1] = x + span - math.sqrt(root2)
                result[k, 2] = x
            else:
                result[k] = math.nan
        return result, valid

    inputs = poses()
    return lambda: solve(inputs), COUNT, solve(inputs)[0][FIRST]


MAKERS = {
    'inverse: ours': ours_inverse, 'inverse: loop': loop_inverse,
    'inverse: bare passes': bare_passes, 'inverse: numba': numba_inverse,
    'forward: ours': ours_forward, 'forward: loop': loop_forward,
    'forward: numba': numba_forward,
}
for _count in (1, 10, 100, 1_000, 10_000, 1_000_000):
    MAKERS[f'inverse: ours, {_count}'] = lambda n=_count: ours_inverse(n)
    MAKERS[f'forward: ours, {_count}'] = lambda n=_count: ours_forward(n)
