"""What a calibration reads from a file of the recorder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from facade_manipulator.blackbox import read_recording, RecordedRun
from facade_manipulator.calibration.estimator_fit import EstimatorRecording
from facade_manipulator.errors import CalibrationError, InputError
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import carriages_from, pose_numbers, projected, seconds

HEAD_ON_WALL, LATERAL_OFFSET = 'head_on_wall', 'lateral_offset'


def read_estimator_recording(path: Path, head_topic: str = HEAD_ON_WALL) -> EstimatorRecording:
    """
    Return disturbance, carriages and the head on the wall from a file of the recorder.

    Without a measurement of the head, `lateral_offset` shows its x: where it should be then, less
    what it is off.

    Parameters
    ----------
    path : Path
    head_topic : str
        Topic of the head's pose on the wall.

    Raises
    ------
    RecordError
        If the file cannot be read.
    CalibrationError
        If a topic is not in it.

    """
    run = read_recording(path)
    estimates = 'disturbance' if run.topics['disturbance'] else 'disturbance_odometry'
    tables = (
        _table(run, path, estimates, lambda message: _place(message.pose)),
        _table(run, path, 'joint_states', lambda message: carriages_from(
            message.name, message.position, 'joint_states')))
    if run.topics[head_topic] or not run.topics[LATERAL_OFFSET]:
        return EstimatorRecording(*tables, _table(run, path, head_topic, _place))
    reference = _table(run, path, 'compensator/reference', _place)
    offset = _table(run, path, LATERAL_OFFSET, lambda message: [message.point.x])
    x, theta = (np.interp(offset[:, 0], reference[:, 0], reference[:, k]) for k in (1, 3))
    wall = np.full((len(offset), 4), np.nan)
    wall[:, 0], wall[:, 1] = offset[:, 0], x - offset[:, 1] / np.cos(theta)
    return EstimatorRecording(*tables, wall)


def _table(
    run: RecordedRun, path: Path, topic: str, read: Callable[[Any], Sequence[float]]
) -> np.ndarray:
    """Return stamps and numbers of a topic by ascending stamps, without those rejected."""
    rows = {}
    for _, message in run.topics[topic]:
        with suppress(InputError):  # so had the nodes
            rows.setdefault(seconds(message.header.stamp), read(message))
    if not rows:
        raise CalibrationError(f'{path} has no message of {topic}: was the recorder started '
                               'before, and the topic published?')
    return np.array([(time, *numbers) for time, numbers in sorted(rows.items())])


def _place(message: Any) -> Pose:
    return projected(pose_numbers(message.pose), 'a recorded pose')[0]
