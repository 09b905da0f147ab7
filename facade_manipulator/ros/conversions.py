"""Messages to core values and back; what is not a planar pose is rejected here, with a message."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from reprlib import repr as quoted  # a message stays short, whatever is sent
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.node import Node

from facade_manipulator.errors import InputError, LimitError, ManipulatorError
from facade_manipulator.kinematics import Carriages, Pose, wrap_angle, Wrench

PLANE_TOLERANCE = 1e-6  # m
TILT_TOLERANCE = 1e-3  # rad
NORM_TOLERANCE = 1e-3  # quaternions are often sent rounded
CARRIAGES = Carriages._fields
POSE_NUMBERS = (
    'x', 'y', 'z', 'orientation.x', 'orientation.y', 'orientation.z', 'orientation.w')
FACADE, RAIL, END_EFFECTOR = 'facade', 'rail', 'end_effector'  # the frames' names
VARIANCES = (0, 7, 35)  # of x, y and yaw among the 36 of a pose's covariance

LEVELS = {
    'ok': DiagnosticStatus.OK,
    'warn': DiagnosticStatus.WARN,
    'error': DiagnosticStatus.ERROR,
    'stale': DiagnosticStatus.STALE,
}


def seconds(stamp: Time) -> float:
    """Return a stamp in seconds; float64 resolves 0.24 µs at today's epoch."""
    return stamp.sec + stamp.nanosec * 1e-9


def node_time(node: Node) -> float:
    """Return the present time of a node's clock [s]."""
    # The clock's own now() makes objects of it, which takes four times as long. `handle` and
    # get_now() are undocumented (tried on rclpy 7.1.6); without them every node ends at start.
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


def require_frame(frame_id: str, expected: str, what: str) -> None:
    """
    Reject a message of another frame.

    Raises
    ------
    InputError
        With reason ``'frame'``.

    """
    if frame_id != expected:
        raise InputError('frame', f"{what} is in frame {quoted(frame_id)}, expected '{expected}'")


def planar_pose(message: PoseMessage, what: str) -> Pose:
    """
    Return the planar pose of a message.

    Parameters
    ----------
    message : geometry_msgs.msg.Pose
        Position in m, unit quaternion; in the plane, so z = 0 and roll = pitch = 0.
    what : str
        Name of the message in the message of a rejection, such as ``'goal'``.

    Raises
    ------
    InputError
        With reason ``'not_finite'``, ``'quaternion'`` or ``'out_of_plane'``.

    """
    return planar(pose_numbers(message), what)


def pose_numbers(message: PoseMessage) -> tuple[float, ...]:
    """Return the seven numbers of a pose, position [m] and quaternion."""
    position, q = message.position, message.orientation
    return position.x, position.y, position.z, q.x, q.y, q.z, q.w


def planar(numbers: Sequence[float], what: str) -> Pose:
    """Return the planar pose of the seven numbers of a pose; else as `planar_pose`."""
    require_finite(POSE_NUMBERS, numbers, what)
    x, y, z, *q = numbers
    _require_planar(z, *q, what)
    return Pose(x, y, _yaw(*q[2:]))


def require_finite(names: Sequence[str], values: Sequence[float], what: str) -> None:
    """
    Reject what is no number.

    Raises
    ------
    InputError
        With reason ``'not_finite'``.

    """
    if all(map(math.isfinite, values)):
        return
    for name, value in zip(names, values, strict=True):
        if not math.isfinite(value):
            raise InputError.not_finite(f'{what} {name}', value)


def _require_planar(z: float, qx: float, qy: float, qz: float, qw: float, what: str) -> None:
    norm = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if abs(norm - 1.0) > NORM_TOLERANCE:
        raise InputError(
            'quaternion',
            f'{what} orientation has norm {norm:.6g}, not 1 within {NORM_TOLERANCE:g}')
    if abs(z) > PLANE_TOLERANCE:
        raise InputError(
            'out_of_plane', f'{what} z = {z:.6g} m is out of the plane z = 0 m')
    tilt = 2.0 * math.hypot(qx, qy)
    if tilt > TILT_TOLERANCE:
        raise InputError(
            'out_of_plane',
            f'{what} is tilted by {tilt:.6g} rad out of the plane, bound {TILT_TOLERANCE:g} rad')


def _yaw(qz: float, qw: float) -> float:
    return wrap_angle(2.0 * math.atan2(qz, qw))


def carriages_from(
    names: Sequence[str], values: Sequence[float], what: str
) -> tuple[float, float, float]:
    """
    Return the values of q1, q2 and q3, whatever their order in a JointState.

    Parameters
    ----------
    names, values : sequence
        The message's names and one of its arrays.
    what : str
        Name of the array in the message of a rejection, such as ``'setpoint position'``.

    Raises
    ------
    InputError
        With reason ``'names'`` or ``'not_finite'``.

    """
    carriages = in_order(names, values, what)
    require_finite(CARRIAGES, carriages, f'{what} of')
    return carriages


def in_order(
    names: Sequence[str], values: Sequence[float], what: str
) -> tuple[float, float, float]:
    """Return the values of q1, q2 and q3, finite or not; else as `carriages_from`."""
    if len(values) != len(names):
        raise InputError('names', f'{what} has {len(values)} values for {len(names)} names')
    if tuple(names) == CARRIAGES:  # any order will do, but it costs
        return tuple(values)
    if sorted(names) != sorted(CARRIAGES):
        raise InputError(
            'names', f'{what} names {quoted(list(names))}, '
            f'expected each of {", ".join(CARRIAGES)} once')
    return tuple(values[names.index(name)] for name in CARRIAGES)


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


def planar_wrench(message: WrenchStamped) -> Wrench:
    """Return what a wrench has in the plane; what is not in it is no matter of the mechanism."""
    force, torque = message.wrench.force, message.wrench.torque
    return Wrench(force.x, force.y, torque.z)


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
