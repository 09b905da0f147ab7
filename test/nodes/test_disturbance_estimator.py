"""Disturbance estimator node, with messages like those of sensor drivers."""

import math

from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped
from nodes.node_rig import NodeBench
import pytest
from sensor_msgs.msg import Imu, Range

from facade_manipulator import topics
from facade_manipulator.kinematics import Pose
from facade_manipulator.nodes.conversions import pose_message, stamp
from facade_manipulator.nodes.disturbance_estimator import (
    DisturbanceEstimatorNode,
    sensor_outcome,
    SENSOR_SILENCE,
)
from facade_manipulator.nodes.planar_messages import planar_pose, seconds

YAW = 0.01
PERIOD = 0.01
PLANAR = {0, 1, 5, 6, 7, 11, 30, 31, 35}  # x, y and yaw in a covariance of six


class Sensors(NodeBench):
    """Sensors on a rail at rest, turned by a small angle, 0.45 m from its wall."""

    def __init__(self, ros, **parameters):
        mountings = {
            'range_1.mounting': [-0.5, 0.0, 0.0],
            'range_2.mounting': [0.5, 0.0, 0.0],
        }
        super().__init__(ros, DisturbanceEstimatorNode, mountings | parameters)
        self.estimates = self.collect(topics.DISTURBANCE_ODOMETRY)

    def events(self):
        """Return the events of the estimator as texts."""
        return [event.text for event in self.tested._estimator.events]

    def send(self, topic, message, age=0.004):
        message.header.stamp = stamp(self.now() - age)
        self.publish(topic, message)

    def measure(self, distance=0.45, without=''):
        imu = Imu()
        imu.linear_acceleration.z = 9.81
        if without:
            getattr(imu, f'{without}_covariance')[0] = -1.0
        self.send(topics.IMU, imu)
        for topic, place in ((topics.RANGE_1, -0.5), (topics.RANGE_2, 0.5)):
            self.send(
                topic, Range(min_range=0.1, max_range=2.0, range=distance - place * YAW)
            )
        fix = PointStamped()
        fix.point.x = 0.03
        self.send(topics.FIX_X, fix, age=0.05)

    def until_estimates(self, count=50):
        self.ros.until(lambda: len(self.estimates) >= count, 'estimates')
        return self.estimates[-1]


@pytest.fixture
def sensors(ros):
    made = Sensors(ros)
    made.timer = made.node.create_timer(PERIOD, made.measure)
    return made


def test_raw_sensors_give_odometry_with_covariance(sensors, capfd):
    estimate = sensors.until_estimates(120)
    assert estimate.header.frame_id == 'facade'
    assert estimate.child_frame_id == 'rail'
    pose = planar_pose(estimate.pose.pose, 'estimate')
    assert pose.theta == pytest.approx(YAW, abs=1e-3)
    assert (pose.x, pose.y) == pytest.approx((0.0, 0.0), abs=0.02)
    assert 0.0 < estimate.pose.covariance[35] < 1e-5
    assert 0.0 < estimate.twist.covariance[0] < 1e-2
    for covariance in (estimate.pose.covariance, estimate.twist.covariance):
        not_zero = {k for k, value in enumerate(covariance) if value}
        assert {0, 7, 35} <= not_zero <= PLANAR
    assert sensors.now() - seconds(estimate.header.stamp) < 1.0
    sensors.until_status('motion', 'estimating', 'ok')
    sensors.until_status('sensor range_1', 'measuring', 'ok')
    sensors.until_status('sensor fix_pose.x', 'no measurement has been received')
    assert 1.0 < float(sensors.value('sensor range_1', 'rate [Hz]')) < 2.0 / PERIOD
    events = sensors.events()
    log = capfd.readouterr().err
    assert events
    assert all(log.count(text) == events.count(text) for text in events)
    sensors.timer.cancel()
    sensors.until_status('motion', 'the acceleration is not measured', 'warn')


def test_rate_of_a_sensor_is_that_of_its_stamps(ros):
    sensors = Sensors(ros)
    newest = sensors.now()

    def send():
        """Send a fix for each 20 ms that have passed, with exact stamps after a late call."""
        nonlocal newest
        while newest + 0.02 <= sensors.now():
            newest += 0.02
            fix = PointStamped()
            fix.header.stamp = stamp(newest)
            sensors.publish(topics.FIX_X, fix)

    sensors.node.create_timer(0.02, send)

    def rate():
        return float(sensors.value('sensor fix_x', 'rate [Hz]') or 0.0)

    ros.until(lambda: rate() == pytest.approx(50.0, rel=0.01), 'the rate')


def test_bad_measurement_is_counted_with_its_reason(ros):
    sensors = Sensors(ros)
    for reason, spoil in (
        ('not_measured', lambda: sensors.measure(without='angular_velocity')),
        ('range', lambda: sensors.measure(distance=7.0)),
        ('frame', lambda: sensors.send(topics.FIX_POSE, PoseWithCovarianceStamped())),
    ):
        timer = sensors.node.create_timer(0.002, spoil)
        ros.until(lambda r=reason: sensors.value('motion', f'rejected: {r}'), reason)
        timer.cancel()
    sensors.until_status('sensor fix_pose.x', 'each measurement is rejected', 'warn')


def test_unknown_axes_of_a_pose_fix_are_ignored(ros):
    sensors = Sensors(ros, distances=[''], fixes=[''])

    def send():
        message = PoseWithCovarianceStamped()
        message.header.frame_id = 'facade'
        message.pose.pose = pose_message(Pose(0.05, 0.7, 0.02))
        message.pose.covariance[7] = -1.0
        sensors.send(topics.FIX_POSE, message, age=0.05)

    sensors.node.create_timer(0.02, send)
    estimate = sensors.until_estimates()
    pose = planar_pose(estimate.pose.pose, 'estimate')
    assert (pose.x, pose.theta) == pytest.approx((0.05, 0.02), abs=5e-3)
    assert estimate.pose.covariance[7] > 0.5
    sensors.until_status('motion', 'y is unknown', 'error')
    sensors.until_status('sensor fix_pose.y', 'was not measured', 'warn')


@pytest.mark.parametrize(
    'age, used, outliers, rejection, level, message',
    [
        (math.inf, 0, 0, '', 'ok', 'no measurement has been received'),
        (
            math.inf,
            0,
            0,
            'frame; next: a',
            'warn',
            'each measurement is rejected: frame; next: a',
        ),
        (
            SENSOR_SILENCE,
            5,
            5,
            '',
            'warn',
            'silent; next: check the sensor and its topic',
        ),
        (
            SENSOR_SILENCE,
            5,
            5,
            'old; next: a',
            'warn',
            'each measurement is rejected: old; next: a',
        ),
        (0.9 * SENSOR_SILENCE, 0, 0, 'old; next: a', 'ok', 'measuring'),
        (0.0, 5, 5, '', 'ok', 'measuring'),
        (
            0.0,
            4,
            5,
            '',
            'warn',
            'most measurements are outliers; next: check mounting and noise',
        ),
    ],
)
def test_sensor_outcome_depends_on_age_and_outliers(
    age, used, outliers, rejection, level, message
):
    assert sensor_outcome(age, used, outliers, rejection) == (level, message)
