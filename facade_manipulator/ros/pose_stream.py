"""A topic of poses that is told hundreds of times a second."""

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
    """
    Tell poses to a neighbour in the same process at once, and on the topic if anybody listens.

    Parameters
    ----------
    node : rclpy.node.Node
    topic, frame_id : str
    qos : rclpy.qos.QoSProfile

    """

    def __init__(self, node: Node, topic: str, frame_id: str, qos: QoSProfile) -> None:
        self._wire = pose_codec(topic, frame_id)
        self._neighbour: Callable[[float, Pose], None] | None = None
        self._listeners = self._needless = 0
        self._publisher = node.create_publisher(
            PoseStamped, topic, qos,
            event_callbacks=PublisherEventCallbacks(matched=self._match))

    def _match(self, matched) -> None:
        self._listeners = matched.current_count

    def hand_to(self, neighbour: Callable[[float, Pose], None], subscribes: bool) -> None:
        """
        Hand the poses to a node of the same process, past the middleware.

        Parameters
        ----------
        neighbour : callable
            Takes the time of a pose [s] and the pose.
        subscribes : bool
            Whether it listens to the topic as well, for poses from elsewhere; for its sake alone
            nothing is published.

        """
        self._neighbour, self._needless = neighbour, int(subscribes)

    def tell(self, time: float, pose: Pose) -> None:
        """Tell a pose and its time [s]."""
        if self._neighbour is not None:
            self._neighbour(time, pose)
        if self._listeners > self._needless:
            self._publisher.publish(self._wire.write(time, planar_numbers(pose)))
