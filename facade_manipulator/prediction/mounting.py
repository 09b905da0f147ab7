"""
Where the estimator is mounted: its own displacement and yaw, and those of the rail.

An estimator publishes how far its own place has moved from where it rests, along the axes of
`facade`, and its own yaw. Mounted at m on the rail and turned by an angle, it moves with the
rail's pose d by d.xy + R(d.theta) m - m, and its yaw is d.theta plus that angle.
"""

from __future__ import annotations

from math import cos, sin

from facade_manipulator.kinematics import Pose


def estimator_motion(rail: Pose, mounting: Pose) -> Pose:
    """Return what an estimator on a mounting publishes of the rail's pose, without errors."""
    x, y = _swing(rail.theta, mounting)
    return Pose(rail.x + x, rail.y + y, rail.theta + mounting.theta)


def rail_pose(published: Pose, mounting: Pose) -> Pose:
    """Return the rail's pose of what an estimator on a mounting publishes."""
    theta = published.theta - mounting.theta
    x, y = _swing(theta, mounting)
    return Pose(published.x - x, published.y - y, theta)


def _swing(theta: float, mounting: Pose) -> tuple[float, float]:
    """Return R(theta) m - m: how far a turn of the rail moves the estimator."""
    cosine, sine = cos(theta) - 1.0, sin(theta)
    return (cosine * mounting.x - sine * mounting.y, sine * mounting.x + cosine * mounting.y)
