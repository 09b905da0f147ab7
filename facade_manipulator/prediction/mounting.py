"""
Where the estimator is mounted: its own displacement and yaw, and those of the rail.

An estimator publishes how far its own place has moved from where it rests, along axes that are
turned from those of `facade` by an angle, and its own yaw. Mounted at m on the rail and turned
there, it moves with the rail's pose d by d.xy + R(d.theta) m - m, and its yaw is d.theta plus that
of the mounting.
"""

from __future__ import annotations

from math import cos, sin

from facade_manipulator.kinematics import compose, invert, Pose


def estimator_motion(rail: Pose, mounting: Pose, axes: float = 0.0) -> Pose:
    """Return what an estimator on a mounting publishes of the rail's pose, without errors."""
    place = compose(rail, mounting)
    return Pose(*turned(place.x - mounting.x, place.y - mounting.y, -axes), place.theta)


def rail_pose(published: Pose, mounting: Pose, axes: float = 0.0) -> Pose:
    """Return the rail's pose of what an estimator on a mounting publishes."""
    x, y = turned(published.x, published.y, axes)
    return compose(Pose(x + mounting.x, y + mounting.y, published.theta), invert(mounting))


def turned(x: float, y: float, angle: float) -> tuple[float, float]:
    """Return a vector turned by an angle."""
    cosine, sine = cos(angle), sin(angle)
    return cosine * x - sine * y, sine * x + cosine * y
