"""One pose at a time: the package, plain math, numpy, and scipy's general solver."""

from __future__ import annotations

from functools import partial
import math

LENGTH, HALF = 0.352, 0.348
POSES = [
    (0.1 * math.sin(0.7 * k), 0.25 + 0.03 * math.sin(1.3 * k), 0.1 * math.sin(2.1 * k))
    for k in range(32)]
START = (0.0, 0.25, 0.0)


def inline(pose):
    """Solve on math as one writes it down, with the check of reach."""
    x, y, theta = pose
    rise, span = HALF * math.sin(theta), HALF * math.cos(theta)
    root1 = LENGTH * LENGTH - (y - rise) * (y - rise)
    root2 = LENGTH * LENGTH - (y + rise) * (y + rise)
    if root1 <= 0.0 or root2 <= 0.0:
        raise ValueError('out of reach')
    return x - span + math.sqrt(root1), x + span - math.sqrt(root2), x


CARRIAGES = [inline(pose) for pose in POSES]


def over(function, inputs):
    """Run a function over all inputs; its answer is that of the fourth."""
    def run():
        for one in inputs:
            function(one)

    return run, len(inputs), list(function(inputs[3]))


def ours_inverse():
    from facade_manipulator.kinematics import Geometry, inverse_kinematics, Pose

    geometry = Geometry()
    return over(partial(inverse_kinematics, geometry), [Pose(*p) for p in POSES])


def ours_forward():
    from facade_manipulator.kinematics import Carriages, forward_kinematics, Geometry

    geometry = Geometry()
    return over(partial(forward_kinematics, geometry), [Carriages(*q) for q in CARRIAGES])


def ours_jacobian():
    from facade_manipulator.kinematics import Geometry, jacobian, Pose

    geometry = Geometry()
    run, items, _ = over(partial(jacobian, geometry), [Pose(*p) for p in POSES])
    return run, items, jacobian(geometry, Pose(*POSES[3])).ravel()


def math_inverse():
    return over(inline, POSES)


def numpy_jacobian():
    """Differentiate by a function for many poses, asked for one."""
    import numpy as np

    def build(poses):
        _, y, theta = poses.T
        c, s = np.cos(theta), np.sin(theta)
        u1, u2 = y - HALF * s, y + HALF * s
        s1, s2 = np.sqrt(LENGTH ** 2 - u1 ** 2), np.sqrt(LENGTH ** 2 - u2 ** 2)
        matrices = np.zeros((len(poses), 3, 3))
        matrices[:, :, 0] = 1.0
        matrices[:, 0, 1] = -u1 / s1
        matrices[:, 1, 1] = u2 / s2
        matrices[:, 0, 2] = HALF * (u1 * c + s1 * s) / s1
        matrices[:, 1, 2] = HALF * (u2 * c - s2 * s) / s2
        return matrices

    poses = [np.array([pose]) for pose in POSES]
    run, items, _ = over(build, poses)
    return run, items, build(poses[3]).ravel()


def scipy_inverse():
    from scipy.optimize import root

    def solve(pose):
        x, y, theta = pose
        rise, span = HALF * math.sin(theta), HALF * math.cos(theta)

        def residual(q):
            return ((x - span - q[0]) ** 2 + (y - rise) ** 2 - LENGTH ** 2,
                    (x + span - q[1]) ** 2 + (y + rise) ** 2 - LENGTH ** 2)

        def slope(q):
            return ((-2.0 * (x - span - q[0]), 0.0), (0.0, -2.0 * (x + span - q[1])))

        q1, q2 = root(residual, (x - 0.1, x + 0.1), jac=slope, tol=1e-10).x
        return q1, q2, x

    return over(solve, POSES)


def scipy_forward():
    from scipy.optimize import root

    def solve(carriages):
        q1, q2, q3 = carriages

        def residual(u):
            rise, span = HALF * math.sin(u[1]), HALF * math.cos(u[1])
            return ((q3 - span - q1) ** 2 + (u[0] - rise) ** 2 - LENGTH ** 2,
                    (q3 + span - q2) ** 2 + (u[0] + rise) ** 2 - LENGTH ** 2)

        def slope(u):
            rise, span = HALF * math.sin(u[1]), HALF * math.cos(u[1])
            return ((2.0 * (u[0] - rise), 2.0 * (q3 - span - q1) * rise
                     - 2.0 * (u[0] - rise) * span),
                    (2.0 * (u[0] + rise), -2.0 * (q3 + span - q2) * rise
                     + 2.0 * (u[0] + rise) * span))

        y, theta = root(residual, START[1:], jac=slope, tol=1e-10).x
        return q3, y, theta

    return over(solve, CARRIAGES)


MAKERS = {
    'inverse: ours': ours_inverse, 'inverse: math': math_inverse,
    'inverse: scipy root': scipy_inverse,
    'forward: ours': ours_forward, 'forward: scipy root': scipy_forward,
    'jacobian: ours': ours_jacobian, 'jacobian: numpy': numpy_jacobian,
}
