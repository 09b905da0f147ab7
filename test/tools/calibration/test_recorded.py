"""Tables of a calibration, read from rosbag2 recordings that these tests write."""

from collections import defaultdict
import math
import shutil

import numpy as np
import pytest

from facade_manipulator.errors import CalibrationError
from facade_manipulator.estimation.settings import EstimatorSetup
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import planar_numbers, stamp_numbers
from facade_manipulator.prediction.estimate import EstimateSettings
from facade_manipulator.tools.calibration import __main__
from facade_manipulator.tools.calibration.recorded import (
    read_estimator_recording,
    read_sensors,
    read_touches,
)

rosbag2 = pytest.importorskip('rosbags.rosbag2', reason='rosbags is not installed')
from rosbags.rosbag2 import StoragePlugin, Writer  # noqa: E402 - after the skip
from rosbags.typesys import get_typestore, Stores  # noqa: E402

JAZZY = get_typestore(Stores.ROS2_JAZZY)


def make(kind, *values):
    """Return a message of a type from its values in the order of its definition."""
    return JAZZY.types[kind.replace('/', '/msg/')](*values)


def header(time):
    return make('std_msgs/Header', make('builtin_interfaces/Time', *stamp_numbers(time)), '')


def vector(x, y, z=0.0):
    return make('geometry_msgs/Vector3', x, y, z)


def pose(at):
    *position, qx, qy, qz, qw = planar_numbers(at)
    return make('geometry_msgs/Pose', make('geometry_msgs/Point', *position),
                make('geometry_msgs/Quaternion', qx, qy, qz, qw))


def pose_message(time, at):
    return make('geometry_msgs/PoseStamped', header(time), pose(at))


def estimate(time, at):
    return make('geometry_msgs/PoseWithCovarianceStamped', header(time), make(
        'geometry_msgs/PoseWithCovariance', pose(at), np.zeros(36)))


def odometry(time, at):
    no_twist = make('geometry_msgs/TwistWithCovariance', make(
        'geometry_msgs/Twist', vector(0.0, 0.0), vector(0.0, 0.0)), np.zeros(36))
    return make('nav_msgs/Odometry', header(time), 'rail', estimate(time, at).pose, no_twist)


def carriages(time, **positions):
    return make('sensor_msgs/JointState', header(time), list(positions),
                np.array(list(positions.values())), np.zeros(0), np.zeros(0))


def point(time, x):
    return make('geometry_msgs/PointStamped', header(time), make('geometry_msgs/Point', x, 0., 0.))


def wrench(time, push):
    return make('geometry_msgs/WrenchStamped', header(time), make(
        'geometry_msgs/Wrench', vector(1.0, push), vector(0.0, 0.0)))


def imu(time, covariance_of_rates):
    return make(
        'sensor_msgs/Imu', header(time), make('geometry_msgs/Quaternion', 0.0, 0.0, 0.0, 1.0),
        np.zeros(9), vector(1.0, 2.0, 3.0), np.array([covariance_of_rates, *[0.0] * 8]),
        vector(4.0, 5.0, 9.8), np.array([0.01, *[0.0] * 8]))


def distance(time, measured):
    return make('sensor_msgs/Range', header(time), 1, 0.01, 0.05, 4.0, measured, 0.0)


@pytest.fixture
def topics():
    """Messages by topic: estimates out of order, one doubled, one not finite; one carriage row."""
    made = defaultdict(list)
    made['/disturbance'] = [
        estimate(time, Pose(x, 0.0, 0.01)) for time, x in (
            (10.02, 0.2), (10.0, 0.1), (10.02, 0.2), (10.04, math.nan), (10.06, 0.4))]
    made['/joint_states'] = [carriages(10.0, q3=0.0, q1=-0.1, q2=0.1)]
    return made


@pytest.fixture
def write(tmp_path, topics):
    """Return a function that writes the topics to a rosbag2 folder."""
    def written(storage=StoragePlugin.MCAP):
        folder = tmp_path / 'rosbag2_2026_11_22-08_30_00'
        with Writer(folder, version=9, storage_plugin=storage) as bag:
            for topic, messages in topics.items():
                kind = messages[0].__msgtype__
                connection = bag.add_connection(topic, kind, typestore=JAZZY)
                for number, message in enumerate(messages):
                    bag.write(connection, 10**10 + number, JAZZY.serialize_cdr(message, kind))
        return folder

    return written


@pytest.mark.parametrize('storage', list(StoragePlugin), ids=lambda one: one.name)
@pytest.mark.parametrize('is_single_file', [False, True], ids=['folder', 'file'])
def test_tables_are_in_the_order_of_their_stamps(write, topics, storage, is_single_file):
    topics['/camera'] = [pose_message(10.01, Pose(0.3, 0.25, 0.1))]
    path = write(storage)
    if is_single_file:
        (path,) = (file for file in path.iterdir() if file.name != 'metadata.yaml')
    disturbance, joints, wall = read_estimator_recording(path, 'camera')
    assert disturbance == pytest.approx(np.array([
        [10.0, 0.1, 0.0, 0.01], [10.02, 0.2, 0.0, 0.01], [10.06, 0.4, 0.0, 0.01]]))
    assert joints == pytest.approx(np.array([[10.0, -0.1, 0.1, 0.0]]))
    assert wall == pytest.approx(np.array([[10.01, 0.3, 0.25, 0.1]]))


def test_namespace_selects_the_topics_of_one_gondola(write, topics):
    topics['/disturbance'] = [estimate(10.0, Pose(9.0, 9.0, 0.0))]
    topics['/gondola_1/disturbance'] = [estimate(10.0, Pose(0.5, 0.0, 0.0))]
    topics['/gondola_1/joint_states'] = topics.pop('/joint_states')
    topics['/tracker'] = [pose_message(10.0, Pose(0.3, 0.25, 0.0))]
    disturbance, _, _ = read_estimator_recording(write(), '/tracker', 'gondola_1')
    assert disturbance[0, 1] == pytest.approx(0.5)


def test_odometry_is_read_where_no_disturbance_was_recorded(write, topics):
    del topics['/disturbance']
    topics['/disturbance_odometry'] = [odometry(10.0, Pose(0.1, 0.2, 0.0))]
    topics['/head_on_wall'] = [pose_message(10.0, Pose(0.3, 0.25, 0.0))]
    disturbance, _, _ = read_estimator_recording(write())
    assert disturbance == pytest.approx(np.array([[10.0, 0.1, 0.2, 0.0]]))


def test_lateral_offset_shows_x_without_a_measured_head(write, topics):
    topics['/compensator/reference'] = [
        pose_message(10.0, Pose(0.1, 0.25, 0.0)), pose_message(11.0, Pose(0.2, 0.25, 0.0))]
    topics['/lateral_offset'] = [point(10.5, 0.002)]
    _, _, ((time, x, y, theta),) = read_estimator_recording(write())
    assert (time, x) == pytest.approx((10.5, 0.148))
    assert math.isnan(y) and math.isnan(theta)


def test_touches_have_carriages_and_rail_at_the_force(write, topics):
    topics['/joint_states'].append(carriages(11.0, q1=0.0, q2=0.2, q3=0.1))
    topics['/disturbance'].append(estimate(11.0, Pose(0.1, 0.0, 0.01)))
    topics['/contact_wrench'] = [wrench(time, push) for time, push in (
        (9.0, 20.0), (10.02, -0.2), (10.03, -20.0), (12.0, -20.0))]
    found = read_touches(write(), EstimateSettings(delay=0.02, mounting=(0.0, 0.0, 0.01)))
    assert found.times == pytest.approx([10.03]) and found.forces == pytest.approx([20.0])
    assert found.carriages == pytest.approx(np.array([[-0.097, 0.103, 0.003]]))
    # the stamps have whole nanoseconds
    assert found.rails == pytest.approx(np.array([[0.35, 0.0, 0.0]]), abs=1e-7)


def test_recording_without_a_touch_is_rejected(write, topics):
    topics['/joint_states'].append(carriages(11.0, q1=0.0, q2=0.2, q3=0.1))
    topics['/disturbance'].append(estimate(11.0, Pose(0.1, 0.0, 0.01)))
    topics['/contact_wrench'] = [wrench(10.02, -0.2)]
    with pytest.raises(CalibrationError, match='did not touch the wall with 1.5 N'):
        read_touches(write(), EstimateSettings())


def test_distances_outside_their_range_are_left_out(write, topics):
    topics['/imu'] = [imu(10.0, 0.0), imu(10.01, -1.0)]
    topics['/fix_x'] = [point(9.9, 0.1)]
    for name in ('/range_1', '/range_2'):
        topics[name] = [distance(time, value) for time, value in (
            (9.9, 0.45), (9.91, 7.0), (9.92, math.inf), (9.93, 0.46))]
    measured, walls = read_sensors(write(), EstimatorSetup.of({'poses': ('',)}))
    assert measured == pytest.approx(np.array([[10.0, 1.0, 2.0, 3.0, 4.0, 5.0, 9.8]]))
    assert walls['range_2'] == pytest.approx(np.array([[9.9, 0.45], [9.93, 0.46]]))
    assert walls['fix_x'] == pytest.approx(np.array([[9.9, 0.1]]))


def test_missing_topic_is_named_with_those_present(write):
    with pytest.raises(CalibrationError, match=(
            'no message of /head_on_wall, only of /disturbance, /joint_states; next: record')):
        read_estimator_recording(write())


def test_topic_without_a_valid_message_is_named(write, topics):
    topics['/disturbance'] = [estimate(10.0, Pose(math.nan, 0.0, 0.0))]
    with pytest.raises(CalibrationError, match='none of 1 messages of /disturbance is valid'):
        read_estimator_recording(write())


def test_empty_recording_is_rejected_with_the_next_step(write, topics):
    topics.clear()
    with pytest.raises(CalibrationError, match='has no messages; next: check that the nodes ran'):
        read_estimator_recording(write())


def test_absent_recording_is_rejected(tmp_path):
    with pytest.raises(CalibrationError, match=r'none\.mcap cannot be read: .*next: check the p'):
        read_estimator_recording(tmp_path / 'none.mcap')


def test_folder_without_metadata_is_rejected_with_the_next_step(write):
    folder = write()
    (folder / 'metadata.yaml').unlink()
    with pytest.raises(CalibrationError, match='cannot be read: .*next: ros2 bag reindex .+bag2'):
        read_estimator_recording(folder)


@pytest.mark.parametrize('share', [0.0, 0.001, 0.1, 0.5, 0.99])
@pytest.mark.parametrize('storage', list(StoragePlugin), ids=lambda one: one.name)
def test_cut_file_is_rejected_with_the_next_step(write, storage, share):
    folder = write(storage)
    (file,) = (one for one in folder.iterdir() if one.name != 'metadata.yaml')
    content = file.read_bytes()
    file.write_bytes(content[:int(share * len(content))])
    for path in (folder, file):
        with pytest.raises(CalibrationError, match='cannot be read: .+; next: .*`mcap recover`'):
            read_estimator_recording(path)


def test_damaged_bytes_are_rejected_or_harmless(write, topics):
    topics['/head_on_wall'] = [pose_message(10.0, Pose(0.3, 0.25, 0.0))]
    folder, rejected = write(), 0
    (file,) = folder.glob('*.mcap')
    content = file.read_bytes()
    for place in range(0, len(content), len(content) // 50):
        file.write_bytes(content[:place] + bytes([content[place] ^ 0xff]) + content[place + 1:])
        try:
            read_estimator_recording(file)
        except CalibrationError:
            rejected += 1
    assert rejected > 10


def test_command_reports_a_missing_topic_and_fails(write, tmp_path, capsys):
    shutil.move(write(), tmp_path / 'bag')
    assert __main__.main(['estimator', str(tmp_path / 'bag')]) == 1
    assert 'calibrate: ' in (error := capsys.readouterr().err) and '/head_on_wall' in error
