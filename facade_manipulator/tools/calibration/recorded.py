"""What a calibration reads from a file of the recorder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from facade_manipulator import messages
from facade_manipulator.blackbox import read_recording, RecordedRun
from facade_manipulator.errors import CalibrationError
from facade_manipulator.estimation import EstimatorSetup, IMU, inputs, rates_and_forces
from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction import EstimateGate, EstimateSettings, rail_pose
from facade_manipulator.tools.calibration.estimator_fit import EstimatorRecording
from facade_manipulator.tools.calibration.sensor_fit import SensorRecording
from facade_manipulator.tools.calibration.tables import at_times

HEAD_ON_WALL, LATERAL_OFFSET = 'head_on_wall', 'lateral_offset'
TOUCH = 1.5  # N, three times a sensor's usual noise


def read_estimator_recording(path: Path, head_topic: str = HEAD_ON_WALL) -> EstimatorRecording:
    """
    Return disturbance, carriages and the head on the wall from a file of the recorder.

    Without a measurement of the head, `lateral_offset` shows its x: where it should be then, less
    what it is off. Raises a RecordError if the file cannot be read, a CalibrationError if a topic
    is not in it.
    """
    run = read_recording(path)
    tables = (_table(run, path, _estimates(run), lambda message: _place(message.pose)),
              _table(run, path, 'joint_states', _carriages))
    if run.topics[head_topic] or not run.topics[LATERAL_OFFSET]:
        return EstimatorRecording(*tables, _table(run, path, head_topic, _place))
    reference = _table(run, path, 'compensator/reference', _place)
    offset = _table(run, path, LATERAL_OFFSET, lambda message: [message.point.x])
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


def read_touches(path: Path, estimate: EstimateSettings) -> TouchRecording:
    """
    Return where the head pressed on the wall, from a file of the recorder.

    `estimate` has mounting, axes and delay of the estimator. Raises a RecordError if the file
    cannot be read, a CalibrationError if a topic is not in it, or the head did not touch.
    """
    run, gate = read_recording(path), EstimateGate(estimate)

    def rail(message: Any) -> Pose:
        place = _place(message.pose)
        if not messages.is_of_rail(message):
            place = gate.displacement(place)
        return rail_pose(place, Pose(*estimate.mounting), estimate.axes)

    wrenches = _table(run, path, 'contact_wrench', messages.planar_wrench)
    tables = (_table(run, path, 'joint_states', _carriages),
              _table(run, path, _estimates(run), rail) - [estimate.delay, 0.0, 0.0, 0.0])
    within = (wrenches[:, 0] > max(table[0, 0] for table in tables)) & (
        wrenches[:, 0] < min(table[-1, 0] for table in tables))
    touching = wrenches[within & (-wrenches[:, 2] > TOUCH)]
    if not len(touching):
        raise CalibrationError(f'{path}: the head did not touch the wall with {TOUCH:g} N')
    times = touching[:, 0]
    return TouchRecording(
        times, -touching[:, 2], *(at_times(table, times) for table in tables))


def read_sensors(path: Path, setup: EstimatorSetup) -> SensorRecording:
    """
    Return what the sensors of the estimator measured, from a file of the recorder.

    Raises a RecordError if the file cannot be read, a CalibrationError if a topic is not in it.
    """
    run, taken = read_recording(path), inputs(setup)
    tables = {name: _table(run, path, name, taken[name].numbers_of)
              for name in (*setup.distances, *setup.fixes)}
    for name in setup.distances:
        least, most, measured = tables[name][:, 1:].T
        tables[name] = tables[name][(least <= measured) & (measured <= most)][:, [0, 3]]
    return SensorRecording(_table(run, path, 'imu', _rates_and_forces), tables)


def _rates_and_forces(message: Any) -> tuple[float, ...]:
    rates, forces = rates_and_forces(IMU.numbers_of(message))
    return *rates, *forces


def _estimates(run: RecordedRun) -> str:
    return 'disturbance' if run.topics['disturbance'] else 'disturbance_odometry'


def _carriages(message: Any) -> tuple[float, float, float]:
    return messages.carriages_from(message.name, message.position, 'joint_states')


def _table(
    run: RecordedRun, path: Path, topic: str, read: Callable[[Any], Sequence[float]]
) -> np.ndarray:
    """Return stamps and numbers of a topic by ascending stamps, without those rejected."""
    rows = messages.by_stamp((one.message for one in run.topics[topic]), read)
    if not rows:
        raise CalibrationError(f'{path} has no message of {topic}: was the recorder started '
                               'before, and the topic published?')
    return np.array(rows)


def _place(message: Any) -> Pose:
    return messages.projected(messages.pose_numbers(message.pose), 'a recorded pose')[0]
