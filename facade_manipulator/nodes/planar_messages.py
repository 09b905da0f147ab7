"""
Planar quantities, stamps and frames read from messages; invalid contents are rejected.

The module needs no ROS: a message is any object with the right fields, from rclpy or from a
recording.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from reprlib import repr as quoted  # shortens any text that is received
from typing import Any, NamedTuple

from facade_manipulator.covariance import is_measured, LARGEST_DEVIATION
from facade_manipulator.errors import (
    compared,
    compared_magnitudes,
    InputError,
    require_recent,
)
from facade_manipulator.kinematics import Pose, Wrench
from facade_manipulator.kinematics.geometry import AXIS_NAMES

LEVEL_NAMES = ('ok', 'warn', 'error', 'stale')  # of diagnostics, by number
VARIANCES = (0, 7, 35)  # of x, y and yaw among the 36 of a pose's covariance


class Frames(NamedTuple):
    """Frame ids of a manipulator in messages, TF and URDF, with its namespace as a prefix."""

    prefix: str
    facade: str
    rail: str
    end_effector: str

    @classmethod
    def of(cls, namespace: str) -> Frames:
        """Return the frame ids for a namespace."""
        prefix = f'{namespace.strip("/")}/'.lstrip('/')
        return cls(
            prefix, *(prefix + frame for frame in ('facade', 'rail', 'end_effector'))
        )


class OutOfPlane(NamedTuple):
    """Deviation of a 3D pose from the nearest planar pose: height [m] and tilt [rad]."""

    height: float
    tilt: float


BILLION = 10**9  # ns of a second


def seconds(stamp: Any) -> float:
    """
    Convert a stamp to seconds; float64 resolves 0.24 µs at the present epoch.

    Raises an InputError with reason ``'malformed'`` if the nanoseconds are a second or more.
    """
    if stamp.nanosec >= BILLION:
        raise InputError(
            'malformed',
            f'stamp is invalid: {stamp.nanosec} ns is not below the limit {BILLION} ns',
        )
    return stamp.sec + stamp.nanosec * 1e-9


def stamp_text(stamp: Any) -> str:
    """Return a stamp in seconds as text with nine decimals, which identifies a goal."""
    return f'{stamp.sec}.{stamp.nanosec:09d}'


MAXIMUM_AGE, MAXIMUM_LEAD = 5.0, 1.0  # s, of the stamp of a command on arrival


def require_recent_command(name: str, stamp: float, now: float) -> None:
    """
    Reject a command whose stamp [s] is too old or too far ahead, as after a replay.

    A stamp of 0 means the time of arrival. Raises an InputError with reason ``'stale'`` or
    ``'future'``.
    """
    if stamp:
        require_recent(name, now - stamp, MAXIMUM_AGE, MAXIMUM_LEAD)


def require_frame(frame_id: str, expected: str, name: str) -> None:
    """Raise an InputError with reason ``'frame'`` if a message uses another frame."""
    if frame_id != expected:
        raise InputError(
            'frame', f"{name} is in frame {quoted(frame_id)}, expected '{expected}'"
        )


def require_finite(names: Sequence[str], values: Sequence[float], name: str) -> None:
    """Raise an InputError with reason ``'not_finite'`` if a value is not finite."""
    if not all(map(math.isfinite, values)):
        part, value = next(
            pair
            for pair in zip(names, values, strict=True)
            if not math.isfinite(pair[1])
        )
        raise InputError.not_finite(f'{name} {part}', value)


# tolerance of a quaternion's squared norm, for two digits of each part; that of tf2 is 0.01
SQUARE_TOLERANCE = 0.02
POSE_NUMBERS = (
    'x',
    'y',
    'z',
    'orientation.x',
    'orientation.y',
    'orientation.z',
    'orientation.w',
)


def projected(message: Any, name: str) -> tuple[Pose, OutOfPlane]:
    """
    Return the planar pose nearest to a geometry_msgs/Pose [m, m, rad], and the deviation.

    The yaw is the turn about z after which only a tilt about an axis in the plane remains. `name`
    is the name of the pose in a rejection, such as ``'goal'``. Raises an InputError with reason
    ``'not_finite'`` or ``'quaternion'``.
    """
    position, q = message.position, message.orientation
    x, y, z, qx, qy, qz, qw = numbers = (
        position.x,
        position.y,
        position.z,
        q.x,
        q.y,
        q.z,
        q.w,
    )
    require_finite(POSE_NUMBERS, numbers, name)
    norm = math.hypot(qx, qy, qz, qw)
    if abs(norm * norm - 1.0) > SQUARE_TOLERANCE:
        raise InputError(
            'quaternion',
            f'{name} orientation has norm {norm:.6g}, expected 1 ± {0.5 * SQUARE_TOLERANCE:g}',
        )
    tilt = 2.0 * math.atan2(math.hypot(qx, qy), math.hypot(qz, qw))
    yaw = math.atan2(2.0 * qz * qw, (qw - qz) * (qw + qz))
    return Pose(x, y, yaw), OutOfPlane(z, tilt)


PLANE_TOLERANCE = 1e-6  # m
TILT_TOLERANCE = 1e-3  # rad


def planar_pose(message: Any, name: str) -> Pose:
    """Return a geometry_msgs/Pose as planar pose; raises as `projected`, or ``'out_of_plane'``."""
    pose, (height, tilt) = projected(message, name)
    if abs(height) > PLANE_TOLERANCE:
        height_text, limit_text = compared_magnitudes(height, PLANE_TOLERANCE)
        raise InputError(
            'out_of_plane',
            f'{name} z = {height_text} m is out of the plane, above the limit '
            f'{limit_text} m',
        )
    if tilt > TILT_TOLERANCE:
        tilt_text, limit_text = compared(tilt, TILT_TOLERANCE, '.4g')
        raise InputError(
            'out_of_plane',
            f'{name} is tilted by {tilt_text} rad out of the plane, '
            f'above the limit {limit_text} rad',
        )
    return pose


def pose_in_frame(message: Any, frame_id: str, name: str) -> Pose:
    """Return a geometry_msgs/PoseStamped as a planar pose [m, m, rad]; require its frame."""
    require_frame(message.header.frame_id, frame_id, name)
    return planar_pose(message.pose, name)


def estimated_pose(
    message: Any, name: str
) -> tuple[Pose, OutOfPlane, tuple[float, float, float]]:
    """Return pose [m, m, rad], deviation from the plane, and variances in a message."""
    covariance = message.pose.covariance
    x, y, yaw = [float(covariance[k]) for k in VARIANCES]
    return *projected(message.pose.pose, name), (x, y, yaw)


def require_measured(
    name: str, variance: float, largest_deviation: float = LARGEST_DEVIATION
) -> None:
    """Reject a value with reason ``'not_measured'`` if its variance marks it as not measured."""
    if not is_measured(variance, largest_deviation):
        raise not_measured_error(name, variance, largest_deviation)


def not_measured_error(
    name: str, variance: float, largest_deviation: float = LARGEST_DEVIATION
) -> InputError:
    """Return the error for a value whose variance marks it as not measured."""
    return InputError(
        'not_measured',
        f'{name} rejected: its variance = {variance:g} means that it was not measured, '
        f'expected 0 to {largest_deviation**2:g}; next: check the sensor',
    )


def carriages_from(
    names: Sequence[str], values: Sequence[float], name: str
) -> tuple[float, float, float]:
    """
    Return finite values of q1, q2 and q3 from a JointState, whose names may have any order.

    `name` is the name of the array in a rejection, such as ``'setpoint position'``. Raises an
    InputError with reason ``'names'`` or ``'not_finite'``.
    """
    if len(values) != len(names):
        raise InputError(
            'names', f'{name} contains {len(values)} values for {len(names)} names'
        )
    if tuple(names) != AXIS_NAMES and sorted(names) != sorted(AXIS_NAMES):
        raise InputError(
            'names',
            f'{name} names {quoted(list(names))}, expected each of '
            f'{", ".join(AXIS_NAMES)} once',
        )
    require_finite(names, values, f'{name} of')
    q1, q2, q3 = (values[names.index(carriage)] for carriage in AXIS_NAMES)
    return q1, q2, q3


def planar_wrench(message: Any) -> Wrench:
    """Return the planar part of a wrench [N, N, N m]."""
    force, torque = message.wrench.force, message.wrench.torque
    return Wrench(force.x, force.y, torque.z)


def status_level(status: Any) -> str:
    """Return the level of a diagnostic status as a word; unknown levels count as errors."""
    return dict(enumerate(LEVEL_NAMES)).get(ord(status.level), 'error')


def status_values(status: Any) -> dict[str, str]:
    """Return the values of a diagnostic status by key."""
    return {item.key: item.value for item in status.values}
