"""
Where the estimator is mounted: its own displacement and yaw, and those of the rail.

An estimator publishes how far its own place has moved from where it rests, along axes that are
turned from those of `facade` by an angle, and its own yaw. Mounted at m on the rail and turned
there, it moves with the rail's pose d by d.xy + R(d.theta) m - m, and its yaw is d.theta plus that
of the mounting.
"""

from __future__ import annotations

from math import cos, sin

from facade_manipulator.kinematics import Pose


def estimator_motion(rail: Pose, mounting: Pose, axes: float = 0.0) -> Pose:
    """Return what an estimator on a mounting publishes of the rail's pose, without errors."""
    x, y = _swing(rail.theta, mounting)
    return Pose(*turned(rail.x + x, rail.y + y, -axes), rail.theta + mounting.theta)


def rail_pose(published: Pose, mounting: Pose, axes: float = 0.0) -> Pose:
    """Return the rail's pose of what an estimator on a mounting publishes."""
    theta = published.theta - mounting.theta
    x, y = _swing(theta, mounting)
    moved_x, moved_y = turned(published.x, published.y, axes)
    return Pose(moved_x - x, moved_y - y, theta)


def _swing(theta: float, mounting: Pose) -> tuple[float, float]:
    """Return R(theta) m - m: how far a turn of the rail moves the estimator."""
    cosine, sine = cos(theta) - 1.0, sin(theta)
    return (cosine * mounting.x - sine * mounting.y, sine * mounting.x + cosine * mounting.y)


def turned(x: float, y: float, angle: float) -> tuple[float, float]:
    """Return a vector turned by an angle."""
    cosine, sine = cos(angle), sin(angle)
    return cosine * x - sine * y, sine * x + cosine * y
