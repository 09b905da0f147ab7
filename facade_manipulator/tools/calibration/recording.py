"""Reader of estimator data from a rosbag2 recording."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from facade_manipulator.errors import CalibrationError, InputError
from facade_manipulator.kinematics import Carriages, Pose
from facade_manipulator.nodes import planar_messages
from facade_manipulator.tools.calibration.estimator_fit import EstimatorRecording
from facade_manipulator.topics import HEAD_ON_WALL

_POSE_TYPES = (
    'geometry_msgs/msg/PoseStamped',
    'geometry_msgs/msg/PoseWithCovarianceStamped',
    'nav_msgs/msg/Odometry',
)
_JOINT_TYPES = ('sensor_msgs/msg/JointState',)


def read_estimator_recording(
    path: Path, head: str = HEAD_ON_WALL.name, namespace: str = ''
) -> EstimatorRecording:
    """
    Return disturbances, carriage positions and head poses [m, m, rad] from a recording.

    Parameters
    ----------
    path : pathlib.Path
        A rosbag2 folder, or one ``.mcap`` or ``.db3`` file.
    head : str
        Topic of the head on the wall; a name that begins with ``/`` is absolute.
    namespace : str
        Namespace of the nodes.

    Raises
    ------
    CalibrationError
        If the recording cannot be read, lacks a topic, or contains another type of message.

    """
    # imported here, because nodes run without rosbags
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import get_typestore, Stores

    names = ('disturbance', 'disturbance_odometry', 'joint_states', head)
    topics = [PurePosixPath('/', namespace, name).as_posix() for name in names]
    disturbance, odometry, joints, wall = topics
    # in this order, so that the topic of the head must contain poses
    accepted = {joints: _JOINT_TYPES} | dict.fromkeys(
        (disturbance, odometry, wall), _POSE_TYPES
    )
    recorded: dict[str, list[Any]] = {topic: [] for topic in topics}
    try:
        # older .db3 files contain no message definitions
        with AnyReader(
            [path], default_typestore=get_typestore(Stores.ROS2_JAZZY)
        ) as bag:
            wanted = [one for one in bag.connections if one.topic in recorded]
            for connection, _, data in bag.messages(wanted) if wanted else ():
                recorded[connection.topic].append(
                    bag.deserialize(data, connection.msgtype)
                )
    except Exception as error:  # damaged bytes raise any error of their decoder
        raise CalibrationError(
            f'{path} rejected: it cannot be read: {error}; next: check the path, run ros2 bag '
            'reindex or mcap recover, or record again'
        ) from error

    for connection in wanted:
        _require_type(path, connection, accepted[connection.topic])
    estimates = disturbance if recorded[disturbance] else odometry
    series = [_by_stamp(recorded[topic]) for topic in (estimates, joints, wall)]
    for topic, rows in zip((disturbance, joints, wall), series, strict=True):
        if not rows:
            raise CalibrationError(
                f'{path} rejected: it contains no valid message of {topic}; next: record that '
                'topic, or give --namespace'
            )
    return EstimatorRecording(*map(np.array, series))


def _require_type(path: Path, connection: Any, accepted: tuple[str, ...]) -> None:
    """Raise a CalibrationError if the messages of a topic have another type than accepted."""
    if connection.msgtype not in accepted:
        raise CalibrationError(
            f'{path} rejected: {connection.topic} contains {connection.msgtype}, expected '
            f'{" or ".join(accepted)}; next: give another topic with --head, or record the '
            'topic with an accepted type'
        )


def _by_stamp(recorded: list[Any]) -> list[tuple[float, ...]]:
    """Return stamp [s] and values of each valid message, sorted, without repeated stamps."""
    rows: dict[float, Pose | Carriages] = {}
    for message in recorded:
        with suppress(InputError):  # the nodes also rejected this message
            rows.setdefault(
                planar_messages.seconds(message.header.stamp), _numbers(message)
            )
    return [(time, *rows[time]) for time in sorted(rows)]


def _numbers(message: Any) -> Pose | Carriages:
    """Return the pose or carriage positions in a recorded message [m, m, rad]."""
    if hasattr(message, 'position'):
        return Carriages(
            *planar_messages.carriages_from(
                message.name, message.position, 'joint_states'
            )
        )
    pose = getattr(message.pose, 'pose', message.pose)  # with a covariance or without
    return planar_messages.projected(pose, 'recorded pose')[0]
