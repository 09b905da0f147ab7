"""Mounting and delay of an estimator, fitted to a recording of a swaying gondola."""

from functools import cache
import math

from geometry_msgs.msg import (
    PointStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    TransformStamped,
)
from geometry_msgs.msg import Pose as PoseMessage
from mechanism import published_motion
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
import yaml

from facade_manipulator.errors import CalibrationError
from facade_manipulator.kinematics import compose, Geometry, Mechanism, Pose
from facade_manipulator.nodes.conversions import pose_message, stamp
from facade_manipulator.prediction.estimate import EstimateSettings
from facade_manipulator.tools.calibration.__main__ import main
from facade_manipulator.tools.calibration.estimator_fit import (
    EstimatorRecording,
    fit_estimator,
)
from facade_manipulator.tools.calibration.recording import read_estimator_recording

pytestmark = pytest.mark.long

GEOMETRY = Geometry()
PRESENT = EstimateSettings()
MOUNTING = Pose(0.5, 0.3, math.radians(0.5))
DELAY = 0.02
LATE = 0.03
LIMITS = np.array([8e-3, 8e-3, math.radians(0.1), 4e-3])
INSTRUMENT = Pose(3.0, -1.0, 0.1)
TIMES = np.arange(0.0, 60.0, 0.02) + 1.8e9  # s since 1970


def sway(time, yaw=0.01):
    x = 0.06 * math.sin(0.9 * time) + 0.02 * math.sin(2.1 * time)
    turn = yaw * (math.sin(1.3 * time) + math.sin(0.5 * time))
    return Pose(x, 0.015 * math.sin(1.7 * time), turn)


def wiping(time):
    return Pose(0.05 * math.sin(0.7 * time), 0.25, 0.0)


def standing(_):
    return Pose(0.0, 0.25, 0.0)


@cache
def measured(yaw, head, axes):
    """Return the poses of the estimator, the carriages and the poses of the instrument."""
    solve = Mechanism(GEOMETRY).inverse_kinematics
    estimated = []
    carriages = []
    seen = []
    for time in (TIMES - TIMES[0]).tolist():
        rail = sway(time, yaw)
        head_on_rail = head(time)
        estimated.append(published_motion(rail, MOUNTING, axes))
        carriages.append(solve(head_on_rail))
        seen.append(compose(INSTRUMENT, compose(rail, head_on_rail)))
    return np.array(estimated), np.array(carriages), np.array(seen)


def recorded(yaw=0.01, head=wiping, seed=0, axes=0.0, noise=1e-3):
    """Return a recording with noise [m, rad] of both sensors, as floats since 1970."""
    random = np.random.default_rng(seed)
    estimated, carriages, seen = measured(yaw, head, axes)

    def column(table, late, scale):
        errors = scale * random.standard_normal((len(TIMES), 3))
        return np.column_stack([TIMES + late, table + errors])

    return EstimatorRecording(
        column(estimated, DELAY, noise),
        column(carriages, 0.0, 0.0),
        column(seen, LATE, noise),
    )


def off_by(found):
    mounting_errors = found.settings.mounting - np.array(MOUNTING)
    return np.abs([*mounting_errors, found.settings.delay - DELAY])


@pytest.mark.parametrize('seed', [0, 1])
def test_minute_of_sway_determines_mounting_and_delay(seed):
    found = fit_estimator(GEOMETRY, recorded(seed=seed), PRESENT)
    assert (off_by(found) < LIMITS).all()
    assert (off_by(found) < 4.0 * found.deviations).all()
    assert found.late == pytest.approx(LATE, abs=4e-3)
    assert found.residual == pytest.approx([1e-3] * 3, rel=0.3)


@pytest.mark.parametrize('seed', [0, 1])
def test_recording_with_noise_like_the_sway_is_rejected(seed):
    with pytest.raises(CalibrationError, match='remain of a motion of'):
        fit_estimator(GEOMETRY, recorded(seed=seed, noise=1e-2), PRESENT)


def drift(wall):
    wall[:, 1] += 1.5e-4 * (wall[:, 0] - wall[0, 0])


def misread(wall):
    wall[::20, 1] += 0.2


@pytest.mark.parametrize('spoil', [drift, misread])
def test_instrument_with_drift_or_outliers_is_accepted(spoil):
    recording = recorded()
    spoil(recording.wall)
    assert (off_by(fit_estimator(GEOMETRY, recording, PRESENT)) < LIMITS).all()


def test_turned_axes_of_the_estimator_are_kept():
    found = fit_estimator(GEOMETRY, recorded(axes=0.3), EstimateSettings(axes=0.3))
    assert (off_by(found) < LIMITS).all()
    assert found.settings.axes == 0.3


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'yaw': 0.0}, 'not determine .*x of the mounting'),
        ({'head': standing}, 'not determine delay'),
    ],
)
def test_motion_without_information_on_a_value_is_rejected(changes, message):
    with pytest.raises(CalibrationError, match=message):
        fit_estimator(GEOMETRY, recorded(**changes), PRESENT)


def scale(name, column, factor):
    def change(recording):
        getattr(recording, name)[:, column] *= factor
        return recording

    return change


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (scale('disturbance', 1, -1.0), 'remain of a motion of'),
        (scale('wall', 3, math.degrees(1.0)), 'remain of a motion of'),
        (scale('joints', 1, 1e3), 'links do not close'),
        (
            lambda one: one._replace(disturbance=one.disturbance[:500]),
            'share 8.0 s, below 20 s',
        ),
        (
            lambda one: one._replace(wall=one.wall + [90.0, 0.0, 0.0, 0.0]),
            'share -32.0 s',
        ),
    ],
)
def test_recording_that_contradicts_itself_is_rejected(change, message):
    with pytest.raises(CalibrationError, match=message):
        fit_estimator(GEOMETRY, change(recorded()), PRESENT)


def estimate(numbers):
    message = PoseWithCovarianceStamped()
    message.pose.pose = pose_message(Pose(*numbers))
    return message


def joint_state(numbers):
    at_rest = [0.0, 0.0, 0.0]
    positions = np.roll(numbers, 1).tolist()
    return JointState(
        name=['q3', 'q1', 'q2'], position=positions, velocity=at_rest, effort=at_rest
    )


def head_pose(numbers):
    return PoseStamped(pose=pose_message(Pose(*numbers)))


def write_bag(folder, recording, namespace='', head=head_pose):
    """Write a recording as a rosbag2 folder; `head` makes the messages of the instrument."""
    pytest.importorskip('rosbags', reason='rosbags is not installed')
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import get_typestore, Stores

    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        for topic, make, table in zip(
            ('disturbance', 'joint_states', 'head_on_wall'),
            (estimate, joint_state, head),
            recording,
            strict=True,
        ):
            kind = type(make([0.0] * 3))
            connection = bag.add_connection(
                f'{namespace}/{topic}',
                f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}',
                typestore=store,
            )
            for time, *numbers in table.tolist():
                message = make(numbers)
                if hasattr(message, 'header'):
                    message.header.stamp = stamp(time)
                bag.write(connection, int(time * 1e9), serialize_message(message))


def test_command_reads_a_recording_and_prints_parameters(tmp_path, capsys):
    write_bag(tmp_path / 'sway', recorded(), '/gondola_1')
    assert main(['estimator', str(tmp_path / 'sway'), '--namespace', 'gondola_1']) == 0
    report, lines = capsys.readouterr().out.split('Lines for the parameter file:\n')
    assert 'delay' in report
    written = yaml.safe_load(lines)['/**/compensator']['ros__parameters']['estimate']
    found = (*written['mounting'], written['delay'])
    errors = np.subtract(found, (*MOUNTING, DELAY))
    assert (np.abs(errors) < LIMITS).all()


def odometry(numbers):
    message = Odometry()
    message.pose.pose = pose_message(Pose(*numbers))
    return message


@pytest.mark.parametrize('head', [estimate, odometry])
def test_head_with_covariance_is_read(tmp_path, head):
    recording = EstimatorRecording(*(table[:5] for table in recorded()))
    write_bag(tmp_path / 'sway', recording, head=head)
    found = read_estimator_recording(tmp_path / 'sway')
    assert found.wall == pytest.approx(recording.wall, abs=1e-6)


@pytest.mark.parametrize(
    ('head', 'kind'),
    [
        (lambda _: TransformStamped(), 'geometry_msgs/msg/TransformStamped'),
        (lambda _: PointStamped(), 'geometry_msgs/msg/PointStamped'),
        (lambda _: PoseMessage(), 'geometry_msgs/msg/Pose'),
        (joint_state, 'sensor_msgs/msg/JointState'),
    ],
)
def test_head_of_another_type_is_rejected(tmp_path, capsys, head, kind):
    recording = EstimatorRecording(*(table[:5] for table in recorded()))
    write_bag(tmp_path / 'sway', recording, head=head)
    assert main(['estimator', str(tmp_path / 'sway')]) == 1
    said = capsys.readouterr().err
    assert (
        f'/head_on_wall contains {kind}, expected geometry_msgs/msg/PoseStamp' in said
    )
    assert 'next: give another topic with --head' in said


def test_joint_states_as_head_are_rejected(tmp_path, capsys):
    recording = EstimatorRecording(*(table[:5] for table in recorded()))
    write_bag(tmp_path / 'sway', recording)
    words = ['estimator', str(tmp_path / 'sway'), '--head', 'joint_states']
    assert main(words) == 1
    assert (
        '/joint_states contains sensor_msgs/msg/JointState' in capsys.readouterr().err
    )


def test_recording_without_a_topic_is_rejected(tmp_path, capsys):
    recording = EstimatorRecording(*(table[:50] for table in recorded()))
    folder = tmp_path / 'sway'
    write_bag(folder, recording._replace(wall=recording.wall[:0]))
    assert main(['estimator', str(folder)]) == 1
    assert 'no valid message of /head_on_wall' in capsys.readouterr().err
    (cut,) = folder.glob('*.mcap')
    cut.write_bytes(cut.read_bytes()[:-400])
    assert main(['estimator', str(cut)]) == 1
    assert 'next: check the path' in capsys.readouterr().err
