"""The disturbance estimator node, fed as drivers of sensors do."""

import math
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu, Range

from facade_manipulator.estimation.estimator import RailMotion
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import planar_pose, seconds, status_values
from facade_manipulator.nodes.disturbance_estimator import (
    DisturbanceEstimatorNode,
    odometry_numbers,
    sensor_state,
    SILENT,
)
from facade_manipulator.ros.conversions import pose_message, stamp
from facade_manipulator.ros.message_queues import MessageQueue

YAW, PERIOD = 0.01, 0.01


class Sensors:
    """A rail that stands still, turned by a small angle, its wall 0.45 m away."""

    def __init__(self, ros, **parameters):
        self.ros = ros
        self.estimator = ros.add(DisturbanceEstimatorNode(parameter_overrides=[
            Parameter(name, value=value) for name, value in {
                'range_1.mounting': [-0.5, 0.0, 0.0], 'range_2.mounting': [0.5, 0.0, 0.0],
                **parameters}.items()]))
        self.node = ros.node()
        self.publishers = {
            name: self.node.create_publisher(kind, name, qos_profile_sensor_data)
            for name, kind in (('imu', Imu), ('range_1', Range), ('range_2', Range),
                               ('fix_x', PointStamped), ('fix_pose', PoseWithCovarianceStamped))}
        self.estimates = ros.collect(
            self.node, Odometry, 'disturbance_odometry', qos_profile_sensor_data)
        self.diagnostics = ros.collect(self.node, DiagnosticArray, '/diagnostics')
        imu = self.publishers['imu']
        ros.until(lambda: imu.get_subscription_count() == 1, 'the estimator')

    def send(self, name, message, age=0.004):
        now = self.node.get_clock().now().nanoseconds * 1e-9
        message.header.stamp = stamp(now - age)
        self.publishers[name].publish(message)

    def measure(self, gravity=9.81, distance=0.45, without=''):
        imu = Imu()
        imu.linear_acceleration.z = gravity
        if without:
            getattr(imu, f'{without}_covariance')[0] = -1.0
        self.send('imu', imu)
        for name, place in (('range_1', -0.5), ('range_2', 0.5)):
            self.send(name, Range(min_range=0.1, max_range=2.0, range=distance - place * YAW))
        fix = PointStamped()
        fix.point.x = 0.03
        self.send('fix_x', fix, age=0.05)

    def status(self, name):
        """Return level, message and values of a component, of the newest diagnostics."""
        for message in reversed(self.diagnostics):
            for item in message.status:
                if item.name == f'disturbance_estimator: {name}':
                    return item.level[0], item.message, status_values(item)
        return None

    def until_estimates(self, count=50):
        self.ros.until(lambda: len(self.estimates) >= count, 'estimates')
        return self.estimates[-1]


@pytest.fixture
def sensors(ros):
    made = Sensors(ros)
    made.timer = made.node.create_timer(PERIOD, made.measure)
    return made


def test_raw_sensors_become_an_odometry_of_the_rail_with_its_covariance(sensors):
    estimate = sensors.until_estimates(150)
    assert (estimate.header.frame_id, estimate.child_frame_id) == ('facade', 'rail')
    pose = planar_pose(estimate.pose.pose, 'estimate')
    assert pose.theta == pytest.approx(YAW, abs=1e-3)
    assert (pose.x, pose.y) == pytest.approx((0.0, 0.0), abs=0.02)
    assert 0.0 < estimate.pose.covariance[35] < 1e-5
    assert 0.0 < estimate.twist.covariance[0] < 1e-2
    assert estimate.twist.twist.linear.x == pytest.approx(0.0, abs=0.02)
    now = sensors.node.get_clock().now().nanoseconds * 1e-9
    assert now - seconds(estimate.header.stamp) < 1.0


@pytest.mark.quick
def test_sensor_with_two_publishers_is_not_used_and_is_named(sensors):
    sensors.until_estimates(5)
    foreign = sensors.ros.node('rosbag2_player').create_publisher(
        Range, 'range_1', qos_profile_sensor_data)
    sensors.ros.until(
        lambda: 'range_1 has 2 publishers (/rosbag2_player, /tester), bound 1'
        in sensors.status('motion')[1], 'the error')
    used = sensors.estimator._estimator.records['range_1'].counts.total()
    foreign.publish(Range(min_range=0.1, max_range=2.0, range=1.5))
    rejected = sensors.estimator._rejections.total
    sensors.ros.until(lambda: sensors.estimator._rejections.total > rejected + 5, 'rejections')
    assert sensors.estimator._estimator.records['range_1'].counts.total() == used


@pytest.mark.quick
def test_diagnostics_say_what_each_sensor_does_and_the_log_each_event_once(sensors, capfd):
    sensors.until_estimates()
    sensors.ros.until(lambda: sensors.status('motion') and sensors.status('motion')[0] == 0,
                      'a motion that is estimated')
    level, message, values = sensors.status('sensor range_1')
    assert (level, message) == (0, 'measuring') and int(values['measurements: used']) > 0
    assert 1.0 < float(values['rate [Hz]']) < 2.0 / PERIOD
    assert 'standard deviation of x [mm]' in sensors.status('motion')[2]
    assert sensors.status('sensor fix_pose.x')[1] == 'nothing has come of it'
    said, events = capfd.readouterr().err, sensors.estimator._estimator.events
    assert events and {said.count(f'{event.subject}: {event.reason}') for event in events} == {1}


@pytest.mark.quick
def test_without_an_imu_it_goes_on_and_warns(sensors):
    sensors.until_estimates()
    sensors.timer.cancel()
    sensors.ros.until(lambda: 'constant acceleration' in (sensors.status('motion') or '  ')[1],
                      'a warning')


def test_a_computer_that_stops_the_node_for_a_moment_while_it_takes_starts_nothing_again(
        sensors, monkeypatch):
    sensors.until_estimates()
    take = MessageQueue.take

    def late(queue):
        sensors.measure()
        time.sleep(0.05)
        return take(queue)

    monkeypatch.setattr(MessageQueue, 'take', late)
    count = len(sensors.estimates)
    sensors.ros.until(lambda: len(sensors.estimates) > count + 5, 'more estimates')
    assert not [event for event in sensors.estimator._estimator.events
                if 'starts again' in event.reason]


@pytest.mark.quick
def test_bad_input_is_counted_with_its_reason(ros):
    sensors = Sensors(ros)
    for reason, spoil in (
            ('not_finite', lambda: sensors.measure(gravity=math.nan)),
            ('not_measured', lambda: sensors.measure(without='angular_velocity')),
            ('range', lambda: sensors.measure(distance=7.0)),
            ('future', lambda: sensors.send('imu', Imu(), age=-0.5)),
            ('frame', lambda: sensors.send('fix_pose', PoseWithCovarianceStamped()))):
        timer = sensors.node.create_timer(0.002, spoil)
        ros.until(lambda r=reason: f'rejected: {r}' in (sensors.status('motion') or ({},) * 3)[2],
                  f'a rejection: {reason}')
        timer.cancel()


@pytest.mark.quick
def test_a_pose_of_somebody_else_is_used_without_the_axes_that_it_does_not_know(ros):
    sensors = Sensors(ros, distances=[''], fixes=[''])

    def send():
        message = PoseWithCovarianceStamped()
        message.header.frame_id = 'facade'
        message.pose.pose = pose_message(Pose(0.05, 0.7, 0.02))
        message.pose.covariance[7] = -1.0
        sensors.send('fix_pose', message, age=0.05)

    sensors.node.create_timer(0.02, send)
    estimate = sensors.until_estimates()
    pose = planar_pose(estimate.pose.pose, 'estimate')
    assert (pose.x, pose.theta) == pytest.approx((0.05, 0.02), abs=5e-3)
    assert estimate.pose.covariance[7] > 0.5
    ros.until(lambda: sensors.status('motion') and 'y: not known' in sensors.status('motion')[1],
              'what is not known')


@pytest.mark.parametrize('age, used, outliers, level, message', [
    (math.inf, 0, 0, 'ok', 'nothing has come of it'), (SILENT, 5, 5, 'warn', 'silent or rejected'),
    (0.9 * SILENT, 0, 0, 'ok', 'measuring'), (0.0, 5, 5, 'ok', 'measuring'),
    (0.0, 4, 5, 'warn', 'most of it fits nothing'), (SILENT, 0, 9, 'warn', 'silent or rejected')])
def test_a_sensor_is_silent_or_wrong_or_measures(age, used, outliers, level, message):
    assert sensor_state(age, used, outliers) == (level, message)


components = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3)
roots = st.lists(components, min_size=3, max_size=3).map(np.array)


@given(components, components, roots, roots)
def test_an_odometry_has_pose_and_twist_each_along_the_axes_of_its_frame(
        pose, velocity, root, velocity_root):
    motion = RailMotion(
        1.0, Pose(*pose), velocity, root @ root.T, velocity_root @ velocity_root.T)
    numbers = odometry_numbers(motion)
    place, variances, twist, velocity_variances = (
        np.array(numbers[begin:end]) for begin, end in ((0, 7), (7, 43), (43, 49), (49, 85)))
    assert len(numbers) == 85 and place[:3] == pytest.approx([*pose[:2], 0.0])
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    assert complex(cosine, sine) == pytest.approx(complex(place[6], place[5]) ** 2)
    back = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    planar = np.ix_((0, 1, 5), (0, 1, 5))
    assert back @ twist[[0, 1, 5]] == pytest.approx(np.array(velocity), abs=1e-9)
    assert variances.reshape(6, 6)[planar] == pytest.approx(motion.covariance)
    assert back @ velocity_variances.reshape(6, 6)[planar] @ back.T == pytest.approx(
        motion.velocity_covariance, abs=1e-9)
    for whole in (variances, velocity_variances):  # what is out of the plane is not known of
        assert np.count_nonzero(whole) <= 9
    assert not twist[[2, 3, 4]].any()
