"""One pose at a time: the package, plain math, numpy, and the general solvers."""

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


def ours_certify():
    from facade_manipulator.kinematics import certify, Geometry, Pose

    geometry = Geometry()
    return over(partial(certify, geometry), [Pose(*p) for p in POSES])


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


def numpy_inverse():
    """Solve by a function for many poses, asked for one."""
    import numpy as np

    def solve(poses):
        x, y, theta = poses.T
        rise, span = HALF * np.sin(theta), HALF * np.cos(theta)
        root1, root2 = LENGTH ** 2 - (y - rise) ** 2, LENGTH ** 2 - (y + rise) ** 2
        if (root1 <= 0.0).any() or (root2 <= 0.0).any():
            raise ValueError('out of reach')
        return np.stack([x - span + np.sqrt(root1), x + span - np.sqrt(root2), x], axis=-1)

    poses = [np.array([pose]) for pose in POSES]
    run, items, _ = over(solve, poses)
    return run, items, solve(poses[3])[0]


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


def casadi_solver(unknown_is_pose):
    """Newton's method on the closure by casadi, derivatives generated."""
    import casadi

    u, p = casadi.SX.sym('u', 2), casadi.SX.sym('p', 3)
    (q1, q2), (x, y, theta) = casadi.vertsplit(u), casadi.vertsplit(p)
    if unknown_is_pose:
        (y, theta), (q1, q2, x) = casadi.vertsplit(u), casadi.vertsplit(p)
    rise, span = HALF * casadi.sin(theta), HALF * casadi.cos(theta)
    closure = casadi.vertcat((x - span - q1) ** 2 + (y - rise) ** 2 - LENGTH ** 2,
                             (x + span - q2) ** 2 + (y + rise) ** 2 - LENGTH ** 2)
    return casadi.rootfinder('solve', 'newton', {'x': u, 'p': p, 'g': closure})


def casadi_inverse():
    solver = casadi_solver(False)

    def solve(pose):
        q = solver((pose[0] - 0.1, pose[0] + 0.1), pose).elements()
        return q[0], q[1], pose[0]

    return over(solve, POSES)


def casadi_forward():
    solver = casadi_solver(True)
    return over(lambda q: (q[2], *solver(START[1:], q).elements()), CARRIAGES)


def pinocchio_inverse():
    """Two legs, prismatic and revolute, whose tips Newton's method puts on the platform."""
    import numpy as np
    import pinocchio

    model, tips = pinocchio.Model(), []
    for side in (-1.0, 1.0):
        carriage = model.addJoint(
            0, pinocchio.JointModelPX(), pinocchio.SE3.Identity(), f'carriage{side}')
        link = model.addJoint(
            carriage, pinocchio.JointModelRZ(), pinocchio.SE3.Identity(), f'link{side}')
        tip = pinocchio.SE3(np.eye(3), np.array([LENGTH, 0.0, 0.0]))
        tips.append(model.addFrame(pinocchio.Frame(
            f'tip{side}', link, 0, tip, pinocchio.FrameType.OP_FRAME)))
    data = model.createData()
    start = np.array([-0.1, math.pi - 0.8, 0.1, 0.8])
    frame = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED

    def solve(pose):
        x, y, theta = pose
        rise, span = HALF * math.sin(theta), HALF * math.cos(theta)
        wanted = np.array([x - span, y - rise, x + span, y + rise])
        q, residual, slope = start + [x, 0.0, x, 0.0], np.empty(4), np.empty((4, 4))
        for _ in range(20):
            pinocchio.computeJointJacobians(model, data, q)
            for k, tip in enumerate(tips):
                rows = slice(2 * k, 2 * k + 2)
                residual[rows] = pinocchio.updateFramePlacement(
                    model, data, tip).translation[:2]
                slope[rows] = pinocchio.getFrameJacobian(model, data, tip, frame)[:2]
            residual -= wanted
            if abs(residual).max() < 1e-10:
                break
            q -= np.linalg.solve(slope, residual)
        return q[0], q[2], x

    return over(solve, POSES)


MECHANISM = f"""
<mujoco><option gravity="0 0 0"/><worldbody>
<body name="c1"><joint name="q1" type="slide" axis="1 0 0"/><geom size=".01"/>
 <body name="l1"><joint name="a1" axis="0 0 1"/><geom size=".01"/>
  <site name="t1" pos="{LENGTH} 0 0"/></body></body>
<body name="c2"><joint name="q2" type="slide" axis="1 0 0"/><geom size=".01"/>
 <body name="l2"><joint name="a2" axis="0 0 1"/><geom size=".01"/>
  <site name="t2" pos="{LENGTH} 0 0"/></body></body>
<body name="platform"><joint name="q3" type="slide" axis="1 0 0"/>
 <joint name="y" type="slide" axis="0 1 0"/><joint name="theta" axis="0 0 1"/><geom size=".01"/>
 <site name="p"/><site name="b1" pos="{-HALF} 0 0"/><site name="b2" pos="{HALF} 0 0"/></body>
</worldbody><equality>
<connect site1="t1" site2="b1"/><connect site1="t2" site2="b2"/></equality></mujoco>
"""


def mink_inverse():
    """Differential inverse kinematics until the head is there and the loops are closed."""
    import mink
    import mujoco
    import numpy as np

    model = mujoco.MjModel.from_xml_string(MECHANISM)
    head = mink.FrameTask('p', 'site', position_cost=1.0, orientation_cost=1.0)
    loops = mink.EqualityConstraintTask(model, cost=1.0)
    angle = math.asin(0.25 / LENGTH)
    reach = HALF - math.sqrt(LENGTH ** 2 - 0.25 ** 2)
    start = np.array([-reach, math.pi - angle, reach, angle, 0.0, 0.25, 0.0])

    def solve(pose):
        configuration = mink.Configuration(model, q=start)
        head.set_target(mink.SE3.from_rotation_and_translation(
            mink.SO3.from_z_radians(pose[2]), np.array([pose[0], pose[1], 0.0])))
        for _ in range(30):
            speed = mink.solve_ik(configuration, [head, loops], 1.0, 'daqp', damping=1e-12)
            configuration.integrate_inplace(speed, 1.0)
            if abs(speed).max() < 1e-8:
                break
        return configuration.q[0], configuration.q[2], configuration.q[4]

    return over(solve, POSES[:8])


MAKERS = {
    'inverse: ours': ours_inverse, 'inverse: ours, all limits': ours_certify,
    'inverse: math': math_inverse, 'inverse: numpy': numpy_inverse,
    'inverse: scipy root': scipy_inverse, 'inverse: casadi': casadi_inverse,
    'inverse: pinocchio': pinocchio_inverse, 'inverse: mink': mink_inverse,
    'forward: ours': ours_forward, 'forward: scipy root': scipy_forward,
    'forward: casadi': casadi_forward,
    'jacobian: ours': ours_jacobian, 'jacobian: numpy': numpy_jacobian,
}
