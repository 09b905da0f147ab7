"""robot_description and the joints of its tree: part of the ik_service node."""

from __future__ import annotations

import math

from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from facade_manipulator import interfaces, ros
from facade_manipulator.kinematics import Geometry, mechanism_of, Pose, positions, tree, urdf

PERIOD = 0.05  # s: for eyes and plans; a set of transforms takes 0.45 ms


class Description:
    """Publish the mechanism for other programs: its URDF once, its joints as they move."""

    def __init__(self, node: Node, geometry: Geometry) -> None:
        self._mechanism, self._tree = mechanism_of(geometry), tree(geometry)
        self._names = [joint.name for joint in self._tree if joint.name]
        self._description = ros.publisher(node, interfaces.ROBOT_DESCRIPTION)
        self._description.publish(String(data=urdf(geometry, ros.frames(node).prefix)))
        self._transforms = ros.Transforms(node)
        self._states = ros.publisher(node, interfaces.MECHANISM_STATES)
        self._published = -math.inf

    def publish(self, time: float, head: Pose) -> None:
        """Publish the joints at a time [s], while somebody wants them and not too often."""
        if abs(time - self._published) < PERIOD:
            return
        is_wanted = self._states.get_subscription_count() > 0
        if not (is_wanted or self._transforms.is_wanted):
            return
        self._published = time
        at = positions(self._mechanism, head)
        self._transforms.publish(time, (
            (joint.parent, joint.child, joint.pose(position))
            for joint, position in zip(self._tree, at, strict=True)))
        if is_wanted:
            message = JointState(name=self._names, position=at[:len(self._names)])
            message.header.stamp = ros.stamp(time)
            self._states.publish(message)
