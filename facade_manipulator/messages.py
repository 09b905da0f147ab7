"""
Stamps, planar poses and carriages of messages; invalid contents are rejected.

Needs no ROS: a message is any object with its fields, of rclpy or read from a file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
import math
from reprlib import repr as quoted  # a message stays short, whatever is sent
from typing import Any, NamedTuple

from facade_manipulator.errors import InputError, require_recent
from facade_manipulator.kinematics import Carriages, Pose, Wrench

BILLION = 10 ** 9  # ns of a second
PLANE_TOLERANCE = 1e-6  # m
TILT_TOLERANCE = 1e-3  # rad
NORM_TOLERANCE = 1e-3  # quaternions are often sent rounded
CARRIAGES = Carriages._fields
POSE_NUMBERS = (
    'x', 'y', 'z', 'orientation.x', 'orientation.y', 'orientation.z', 'orientation.w')
FACADE, RAIL, END_EFFECTOR = 'facade', 'rail', 'end_effector'  # frames, without their prefix
STATUS_LEVELS = ('ok', 'warn', 'error', 'stale')  # of diagnostics, by number
HOLD = 'compensator/hold was called'  # a reason in compensator/goal_status
OLDEST_COMMAND, LATEST_COMMAND = 5.0, 1.0  # s, age and lead of a stamp on arrival
VARIANCES = (0, 7, 35)  # of x, y and yaw among the 36 of a pose's covariance


class Frames(NamedTuple):
    """The frames of a manipulator as its messages, TF and URDF name them."""

    prefix: str  #: before each name
    facade: str
    rail: str
    end_effector: str

    @classmethod
    def of(cls, namespace: str) -> Frames:
        """Return the frames of a namespace, which is their prefix."""
        prefix = f"{namespace.strip('/')}/".lstrip('/')
        return cls(prefix, prefix + FACADE, prefix + RAIL, prefix + END_EFFECTOR)


def seconds(stamp: Any) -> float:
    """
    Return a stamp in seconds; float64 resolves 0.24 µs at today's epoch.

    Raises an InputError with reason ``'malformed'`` where the nanoseconds are a second or more.
    """
    if stamp.nanosec >= BILLION:
        raise InputError('malformed', f'stamp rejected: {stamp.nanosec} ns, bound {BILLION} ns')
    return stamp.sec + stamp.nanosec * 1e-9


def stamp_text(stamp: Any) -> str:
    """Return a stamp as an exact value of a diagnostic status: seconds with nine decimals."""
    return f'{stamp.sec}.{stamp.nanosec:09d}'


def stamp_numbers(time: float) -> tuple[int, int]:
    """Return the two numbers of a stamp, whole seconds and the nanoseconds after them."""
    sec = math.floor(time)
    return sec, int((time - sec) * 1e9)


def by_stamp(
    messages: Iterable[Any], read: Callable[[Any], Sequence[float]]
) -> list[tuple[float, ...]]:
    """Return stamps and what is read by ascending stamps, each once, without what is rejected."""
    rows: dict[float, Sequence[float]] = {}
    for message in messages:
        with suppress(InputError):  # so had the nodes
            rows.setdefault(seconds(message.header.stamp), read(message))
    return [(time, *numbers) for time, numbers in sorted(rows.items())]


def require_frame(frame_id: str, expected: str, what: str) -> None:
    """Reject a message of another frame: an InputError with reason ``'frame'``."""
    if frame_id != expected:
        raise InputError('frame', f"{what} is in frame {quoted(frame_id)}, expected '{expected}'")


def require_recent_command(what: str, stamp: float, now: float) -> None:
    """
    Reject a command by its stamp [s], unless that is 0: it means the time of arrival.

    A recording that is played beside the machine brings commands of another day. Raises an
    InputError with reason ``'stale'`` or ``'future'``.
    """
    if stamp:
        require_recent(what, now - stamp, OLDEST_COMMAND, LATEST_COMMAND)


def planar_pose(message: Any, what: str) -> Pose:
    """
    Return the planar pose of a geometry_msgs/Pose: z = 0, roll = pitch = 0.

    `what` is its name in the message of a rejection, such as ``'goal'``: an InputError with reason
    ``'not_finite'``, ``'quaternion'`` or ``'out_of_plane'``.
    """
    return planar(pose_numbers(message), what)


def pose_in_frame(message: Any, frame_id: str, what: str) -> Pose:
    """Return the planar pose of a message with a header; as `require_frame` and `planar_pose`."""
    require_frame(message.header.frame_id, frame_id, what)
    return planar(pose_numbers(message.pose), what)


def pose_numbers(message: Any) -> tuple[float, ...]:
    """Return the seven numbers of a pose, position [m] and quaternion."""
    position, q = message.position, message.orientation
    return position.x, position.y, position.z, q.x, q.y, q.z, q.w


def planar_numbers(pose: Pose) -> tuple[float, ...]:
    """Return the seven numbers of a planar pose, position [m] and quaternion."""
    half = 0.5 * pose.theta
    return pose.x, pose.y, 0.0, 0.0, 0.0, math.sin(half), math.cos(half)


def estimate_numbers(message: Any) -> tuple[float, ...]:
    """Return the numbers of an estimated pose: those of the pose, variances of x, y and yaw."""
    estimate = message.pose
    return (*pose_numbers(estimate.pose), *(float(estimate.covariance[k]) for k in VARIANCES))


def planar(numbers: Sequence[float], what: str) -> Pose:
    """Return the planar pose of the seven numbers of a pose; else as `planar_pose`."""
    pose, (height, tilt) = projected(numbers, what)
    if abs(height) > PLANE_TOLERANCE:
        raise InputError(
            'out_of_plane', f'{what} z = {height:.6g} m is out of the plane z = 0 m')
    if tilt > TILT_TOLERANCE:
        raise InputError(
            'out_of_plane', f'{what} is tilted by {tilt:.4g} rad out of the plane, bound '
            f'{TILT_TOLERANCE:g} rad')
    return pose


class OutOfPlane(NamedTuple):
    """Difference of a pose in space from the nearest planar pose: height [m], tilt [rad]."""

    height: float
    tilt: float


def projected(numbers: Sequence[float], what: str) -> tuple[Pose, OutOfPlane]:
    """
    Return the planar pose nearest to a pose in space, and the difference.

    The yaw is the turn about z after which only a tilt about an axis in the plane remains. Raises
    an InputError with reason ``'not_finite'`` or ``'quaternion'``.
    """
    require_finite(POSE_NUMBERS, numbers, what)
    x, y, z, qx, qy, qz, qw = numbers
    norm = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if abs(norm - 1.0) > NORM_TOLERANCE:
        raise InputError(
            'quaternion', f'{what} orientation has norm {norm:.6g}, not 1 within '
            f'{NORM_TOLERANCE:g}')
    tilt = 2.0 * math.atan2(math.hypot(qx, qy), math.hypot(qz, qw))
    yaw = math.atan2(2.0 * qz * qw, (qw - qz) * (qw + qz))
    return Pose(x, y, yaw), OutOfPlane(z, tilt)


def require_finite(names: Sequence[str], values: Sequence[float], what: str) -> None:
    """Reject values that are not finite: an InputError with reason ``'not_finite'``."""
    if all(map(math.isfinite, values)):
        return
    for name, value in zip(names, values, strict=True):
        if not math.isfinite(value):
            raise InputError.not_finite(f'{what} {name}', value)


def carriages_from(
    names: Sequence[str], values: Sequence[float], what: str
) -> tuple[float, float, float]:
    """
    Return the values of q1, q2 and q3, whatever their order in a JointState.

    `what` is the name of its array in the message of a rejection, such as ``'setpoint position'``:
    an InputError with reason ``'names'`` or ``'not_finite'``.
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
        q1, q2, q3 = values
        return q1, q2, q3
    if sorted(names) != sorted(CARRIAGES):
        raise InputError(
            'names', f'{what} names {quoted(list(names))}, '
            f'expected each of {", ".join(CARRIAGES)} once')
    q1, q2, q3 = (values[names.index(name)] for name in CARRIAGES)
    return q1, q2, q3


def planar_wrench(message: Any) -> Wrench:
    """Return the planar part of a wrench [N, N, N m]."""
    force, torque = message.wrench.force, message.wrench.torque
    return Wrench(force.x, force.y, torque.z)


def status_level(status: Any) -> str:
    """Return the level of a diagnostic status as a word; one that is not defined is an error."""
    level = status.level  # a byte of rclpy, a number in a file
    number = level[0] if isinstance(level, bytes) else level
    return STATUS_LEVELS[number] if number < len(STATUS_LEVELS) else 'error'


def status_values(status: Any) -> dict[str, str]:
    """Return the values of a diagnostic status by their keys."""
    return {item.key: item.value for item in status.values}


def millimetres(pose: Pose) -> str:
    """Return a pose as an operator reads it."""
    return (f'x {1e3 * pose.x:+.1f} mm, y {1e3 * pose.y:+.1f} mm, '
            f'theta {math.degrees(pose.theta):+.2f} deg')
