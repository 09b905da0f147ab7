"""The recorder for `calibrate estimator`."""

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from facade_manipulator.calibration.tables import read_table
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Pose
from facade_manipulator.nodes.calibration_recorder import CalibrationRecorder
from facade_manipulator.ros.conversions import pose_message, pose_stamped, stamp

POSE = Pose(0.1, 0.2, 0.05)


def recorder(folder):
    return CalibrationRecorder(parameter_overrides=[Parameter('folder', value=str(folder))])


def test_what_comes_is_written_with_its_stamp_and_read_by_the_command(ros, tmp_path):
    node, other = recorder(tmp_path), ros.node()
    ros.add(node)
    disturbance = PoseWithCovarianceStamped()
    disturbance.header.stamp, disturbance.pose.pose = stamp(12.5), pose_message(POSE)
    joints = JointState(name=['q3', 'q1', 'q2'], position=[0.0, -0.1, 0.1])
    joints.header.stamp = stamp(13.25)
    for topic, message in (('disturbance', disturbance), ('joint_states', joints),
                           ('head_on_wall', pose_stamped('facade', 14.0, POSE))):
        publisher = other.create_publisher(type(message), topic, 10)
        ros.until(lambda p=publisher: p.get_subscription_count() == 1, 'the recorder')
        publisher.publish(message)
    head = ('x', 'y', 'theta')

    def rows():
        return [len(path.read_text().splitlines()) for path in tmp_path.iterdir()]

    ros.until(lambda: rows() == [2, 2, 2], 'three rows')
    node.close()
    for name, columns, expected in (
            ('disturbance', head, (12.5, *POSE)), ('joints', ('q1', 'q2', 'q3'),
                                                   (13.25, -0.1, 0.1, 0.0)),
            ('wall', head, (14.0, *POSE))):
        (row,) = read_table(tmp_path / f'{name}.csv', ('time', *columns))
        assert row == pytest.approx(expected)


def test_what_is_no_measurement_is_counted_and_not_written(ros, tmp_path):
    node, other = recorder(tmp_path), ros.node()
    ros.add(node)
    publisher = other.create_publisher(PoseStamped, 'head_on_wall', 10)
    ros.until(lambda: publisher.get_subscription_count() == 1, 'the recorder')
    publisher.publish(pose_stamped('facade', 1.0, Pose(float('nan'), 0.0, 0.0)))
    ros.until(lambda: node._rejections.values()['rejected'] == 1, 'the rejection')
    node.close()
    assert (tmp_path / 'wall.csv').read_text().splitlines() == ['time,x,y,theta']


def test_a_folder_that_is_none_is_named(ros, tmp_path):
    with pytest.raises(ParameterError, match='cannot be written'):
        recorder(tmp_path / 'none')
