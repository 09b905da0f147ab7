"""Times and poses as ROS has them: messages, the topics of a stream, transforms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped, TransformStamped, WrenchStamped
from rclpy.node import Node

from facade_manipulator import interfaces
from facade_manipulator.interfaces import Topic
from facade_manipulator.kinematics import Pose, Wrench
from facade_manipulator.messages import Frames, planar_numbers, stamp_numbers
from facade_manipulator.ros.codec import pose_codec
from facade_manipulator.ros.interfaces import class_of, is_installed, publisher


def frames(node: Node) -> Frames:
    """Return the frames of the manipulator in a node's namespace."""
    return Frames.of(node.get_namespace())


def node_time(node: Node) -> float:
    """Return the present time of a node's clock [s]."""
    # The clock's own now() makes objects of it, which takes four times as long. `handle` and
    # get_now() are undocumented; `run` looks whether they are there.
    return node.get_clock().handle.get_now().nanoseconds * 1e-9


def stamp(time: float) -> Time:
    """Return seconds since the epoch as a stamp."""
    sec, nanosec = stamp_numbers(time)
    return Time(sec=sec, nanosec=nanosec)


def pose_message(pose: Pose) -> PoseMessage:
    """Return a planar pose as a message."""
    message = PoseMessage()
    position, q = message.position, message.orientation
    position.x, position.y, _, _, _, q.z, q.w = map(float, planar_numbers(pose))
    return message


def pose_stamped(frame_id: str, time: float, pose: Pose) -> PoseStamped:
    """Return a planar pose with frame and stamp [s]."""
    message = PoseStamped(pose=pose_message(pose))
    message.header.frame_id, message.header.stamp = frame_id, stamp(time)
    return message


def wrench_stamped(frame_id: str, time: float, wrench: Wrench) -> WrenchStamped:
    """Return a planar wrench with frame and stamp [s]."""
    message = WrenchStamped()
    message.header.frame_id, message.header.stamp = frame_id, stamp(time)
    message.wrench.force.x, message.wrench.force.y = wrench.fx, wrench.fy
    message.wrench.torque.z = wrench.mz
    return message


class PoseStream:
    """Publish poses: to a node of the process by a call, on the topic if anybody subscribes."""

    def __init__(self, node: Node, topic: Topic, frame_id: str) -> None:
        self._codec = pose_codec(topic.name, frame_id)
        self._callback: Callable[[float, Pose], None] | None = None
        self._subscriptions = self._unused = 0
        self._publisher = publisher(node, topic, self._match)

    def _match(self, matched: Any) -> None:
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


class Transforms:
    """Broadcast the pose of a frame where tf2_msgs is installed, while a node subscribes."""

    def __init__(self, node: Node) -> None:
        self._prefix = frames(node).prefix
        self.is_wanted = False
        if is_installed(interfaces.TF):
            self._message = class_of(interfaces.TF)
            self._publisher = publisher(node, interfaces.TF, self._match)

    def _match(self, matched: Any) -> None:
        self.is_wanted = matched.current_count > 0

    def publish(self, time: float, parent: str, child: str, pose: Pose) -> None:
        """Broadcast the pose of a child frame in its parent frame at a time [s]."""
        if self.is_wanted:
            transform = self._transform(time, parent, child, pose)
            self._publisher.publish(self._message(transforms=[transform]))

    def _transform(self, time: float, parent: str, child: str, pose: Pose) -> TransformStamped:
        message, place = TransformStamped(child_frame_id=self._prefix + child), pose_message(pose)
        message.header.frame_id, message.header.stamp = self._prefix + parent, stamp(time)
        translation, position = message.transform.translation, place.position
        translation.x, translation.y = position.x, position.y
        message.transform.rotation = place.orientation
        return message
