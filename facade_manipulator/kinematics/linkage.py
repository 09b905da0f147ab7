"""Where the joints of the mechanism are at a pose: what a drawing needs."""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

from facade_manipulator.kinematics.geometry import Geometry, Pose
from facade_manipulator.kinematics.inverse import inverse_kinematics

Point = tuple[float, float]


class JointPoints(NamedTuple):
    """
    JointPoints in frame `rail`, each (x, y) [m].

    A1, A2 and A3 stand on the carriages, the links run from A1 to B1 and from A2 to B2, and the
    end-effector point P, the middle of the platform from B1 to B2, slides above A3.
    """

    a1: Point
    a2: Point
    a3: Point
    b1: Point
    b2: Point
    p: Point


def joints(geometry: Geometry, pose: Pose) -> JointPoints:
    """
    Return the joints of the mechanism at a pose.

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    """
    q1, q2, q3 = inverse_kinematics(geometry, pose)
    along = geometry.platform_half_length * cos(pose.theta)
    out = geometry.platform_half_length * sin(pose.theta)
    return JointPoints(
        (q1, 0.0), (q2, 0.0), (q3, 0.0),
        (pose.x - along, pose.y - out), (pose.x + along, pose.y + out), (pose.x, pose.y))
