"""Core values to messages."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.node import Node

from facade_manipulator.errors import LimitError, ManipulatorError
from facade_manipulator.kinematics import Pose, Wrench

LEVELS = {
    'ok': DiagnosticStatus.OK,
    'warn': DiagnosticStatus.WARN,
    'error': DiagnosticStatus.ERROR,
    'stale': DiagnosticStatus.STALE,
}


def node_time(node: Node) -> float:
    """Return the present time of a node's clock [s]."""
    # The clock's own now() makes objects of it, which takes four times as long. `handle` and
    # get_now() are undocumented; `run` looks whether they are there.
    return node.get_clock().handle.get_now().nanoseconds * 1e-9


def stamp(time: float) -> Time:
    """Return seconds since the epoch as a stamp."""
    message = Time()
    set_stamp(message, time)
    return message


def set_stamp(message: Time, time: float) -> None:
    """Set a stamp to seconds since the epoch."""
    message.sec, message.nanosec = stamp_numbers(time)


def stamp_numbers(time: float) -> tuple[int, int]:
    """Return the two numbers of a stamp, whole seconds and the nanoseconds after them."""
    sec = math.floor(time)
    return sec, int((time - sec) * 1e9)


def stamp_text(stamp: Time) -> str:
    """Return a stamp as a value of a diagnostic status, exact: seconds with nine decimals."""
    return f'{stamp.sec}.{stamp.nanosec:09d}'


def pose_message(pose: Pose) -> PoseMessage:
    """Return a planar pose as a message."""
    message = PoseMessage()
    set_planar_pose(message, pose)
    return message


def pose_stamped(frame_id: str, time: float, pose: Pose) -> PoseStamped:
    """Return a planar pose with frame and stamp [s]."""
    message = PoseStamped()
    message.header.frame_id = frame_id
    set_stamp(message.header.stamp, time)
    set_planar_pose(message.pose, pose)
    return message


def set_planar_pose(message: PoseMessage, pose: Pose) -> None:
    """Set what a planar pose has of a message."""
    position, q = message.position, message.orientation
    position.x, position.y, _, _, _, q.z, q.w = map(float, planar_numbers(pose))


def planar_numbers(pose: Pose) -> tuple[float, ...]:
    """Return the seven numbers of a planar pose, position [m] and quaternion."""
    half = 0.5 * pose.theta
    return pose.x, pose.y, 0.0, 0.0, 0.0, math.sin(half), math.cos(half)


def wrench_stamped(frame_id: str, time: float, wrench: Wrench) -> WrenchStamped:
    """Return a planar wrench with frame and stamp [s]."""
    message = WrenchStamped()
    message.header.frame_id = frame_id
    message.header.stamp = stamp(time)
    message.wrench.force.x, message.wrench.force.y = wrench.fx, wrench.fy
    message.wrench.torque.z = wrench.mz
    return message


def diagnostic_status(
    name: str, level: str, message: str, values: Mapping[str, Any], hardware_id: str = ''
) -> DiagnosticStatus:
    """Return one component's status; `level` is a key of `LEVELS`."""
    return DiagnosticStatus(
        name=name, level=LEVELS[level], message=message, hardware_id=hardware_id,
        values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()])


def rejection_status(name: str, error: ManipulatorError, goal_stamp: Time) -> DiagnosticStatus:
    """Return why a request with a goal is rejected: stamp of the goal, reason, limit."""
    values = {'goal stamp': stamp_text(goal_stamp), 'reason': getattr(error, 'reason', 'other')}
    if isinstance(error, LimitError):
        values.update(
            {key: getattr(error, key) for key in ('quantity', 'value', 'bound', 'unit')})
    return diagnostic_status(name, 'error', str(error), values)


def _text(value: Any) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
