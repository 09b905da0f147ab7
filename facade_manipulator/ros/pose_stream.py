"""A topic on which poses are published hundreds of times a second."""

from __future__ import annotations

from collections.abc import Callable

from geometry_msgs.msg import PoseStamped
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile

from facade_manipulator.kinematics import Pose
from facade_manipulator.ros.codec import pose_codec
from facade_manipulator.ros.conversions import planar_numbers


class PoseStream:
    """Publish poses: to a node of the process by a call, on the topic if anybody subscribes."""

    def __init__(self, node: Node, topic: str, frame_id: str, qos: QoSProfile) -> None:
        self._codec = pose_codec(topic, frame_id)
        self._callback: Callable[[float, Pose], None] | None = None
        self._subscriptions = self._unused = 0
        self._publisher = node.create_publisher(
            PoseStamped, topic, qos,
            event_callbacks=PublisherEventCallbacks(matched=self._match))

    def _match(self, matched) -> None:
        self._subscriptions = matched.current_count

    def connect(self, callback: Callable[[float, Pose], None], subscribes: bool) -> None:
        """
        Call a node of the same process with the poses, past the middleware.

        Parameters
        ----------
        callback : callable
            Of the time of a pose [s] and the pose.
        subscribes : bool
            Whether the node subscribes to the topic as well, for poses from elsewhere: for this
            subscription alone nothing is published.

        """
        self._callback, self._unused = callback, int(subscribes)

    def publish(self, time: float, pose: Pose) -> None:
        """Publish a pose and its time [s]."""
        if self._callback is not None:
            self._callback(time, pose)
        if self._subscriptions > self._unused:
            self._publisher.publish(self._codec.write(time, planar_numbers(pose)))
