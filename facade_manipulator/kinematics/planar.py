"""The group SE(2) of planar poses, and states of motion in it, on plain floats."""

from __future__ import annotations

import math
from typing import NamedTuple

from facade_manipulator.kinematics.geometry import Pose, Twist

# axes of a pose as diagnostics show them: name, factor from SI, unit
POSE_AXES = (('x', 1e3, 'mm'), ('y', 1e3, 'mm'), ('theta', math.degrees(1.0), 'deg'))


def wrap_angle(theta: float) -> float:
    """Wrap an angle to [−π, π]."""
    return math.remainder(theta, math.tau)


def difference(a: Pose, b: Pose) -> Pose:
    """Return a less b, axis by axis: no pose of one in the frame of the other; θ is wrapped."""
    return Pose(a.x - b.x, a.y - b.y, wrap_angle(a.theta - b.theta))


def add(a: Pose, b: Pose) -> Pose:
    """Return the sum axis by axis, θ without wrapping: a pose and an offset from it."""
    return Pose(a.x + b.x, a.y + b.y, a.theta + b.theta)


def subtract(a: Pose, b: Pose) -> Pose:
    """Return the offset of a from b axis by axis, θ without wrapping."""
    return Pose(a.x - b.x, a.y - b.y, a.theta - b.theta)


def compose(a: Pose, b: Pose) -> Pose:
    """
    Compose two poses: the pose `b`, given in the frame whose pose is `a`.

    The angles add without wrapping, so that a path of poses stays continuous.
    """
    cosine, sine = math.cos(a.theta), math.sin(a.theta)
    return Pose(
        a.x + cosine * b.x - sine * b.y,
        a.y + sine * b.x + cosine * b.y,
        a.theta + b.theta,
    )


def relative(a: Pose, b: Pose) -> Pose:
    """Return the pose `b` as seen from `a`: ``compose(invert(a), b)``."""
    cosine, sine = math.cos(a.theta), math.sin(a.theta)
    x, y = b.x - a.x, b.y - a.y
    return Pose(cosine * x + sine * y, cosine * y - sine * x, b.theta - a.theta)


def invert(a: Pose) -> Pose:
    """Invert a pose: ``compose(invert(a), a)`` is the identity."""
    cosine, sine = math.cos(a.theta), math.sin(a.theta)
    return Pose(-cosine * a.x - sine * a.y, sine * a.x - cosine * a.y, -a.theta)


class MotionState(NamedTuple):
    """A state of motion: position [m, m, rad] and velocity [m/s, m/s, rad/s] at one instant."""

    position: Pose
    velocity: Twist

    def plus(self, other: MotionState) -> MotionState:
        """Return the sum, component by component."""
        if other is ZERO_STATE:
            return self
        a, b = self.velocity, other.velocity
        return MotionState(add(self.position, other.position),
                           Twist(a.x + b.x, a.y + b.y, a.theta + b.theta))

    def minus(self, other: MotionState) -> MotionState:
        """Return the difference, component by component."""
        a, b = self.velocity, other.velocity
        return MotionState(subtract(self.position, other.position),
                           Twist(a.x - b.x, a.y - b.y, a.theta - b.theta))


ZERO_POSE = Pose(0.0, 0.0, 0.0)  # m, m, rad
ZERO_TWIST = Twist(0.0, 0.0, 0.0)  # m/s, m/s, rad/s
ZERO_STATE = MotionState(ZERO_POSE, ZERO_TWIST)


def millimetres(pose: Pose) -> str:
    """Return a pose as text for an operator [mm, mm, deg]."""
    return (f'x {1e3 * pose.x:+.1f} mm, y {1e3 * pose.y:+.1f} mm, '
            f'theta {math.degrees(pose.theta):+.2f} deg')
