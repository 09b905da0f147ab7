"""Read the tables that a calibration needs from a rosbag2 recording."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from facade_manipulator import messages
from facade_manipulator.errors import CalibrationError
from facade_manipulator.estimation.messages import IMU, inputs, rates_and_forces
from facade_manipulator.estimation.settings import EstimatorSetup
from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction.estimate import EstimateGate, EstimateSettings
from facade_manipulator.prediction.mounting import rail_pose
from facade_manipulator.tools.calibration.estimator_fit import EstimatorRecording
from facade_manipulator.tools.calibration.sensor_fit import SensorRecording
from facade_manipulator.tools.calibration.tables import at_times

HEAD_ON_WALL, LATERAL_OFFSET, REFERENCE = 'head_on_wall', 'lateral_offset', 'compensator/reference'
DISTURBANCE, DISTURBANCE_ODOMETRY = 'disturbance', 'disturbance_odometry'
STORAGES = '.mcap', '.db3'
TOUCH = 1.5  # N, three times a sensor's usual noise


def is_recording(path: Path) -> bool:
    """Return whether a path is a rosbag2 folder or one of its files, not a table."""
    return path.is_dir() or path.suffix in STORAGES


class Recording:
    """
    Some topics of a rosbag2 recording.

    Parameters
    ----------
    path : pathlib.Path
        A rosbag2 folder, or one ``.mcap`` or ``.db3`` file.
    topics : collection of str
        Names below the namespace; a name that begins with ``/`` is absolute.
    namespace : str
        The namespace of the nodes.

    Raises
    ------
    CalibrationError
        If the recording cannot be read, or has no messages at all.

    """

    def __init__(self, path: Path, topics: Collection[str], namespace: str = '') -> None:
        self._path, self._names = path, {one: _absolute(one, namespace) for one in topics}
        self._messages: dict[str, list[Any]] = {name: [] for name in self._names.values()}
        self._topics: list[str] = []
        try:
            for topic, message in self._read():
                self._messages[topic].append(message)
        except (ImportError, MemoryError, CalibrationError):
            raise
        except Exception as error:  # damaged bytes raise whatever their decoder does
            raise CalibrationError(
                f'{path} cannot be read: {error}; next: {_remedy(path)}') from error

    def __contains__(self, topic: str) -> bool:
        return bool(self._messages[self._names[topic]])

    def _read(self) -> Iterator[tuple[str, Any]]:
        # not among the packages that the machine needs
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import get_typestore, Stores

        # older .db3 files contain no message definitions
        with AnyReader([self._path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as bag:
            if not bag.message_count:
                raise CalibrationError(
                    f'{self._path} has no messages; next: check that the nodes ran and had the '
                    "recorder's ROS_DOMAIN_ID, and record again")
            self._topics = sorted(bag.topics)
            wanted = [one for one in bag.connections if one.topic in self._messages]
            for connection, _, data in bag.messages(wanted) if wanted else ():
                yield connection.topic, bag.deserialize(data, connection.msgtype)

    def table(self, topic: str, read: Callable[[Any], Sequence[float]]) -> np.ndarray:
        """
        Return stamps [s] and numbers of a topic by ascending stamps, without rejected messages.

        Raises a CalibrationError if no message remains.
        """
        name = self._names[topic]
        rows = messages.by_stamp(self._messages[name], read)
        if not rows and self._messages[name]:
            raise CalibrationError(
                f'{self._path}: none of {len(self._messages[name])} messages of {name} is valid; '
                'next: check the program that publishes it')
        if not rows:
            raise CalibrationError(
                f'{self._path} has no message of {name}, only of {", ".join(self._topics)}; '
                'next: record that topic, or give --namespace')
        return np.array(rows)


def read_estimator_recording(
    path: Path, head_topic: str = HEAD_ON_WALL, namespace: str = ''
) -> EstimatorRecording:
    """
    Return disturbance, carriages and the head on the wall from a recording.

    Without a measurement of the head, `lateral_offset` shows its x: the reference minus the
    offset. Raises a CalibrationError if the recording cannot be read or a topic is missing.
    """
    recording = Recording(path, (
        DISTURBANCE, DISTURBANCE_ODOMETRY, 'joint_states', head_topic, LATERAL_OFFSET, REFERENCE),
        namespace)
    tables = (recording.table(_estimates(recording), lambda message: _place(message.pose)),
              recording.table('joint_states', _carriages))
    if head_topic in recording or LATERAL_OFFSET not in recording:
        return EstimatorRecording(*tables, recording.table(head_topic, _place))
    reference = recording.table(REFERENCE, _place)
    offset = recording.table(LATERAL_OFFSET, lambda message: [message.point.x])
    x, _, theta = at_times(reference, offset[:, 0]).T
    wall = np.full((len(offset), 4), np.nan)
    wall[:, 0], wall[:, 1] = offset[:, 0], x - offset[:, 1] / np.cos(theta)
    return EstimatorRecording(*tables, wall)


class TouchRecording(NamedTuple):
    """The head while it presses on the wall, one row for each measured force."""

    times: np.ndarray  #: stamps, shape (n,) [s]
    forces: np.ndarray  #: on the wall, shape (n,) [N]
    carriages: np.ndarray  #: positions, shape (n, 3) [m]
    rails: np.ndarray  #: poses of the rail in facade, shape (n, 3) [m, m, rad]


def read_touches(
    path: Path, estimate: EstimateSettings, namespace: str = ''
) -> TouchRecording:
    """
    Return where the head pressed on the wall, from a recording.

    `estimate` has mounting, axes and delay of the estimator. Raises a CalibrationError if the
    recording cannot be read, a topic is missing or the head did not touch the wall.
    """
    gate, recording = EstimateGate(estimate), Recording(
        path, (DISTURBANCE, DISTURBANCE_ODOMETRY, 'joint_states', 'contact_wrench'), namespace)

    def rail(message: Any) -> Pose:
        place = _place(message.pose)
        if not messages.is_of_rail(message):
            place = gate.displacement(place)
        return rail_pose(place, Pose(*estimate.mounting), estimate.axes)

    wrenches = recording.table('contact_wrench', messages.planar_wrench)
    tables = (recording.table('joint_states', _carriages),
              recording.table(_estimates(recording), rail) - [estimate.delay, 0.0, 0.0, 0.0])
    within = (wrenches[:, 0] > max(table[0, 0] for table in tables)) & (
        wrenches[:, 0] < min(table[-1, 0] for table in tables))
    touching = wrenches[within & (-wrenches[:, 2] > TOUCH)]
    if not len(touching):
        raise CalibrationError(f'{path}: the head did not touch the wall with {TOUCH:g} N')
    times = touching[:, 0]
    return TouchRecording(
        times, -touching[:, 2], *(at_times(table, times) for table in tables))


def read_sensors(path: Path, setup: EstimatorSetup, namespace: str = '') -> SensorRecording:
    """
    Return the measurements of the estimator's sensors from a recording.

    Raises a CalibrationError if the recording cannot be read or a topic is missing.
    """
    taken, sensors = inputs(setup), (*setup.distances, *setup.fixes)
    recording = Recording(path, ('imu', *sensors), namespace)
    tables = {name: recording.table(name, taken[name].numbers_of) for name in sensors}
    for name in setup.distances:
        least, most, measured = tables[name][:, 1:].T
        tables[name] = tables[name][(least <= measured) & (measured <= most)][:, [0, 3]]
    return SensorRecording(recording.table('imu', _rates_and_forces), tables)


def _rates_and_forces(message: Any) -> tuple[float, ...]:
    rates, forces = rates_and_forces(IMU.numbers_of(message))
    return *rates, *forces


def _remedy(path: Path) -> str:
    if not path.exists():
        return 'check the path'
    if path.is_dir() and not (path / 'metadata.yaml').exists():
        return f'ros2 bag reindex {path}'
    return 'recover a cut .mcap file by `mcap recover`, or record again'


def _estimates(recording: Recording) -> str:
    return DISTURBANCE_ODOMETRY if DISTURBANCE_ODOMETRY in recording and (
        DISTURBANCE not in recording) else DISTURBANCE


def _carriages(message: Any) -> tuple[float, float, float]:
    return messages.carriages_from(message.name, message.position, 'joint_states')


def _absolute(topic: str, namespace: str) -> str:
    return topic if topic.startswith('/') else '/'.join(
        ['', *filter(None, (namespace.strip('/'), topic))])


def _place(message: Any) -> Pose:
    return messages.projected(messages.pose_numbers(message.pose), 'a recorded pose')[0]
