"""ROS times, timers and messages for the planar quantities of this package."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
import math
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped, TransformStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from facade_manipulator import topics
from facade_manipulator.canopen.clock import Clock as Clocks
from facade_manipulator.canopen.clock import SteadyTime
from facade_manipulator.kinematics import (
    Geometry,
    Mechanism,
    Pose,
    positions,
    tree,
    urdf,
)
from facade_manipulator.kinematics.geometry import AXIS_NAMES, PerCarriage
from facade_manipulator.nodes.planar_messages import Frames, seconds

_CLOCKS = Clocks()
_STEADY_TIME = SteadyTime(_CLOCKS)


def ros_time() -> float:
    """Return the present time of the system clock [s]; nodes reject `use_sim_time`."""
    return _CLOCKS.time()


def steady_seconds(stamp: Any) -> float:
    """Convert a stamp to a time on the monotonic clock [s]; the system clock may be set."""
    return _STEADY_TIME.from_stamp(seconds(stamp))


def system_time(time: float) -> float:
    """Convert a time on the monotonic clock [s] to a time on the system clock [s]."""
    return _STEADY_TIME.to_stamp(time)


def steady_timer(
    node: Node, period: float, callback: Callable[[], Any], **options: Any
) -> Timer:
    """
    Create a timer with a period [s] on the monotonic clock.

    A timer on the node's clock would stop while the system clock is set back.
    """
    return node.create_timer(
        period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME), **options
    )


def fill_stamp(message: Time, time: float) -> Time:
    """Write a time since the epoch [s] into an existing stamp."""
    message.sec = math.floor(time)
    message.nanosec = int((time - message.sec) * 1e9)
    return message


def stamp(time: float) -> Time:
    """Convert a time since the epoch [s] to a stamp."""
    return fill_stamp(Time(), time)


def fill_pose(message: PoseMessage, pose: Pose) -> PoseMessage:
    """Write a planar pose [m, m, rad] into an existing message; creating a message costs 10 us."""
    message.position.x, message.position.y = float(pose.x), float(pose.y)
    message.orientation.z = math.sin(0.5 * pose.theta)
    message.orientation.w = math.cos(0.5 * pose.theta)
    return message


def pose_message(pose: Pose) -> PoseMessage:
    """Convert a planar pose [m, m, rad] to a message."""
    return fill_pose(PoseMessage(), pose)


def pose_stamped(
    frame_id: str, time: float, pose: Pose, message: PoseStamped | None = None
) -> PoseStamped:
    """Return a message with frame, stamp [s] and planar pose; a new message costs 20 us."""
    message = message or PoseStamped()
    message.header.frame_id = frame_id
    fill_stamp(message.header.stamp, time)
    fill_pose(message.pose, pose)
    return message


def joint_state(
    time: float,
    position: PerCarriage,
    velocity: PerCarriage,
    effort: PerCarriage | tuple[()] = (),
    message: JointState | None = None,
) -> JointState:
    """Return a message with positions [m], velocities [m/s] and forces [N], new or given."""
    message = message or JointState(name=AXIS_NAMES)
    fill_stamp(message.header.stamp, time)
    message.position, message.velocity, message.effort = position, velocity, effort
    return message


class FacadeTransform:
    """Broadcaster of the disturbance (facade → rail) on /tf, if tf2_msgs is installed."""

    def __init__(self, node: Node) -> None:
        self._frames = Frames.of(node.get_namespace())
        self._publisher: Any = None
        with suppress(ImportError):
            self._message = import_module('tf2_msgs.msg').TFMessage
            self._publisher = node.create_publisher(self._message, '/tf', 100)

    @property
    def is_subscribed(self) -> bool:
        """Return whether a node subscribes to /tf."""
        return bool(self._publisher and self._publisher.get_subscription_count())

    def publish(self, time: float, rail: Pose | None) -> None:
        """
        Broadcast the pose of `rail` in `facade` at a time [s], if the pose is known.

        The caller has checked `is_subscribed`.
        """
        if rail is None:
            return
        place = pose_message(rail)
        transform = TransformStamped()
        transform.header.frame_id, transform.header.stamp = (
            self._frames.facade,
            stamp(time),
        )
        transform.child_frame_id = self._frames.rail
        transform.transform.translation.x = place.position.x
        transform.transform.translation.y = place.position.y
        transform.transform.rotation = place.orientation
        self._publisher.publish(self._message(transforms=[transform]))


class Description:
    """Publisher of the mechanism's URDF and of its joint positions."""

    # s: robot_state_publisher publishes transforms at 20 Hz by default
    JOINTS_PERIOD = 0.05

    def __init__(self, node: Node, geometry: Geometry) -> None:
        self._mechanism = Mechanism(geometry)
        self._names = [joint.name for joint in tree(geometry) if joint.name]
        node.create_publisher(*topics.ROBOT_DESCRIPTION).publish(
            String(data=urdf(geometry, Frames.of(node.get_namespace()).prefix))
        )
        self._states = node.create_publisher(*topics.MECHANISM_STATES)
        self._published = -math.inf

    def publish(self, time: float, head: Pose) -> None:
        """Publish joint positions at a time [s], once per `JOINTS_PERIOD` if a node subscribes."""
        is_early = abs(time - self._published) < self.JOINTS_PERIOD
        if is_early or not self._states.get_subscription_count():
            return
        self._published = time
        message = JointState(
            name=self._names, position=positions(self._mechanism, head)
        )
        message.header.stamp = stamp(time)
        self._states.publish(message)
