"""The disturbance estimator node, fed as drivers of sensors do."""

from collections import Counter
import math

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu, Range

from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import planar_pose, seconds, status_values
from facade_manipulator.nodes.conversions import pose_message, stamp
from facade_manipulator.nodes.disturbance_estimator import (
    DisturbanceEstimatorNode,
    sensor_outcome,
    SILENCE,
)

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


def test_raw_sensors_give_odometry_with_covariance(sensors):
    estimate = sensors.until_estimates(150)
    assert (estimate.header.frame_id, estimate.child_frame_id) == ('facade', 'rail')
    pose = planar_pose(estimate.pose.pose, 'estimate')
    assert pose.theta == pytest.approx(YAW, abs=1e-3)
    assert (pose.x, pose.y) == pytest.approx((0.0, 0.0), abs=0.02)
    assert 0.0 < estimate.pose.covariance[35] < 1e-5
    assert 0.0 < estimate.twist.covariance[0] < 1e-2
    assert estimate.twist.twist.linear.x == pytest.approx(0.0, abs=0.02)
    for covariance in (estimate.pose.covariance, estimate.twist.covariance):
        indices = {k for k, value in enumerate(covariance) if value}
        assert {0, 7, 35} <= indices <= {0, 1, 5, 6, 7, 11, 30, 31, 35}  # x, y and yaw
    now = sensors.node.get_clock().now().nanoseconds * 1e-9
    assert now - seconds(estimate.header.stamp) < 1.0


@pytest.mark.quick
def test_sensor_with_two_publishers_is_not_used(sensors):
    sensors.until_estimates(5)
    foreign = sensors.ros.node('rosbag2_player').create_publisher(
        Range, 'range_1', qos_profile_sensor_data)
    sensors.ros.until(
        lambda: 'range_1 has 2 publishers (/rosbag2_player, /tester), bound 1'
        in sensors.status('motion')[1], 'the error')
    foreign.publish(Range(min_range=0.1, max_range=2.0, range=1.5))

    def wait_for_rejections():
        rejected = sensors.estimator.rejections.total
        sensors.ros.until(lambda: sensors.estimator.rejections.total > rejected + 5, 'rejections')
        return sensors.estimator._estimator.records['range_1'].counts.total()

    used = wait_for_rejections()  # until then a measurement of before may still be used
    assert wait_for_rejections() == used


@pytest.mark.quick
def test_diagnostics_have_each_sensor_and_log_each_event(sensors, capfd):
    sensors.until_estimates()
    sensors.ros.until(lambda: sensors.status('motion') and sensors.status('motion')[0] == 0,
                      'a motion that is estimated')
    level, message, values = sensors.status('sensor range_1')
    assert (level, message) == (0, 'measuring') and int(values['measurements: used']) > 0
    assert 1.0 < float(values['rate [Hz]']) < 2.0 / PERIOD
    assert 'standard deviation of x [mm]' in sensors.status('motion')[2]
    assert sensors.status('sensor fix_pose.x')[1] == 'no measurement has been received'
    log, events = capfd.readouterr().err, Counter(
        f'{event.subject}: {event.reason}' for event in sensors.estimator._estimator.events)
    assert events and all(log.count(text) == count for text, count in events.items())


@pytest.mark.quick
def test_estimate_without_imu_continues_with_a_warning(sensors):
    sensors.until_estimates()
    sensors.timer.cancel()
    sensors.ros.until(lambda: 'constant acceleration' in (sensors.status('motion') or '  ')[1],
                      'a warning')


@pytest.mark.quick
def test_bad_measurement_is_counted_with_its_reason(ros):
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
def test_pose_fix_is_used_without_its_unknown_axes(ros):
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
    (math.inf, 0, 0, 'ok', 'no measurement has been received'),
    (SILENCE, 5, 5, 'warn', 'silent or rejected'),
    (SILENCE, 0, 9, 'warn', 'silent or rejected'),
    (0.9 * SILENCE, 0, 0, 'ok', 'measuring'),
    (0.0, 5, 5, 'ok', 'measuring'),
    (0.0, 4, 5, 'warn', 'most measurements are outliers')])
def test_sensor_outcome_depends_on_age_and_outliers(age, used, outliers, level, message):
    assert sensor_outcome(age, used, outliers) == (level, message)
