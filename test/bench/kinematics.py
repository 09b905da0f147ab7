"""K1: one pose at a time, compared with inline math, numpy and scipy's general solver."""

from collections import deque
from functools import partial
import math
import time
from timeit import timeit

import numpy as np
from rows import in_turns, row
from scipy.optimize import root

from facade_manipulator import kinematics
from facade_manipulator.kinematics import Carriages, Geometry, Pose

L = 0.352
B = 0.348


def sample(k):
    """Return a pose of a path through the workspace."""
    y = 0.25 + 0.03 * math.sin(1.3 * k)
    return Pose(0.1 * math.sin(0.7 * k), y, 0.1 * math.sin(2.1 * k))


POSES = [sample(k) for k in range(32)]


def inline_inverse(pose):
    x, y, theta = pose
    rise = B * math.sin(theta)
    span = B * math.cos(theta)
    root1 = L * L - (y - rise) * (y - rise)
    root2 = L * L - (y + rise) * (y + rise)
    if root1 <= 0.0 or root2 <= 0.0:
        raise ValueError('out of reach')
    return x - span + math.sqrt(root1), x + span - math.sqrt(root2), x


def errors(q1, q2, x, y, theta):
    """Return the errors of both links' squared lengths [m²]."""
    rise = B * math.sin(theta)
    span = B * math.cos(theta)
    error_1 = (x - span - q1) ** 2 + (y - rise) ** 2 - L * L
    error_2 = (x + span - q2) ** 2 + (y + rise) ** 2 - L * L
    return error_1, error_2


def scipy_inverse(pose):
    x, _, theta = pose
    span = B * math.cos(theta)

    def slopes(q):
        return (-2.0 * (x - span - q[0]), 0.0), (0.0, -2.0 * (x + span - q[1]))

    start = (x - 0.1, x + 0.1)
    found = root(lambda q: errors(*q, *pose), start, tol=1e-10, jac=slopes)
    q1, q2 = found.x
    return q1, q2, x


def scipy_forward(carriages):
    q1, q2, q3 = carriages

    def slopes(u):
        rise = B * math.sin(u[1])
        span = B * math.cos(u[1])
        by_theta_1 = 2.0 * (q3 - q1) * rise - 2.0 * u[0] * span
        by_theta_2 = 2.0 * (q2 - q3) * rise + 2.0 * u[0] * span
        return (2.0 * (u[0] - rise), by_theta_1), (2.0 * (u[0] + rise), by_theta_2)

    start = (0.25, 0.0)
    found = root(lambda u: errors(q1, q2, q3, *u), start, jac=slopes, tol=1e-10)
    y, theta = found.x
    return q3, y, theta


def numpy_jacobian(poses):
    """Return the Jacobians of many poses, shape (n, 3, 3)."""
    _, y, theta = poses.T
    c = np.cos(theta)
    s = np.sin(theta)
    u1 = y - B * s
    u2 = y + B * s
    s1 = np.sqrt(L * L - u1**2)
    s2 = np.sqrt(L * L - u2**2)
    one = np.ones(len(poses))
    zero = np.zeros(len(poses))
    row_1 = [one, -u1 / s1, B * (u1 * c + s1 * s) / s1]
    row_2 = [one, u2 / s2, B * (u2 * c - s2 * s) / s2]
    return np.array([row_1, row_2, [one, zero, zero]]).transpose(2, 0, 1)


def timed(function, inputs, duration):
    """Return a function that measures the processor time of one call during some time [s]."""

    def call_all():
        deque(map(function, inputs), 0)

    run = partial(timeit, call_all, timer=time.process_time)
    calls = math.ceil(10 * duration / run(number=10))
    return lambda _: (run(number=calls) / calls / len(inputs),)


def rows(quick):
    """Compare each solution with its competitors, which must agree with it."""
    inverse = partial(kinematics.inverse_kinematics, Geometry())
    forward = partial(kinematics.forward_kinematics, Geometry())
    jacobian = partial(kinematics.jacobian, Geometry())
    joints = [Carriages(*inline_inverse(pose)) for pose in POSES]
    arrays = [np.array([pose]) for pose in POSES]
    for name, goal, ours, inputs, theirs, others in (
        (
            'inverse with checks / inline math',
            '<= 2.5',
            inverse,
            POSES,
            inline_inverse,
            POSES,
        ),
        (
            'inverse with checks / scipy root',
            '>= 40',
            inverse,
            POSES,
            scipy_inverse,
            POSES,
        ),
        ('forward / scipy root', '>= 15', forward, joints, scipy_forward, joints),
        ('Jacobian / numpy', '>= 12', jacobian, POSES, numpy_jacobian, arrays),
    ):
        for one, other in zip(inputs, others, strict=True):
            np.testing.assert_allclose(ours(one), np.squeeze(theirs(other)), atol=1e-6)
        duration = 0.02 if quick else 0.15
        contenders = [timed(ours, inputs, duration), timed(theirs, others, duration)]
        (our_time,), (their_time,) = in_turns(contenders, 3 if quick else 9)
        yield row(f'K1 {name}', 'us', goal, our_time, their_time)
