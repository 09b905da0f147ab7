"""robot_description and the joints of its tree, both published by ik_service."""

from __future__ import annotations

import math

from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from facade_manipulator import topics
from facade_manipulator.kinematics import Geometry, Mechanism, Pose, positions, tree, urdf
from facade_manipulator.nodes.conversions import stamp
from facade_manipulator.nodes.messages import Frames

PERIOD = 0.05  # s: robot_state_publisher publishes transforms at 20 Hz by default


class Description:
    """Publish the URDF of the mechanism once and its joints as they move."""

    def __init__(self, node: Node, geometry: Geometry) -> None:
        self._mechanism = Mechanism(geometry)
        self._names = [joint.name for joint in tree(geometry) if joint.name]
        node.create_publisher(*topics.ROBOT_DESCRIPTION).publish(
            String(data=urdf(geometry, Frames.of(node.get_namespace()).prefix)))
        self._states = node.create_publisher(*topics.MECHANISM_STATES)
        self._published = -math.inf

    def publish(self, time: float, head: Pose) -> None:
        """Publish the joints at a time [s] while a node subscribes, at most every `PERIOD`."""
        if abs(time - self._published) < PERIOD or not self._states.get_subscription_count():
            return
        self._published = time
        message = JointState(name=self._names, position=positions(self._mechanism, head))
        message.header.stamp = stamp(time)
        self._states.publish(message)
