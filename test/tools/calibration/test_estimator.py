"""Mounting and delay of an estimator, found from a recording of a swaying gondola."""

from __future__ import annotations

import math

from mechanism import published_motion
import numpy as np
import pytest
import yaml

from facade_manipulator.errors import CalibrationError
from facade_manipulator.kinematics import compose, Geometry, Mechanism, Pose
from facade_manipulator.nodes.conversions import pose_message, stamp
from facade_manipulator.prediction.estimate import EstimateSettings
from facade_manipulator.tools.calibration.__main__ import main
from facade_manipulator.tools.calibration.estimator import EstimatorRecording, fit_estimator

GEOMETRY, PRESENT = Geometry(), EstimateSettings()
MOUNTING, DELAY, LATE = Pose(0.5, 0.3, math.radians(0.5)), 0.02, 0.03
LIMITS = np.array([8e-3, 8e-3, math.radians(0.1), 4e-3])
INSTRUMENT = Pose(3.0, -1.0, 0.1)
TIMES = np.arange(0.0, 60.0, 0.02) + 1.8e9  # s since 1970


def sway(time, yaw=0.01):
    return Pose(0.06 * math.sin(0.9 * time) + 0.02 * math.sin(2.1 * time),
                0.015 * math.sin(1.7 * time), yaw * (math.sin(1.3 * time) + math.sin(0.5 * time)))


def wiping(time):
    return Pose(0.05 * math.sin(0.7 * time), 0.25, 0.0)


def standing(_):
    return Pose(0.0, 0.25, 0.0)


def recorded(yaw=0.01, head=wiping, seed=0, axes=0.0):
    """Return a recording with noise of 1 mm and 1 mrad, as floats since 1970."""
    random, solve = np.random.default_rng(seed), Mechanism(GEOMETRY).inverse_kinematics
    passed = (TIMES - TIMES[0]).tolist()
    tables = [
        [published_motion(sway(time, yaw), MOUNTING, axes) for time in passed],
        [solve(head(time)) for time in passed],
        [compose(INSTRUMENT, compose(sway(time, yaw), head(time))) for time in passed]]
    noises = 1e-3, 0.0, 1e-3
    return EstimatorRecording(*(
        np.column_stack([TIMES + late, table + noise * random.standard_normal((len(TIMES), 3))])
        for late, table, noise in zip((DELAY, 0.0, LATE), tables, noises, strict=True)))


def off_by(found):
    return np.abs([*found.settings.mounting - np.array(MOUNTING), found.settings.delay - DELAY])


@pytest.mark.parametrize('seed', [0, 1])
def test_minute_of_sway_shows_mounting_and_delay(seed):
    found = fit_estimator(GEOMETRY, recorded(seed=seed), PRESENT)
    assert (off_by(found) < LIMITS).all()
    assert (off_by(found) < 4.0 * found.deviations).all()
    assert found.late == pytest.approx(LATE, abs=4e-3)
    assert found.residual == pytest.approx([1e-3] * 3, rel=0.3)


def drift(wall):
    wall[:, 1] += 1.5e-4 * (wall[:, 0] - wall[0, 0])


def misread(wall):
    wall[::20, 1] += 0.2


@pytest.mark.parametrize('spoil', [drift, misread])
def test_instrument_may_drift_or_misread(spoil):
    recording = recorded()
    spoil(recording.wall)
    assert (off_by(fit_estimator(GEOMETRY, recording, PRESENT)) < LIMITS).all()


def test_turned_axes_of_the_estimator_are_kept():
    found = fit_estimator(GEOMETRY, recorded(axes=0.3), EstimateSettings(axes=0.3))
    assert (off_by(found) < LIMITS).all()
    assert found.settings.axes == 0.3


@pytest.mark.parametrize(('changes', 'message'), [
    ({'yaw': 0.0}, 'does not tell .*x of the mounting'), ({'head': standing}, 'not tell delay')])
def test_motion_that_does_not_show_a_value_is_named(changes, message):
    with pytest.raises(CalibrationError, match=message):
        fit_estimator(GEOMETRY, recorded(**changes), PRESENT)


def scale(name, column, factor):
    def change(recording):
        getattr(recording, name)[:, column] *= factor
        return recording

    return change


@pytest.mark.parametrize(('change', 'message'), [
    (scale('disturbance', 1, -1.0), 'remain of a motion of'),
    (scale('wall', 3, math.degrees(1.0)), 'remain of a motion of'),
    (scale('joints', 1, 1e3), 'links do not close'),
    (lambda one: one._replace(disturbance=one.disturbance[:500]), 'share 8.0 s, below 20 s'),
    (lambda one: one._replace(wall=one.wall + [90.0, 0.0, 0.0, 0.0]), 'share -32.0 s')])
def test_recording_that_contradicts_itself_is_rejected(change, message):
    with pytest.raises(CalibrationError, match=message):
        fit_estimator(GEOMETRY, change(recorded()), PRESENT)


class BagWriter:
    """Write recordings as rosbag2 folders."""

    def __init__(self, folder):
        from rosbags.typesys import get_typestore, Stores

        self.folder, self._store = folder, get_typestore(Stores.ROS2_JAZZY)
        self._topics = {'disturbance': self._estimate, 'joint_states': self._joint_state,
                        'head_on_wall': self._head}

    def write(self, recording, namespace=''):
        from rosbags.rosbag2 import StoragePlugin, Writer

        with Writer(self.folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
            for (topic, message), table in zip(self._topics.items(), recording, strict=True):
                kind = message(0.0, np.zeros(3)).__msgtype__
                connection = bag.add_connection(
                    f'{namespace}/{topic}', kind, typestore=self._store)
                for time, *numbers in table.tolist():
                    bag.write(connection, int(time * 1e9), self._store.serialize_cdr(
                        message(time, np.array(numbers)), kind))

    def _make(self, kind, *values):
        return self._store.types[kind.replace('/', '/msg/')](*values)

    def _header(self, time):
        return self._make('std_msgs/Header', self._make(
            'builtin_interfaces/Time', stamp(time).sec, stamp(time).nanosec), '')

    def _pose(self, numbers):
        message = pose_message(Pose(*numbers))
        position, q = message.position, message.orientation
        return self._make(
            'geometry_msgs/Pose', self._make('geometry_msgs/Point', position.x, position.y, 0.0),
            self._make('geometry_msgs/Quaternion', 0.0, 0.0, q.z, q.w))

    def _estimate(self, time, numbers):
        return self._make(
            'geometry_msgs/PoseWithCovarianceStamped', self._header(time), self._make(
                'geometry_msgs/PoseWithCovariance', self._pose(numbers), np.zeros(36)))

    def _joint_state(self, time, numbers):
        return self._make('sensor_msgs/JointState', self._header(time), ['q3', 'q1', 'q2'],
                          np.roll(numbers, 1), np.zeros(0), np.zeros(0))

    def _head(self, time, numbers):
        return self._make('geometry_msgs/PoseStamped', self._header(time), self._pose(numbers))


@pytest.fixture
def bag(tmp_path):
    pytest.importorskip('rosbags', reason='rosbags is not installed')
    return BagWriter(tmp_path / 'sway')


def test_command_reads_a_recording_and_prints_parameters(bag, capsys):
    bag.write(recorded(), '/gondola_1')
    assert main(['estimator', str(bag.folder), '--namespace', 'gondola_1']) == 0
    report, lines = capsys.readouterr().out.split('Lines for the parameter file:\n')
    assert 'delay' in report
    written = yaml.safe_load(lines)['/**/compensator']['ros__parameters']['estimate']
    assert (np.abs(np.subtract((*written['mounting'], written['delay']), (*MOUNTING, DELAY)))
            < LIMITS).all()


def test_recording_without_a_topic_is_rejected(bag, capsys):
    recording = recorded()
    bag.write(recording._replace(wall=recording.wall[:0]))
    assert main(['estimator', str(bag.folder)]) == 1
    assert 'no valid message of /head_on_wall' in capsys.readouterr().err
    (cut,) = bag.folder.glob('*.mcap')
    cut.write_bytes(cut.read_bytes()[:-400])
    assert main(['estimator', str(cut)]) == 1
    assert 'next: check the path' in capsys.readouterr().err
