"""robot_description and the joints of its tree: part of the ik_service node."""

from __future__ import annotations

import math

from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from facade_manipulator import interfaces
from facade_manipulator.kinematics import Geometry, mechanism_of, Pose, positions, tree, urdf
from facade_manipulator.ros.conversions import frames, stamp
from facade_manipulator.ros.interfaces import publisher

PERIOD = 0.05  # s: robot_state_publisher publishes transforms at 20 Hz by default


class Description:
    """Publish the URDF of the mechanism once and all its joints as they move."""

    def __init__(self, node: Node, geometry: Geometry) -> None:
        self._mechanism = mechanism_of(geometry)
        self._names = [joint.name for joint in tree(geometry) if joint.name]
        self._description = publisher(node, interfaces.ROBOT_DESCRIPTION)
        self._description.publish(String(data=urdf(geometry, frames(node).prefix)))
        self._states = publisher(node, interfaces.MECHANISM_STATES)
        self._published = -math.inf

    def publish(self, time: float, head: Pose) -> None:
        """Publish the joints at a time [s] while a node subscribes, at most every `PERIOD`."""
        if abs(time - self._published) < PERIOD or not self._states.get_subscription_count():
            return
        self._published = time
        message = JointState(name=self._names, position=positions(self._mechanism, head))
        message.header.stamp = stamp(time)
        self._states.publish(message)
