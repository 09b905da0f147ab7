"""Transforms for RViz and others, where tf2_ros is installed; no wheel has it."""

from __future__ import annotations

from importlib import import_module

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node

from facade_manipulator.kinematics import Pose
from facade_manipulator.ros.conversions import pose_message, stamp


class Transforms:
    """
    Broadcast where one frame is in another, with the node's namespace before their names.

    Parameters
    ----------
    node : rclpy.node.Node
    parent, child : str

    """

    def __init__(self, node: Node, parent: str, child: str) -> None:
        prefix = f'{node.get_namespace().strip("/")}/'.lstrip('/')
        self._parent, self._child = prefix + parent, prefix + child
        try:
            self._broadcaster = import_module('tf2_ros').TransformBroadcaster(node)
        except ImportError:
            self._broadcaster = None

    def publish(self, time: float, pose: Pose) -> None:
        """Broadcast the pose of the child in the parent at a time [s]."""
        if self._broadcaster is None:
            return
        message, place = TransformStamped(child_frame_id=self._child), pose_message(pose)
        message.header.frame_id, message.header.stamp = self._parent, stamp(time)
        translation, position = message.transform.translation, place.position
        translation.x, translation.y = position.x, position.y
        message.transform.rotation = place.orientation
        self._broadcaster.sendTransform(message)
