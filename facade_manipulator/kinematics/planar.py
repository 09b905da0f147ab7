"""Planar poses as elements of SE(2) and their motion states, with plain floats."""

from __future__ import annotations

import math
from typing import NamedTuple

from facade_manipulator.kinematics.geometry import Pose, Twist

MM = 1e3  # millimetres in a metre
# axes of a pose in diagnostics: name, factor from SI, unit
POSE_AXES = (
    ('x', MM, 'mm'),
    ('y', MM, 'mm'),
    ('theta', math.degrees(1.0), 'deg'),
)


def wrap_angle(theta: float) -> float:
    """Wrap an angle to [−π, π] [rad]."""
    return math.remainder(theta, math.tau)


def difference(a: Pose, b: Pose) -> Pose:
    """Return a − b for each axis, with θ wrapped [m, m, rad]."""
    return Pose(a.x - b.x, a.y - b.y, wrap_angle(a.theta - b.theta))


def add(a: Pose, b: Pose) -> Pose:
    """Return a + b for each axis, without wrapping θ [m, m, rad]."""
    return Pose(a.x + b.x, a.y + b.y, a.theta + b.theta)


def subtract(a: Pose, b: Pose) -> Pose:
    """Return a − b for each axis, without wrapping θ [m, m, rad]."""
    return Pose(a.x - b.x, a.y - b.y, a.theta - b.theta)


def compose(a: Pose, b: Pose) -> Pose:
    """
    Return the product a·b of two poses [m, m, rad].

    If `a` is the pose of a frame A in a frame F, and `b` is a pose in A, the product is `b` in F.

    The angles add without wrapping, so that a path of poses stays continuous.
    """
    cosine = math.cos(a.theta)
    sine = math.sin(a.theta)
    x = a.x + cosine * b.x - sine * b.y
    y = a.y + sine * b.x + cosine * b.y
    return Pose(x, y, a.theta + b.theta)


def relative(a: Pose, b: Pose) -> Pose:
    """Return pose `b` relative to pose `a`: ``compose(invert(a), b)`` [m, m, rad]."""
    cosine = math.cos(a.theta)
    sine = math.sin(a.theta)
    x = b.x - a.x
    y = b.y - a.y
    along = cosine * x + sine * y
    across = cosine * y - sine * x
    return Pose(along, across, b.theta - a.theta)


def invert(a: Pose) -> Pose:
    """Return the inverse of a pose [m, m, rad]: ``compose(invert(a), a)`` is the identity."""
    cosine = math.cos(a.theta)
    sine = math.sin(a.theta)
    x = -cosine * a.x - sine * a.y
    y = sine * a.x - cosine * a.y
    return Pose(x, y, -a.theta)


class MotionState(NamedTuple):
    """Motion state at one time: position [m, m, rad] and velocity [m/s, m/s, rad/s]."""

    position: Pose
    velocity: Twist

    def plus(self, other: MotionState) -> MotionState:
        """Return the sum of two motion states, component by component."""
        if other is ZERO_STATE:
            return self
        a = self.velocity
        b = other.velocity
        velocity = Twist(a.x + b.x, a.y + b.y, a.theta + b.theta)
        return MotionState(add(self.position, other.position), velocity)

    def minus(self, other: MotionState) -> MotionState:
        """Return the difference of two motion states, component by component."""
        a = self.velocity
        b = other.velocity
        velocity = Twist(a.x - b.x, a.y - b.y, a.theta - b.theta)
        return MotionState(subtract(self.position, other.position), velocity)


ZERO_POSE = Pose(0.0, 0.0, 0.0)  # m, m, rad
ZERO_TWIST = Twist(0.0, 0.0, 0.0)  # m/s, m/s, rad/s
ZERO_STATE = MotionState(ZERO_POSE, ZERO_TWIST)


def millimetres(pose: Pose) -> str:
    """Format a pose as text for the operator [mm, mm, deg]."""
    angle = math.degrees(pose.theta)
    return (
        f'x {1e3 * pose.x:+z.1f} mm, y {1e3 * pose.y:+z.1f} mm, theta {angle:+z.2f} deg'
    )
