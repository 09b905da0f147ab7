"""Messages as the black box reads them from a file."""

from __future__ import annotations

import math
from types import SimpleNamespace as Message

from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import planar_numbers


def header(time: float) -> Message:
    """Return a header with a stamp [s]."""
    return Message(stamp=Message(sec=math.floor(time), nanosec=round(1e9 * (time % 1.0))))


def pose(at: Pose) -> Message:
    """Return a pose in the plane."""
    *position, qx, qy, qz, qw = planar_numbers(at)
    return Message(position=Message(**dict(zip('xyz', position, strict=True))),
                   orientation=Message(x=qx, y=qy, z=qz, w=qw))


def pose_message(time: float, at: Pose) -> Message:
    """Return a pose with a stamp [s]."""
    return Message(header=header(time), pose=pose(at))


def estimate(time: float, at: Pose, covariance=(0.0,) * 36) -> Message:
    """Return a pose with a stamp [s] and a covariance."""
    return Message(header=header(time), pose=Message(pose=pose(at), covariance=covariance))
