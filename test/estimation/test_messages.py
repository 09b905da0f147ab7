"""What of a sensor's message reaches the estimator, and which sensors the settings name."""

import math

from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped
import pytest
from sensor_msgs.msg import Imu, Range

from facade_manipulator.errors import InputError
from facade_manipulator.estimation.messages import FIX, IMU, inputs, POSE, RANGE
from facade_manipulator.estimation.settings import EstimatorSetup


class Taken(list):
    """An estimator that notes what it is given."""

    def add(self, name, now, stamp, value, variance=None):
        self.append((name, now, stamp, pytest.approx(value), variance))

    def add_imu(self, now, stamp, rates, forces):
        self.append((now, stamp, tuple(rates), tuple(forces)))


def taken(kind, message):
    estimator = Taken()
    kind.add(estimator, 'one', 1.0, 0.9, kind.numbers_of(message))
    return estimator


def imu(rate_covariance=0.0, force_covariance=0.0):
    message = Imu()
    message.angular_velocity.x, message.angular_velocity.y, message.angular_velocity.z = 1., 2., 3.
    force = message.linear_acceleration
    force.x, force.y, force.z = 4.0, 5.0, 6.0
    message.angular_velocity_covariance[0] = rate_covariance
    message.linear_acceleration_covariance[0] = force_covariance
    return message


def test_an_imu_gives_what_it_measures_and_says_what_it_does_not():
    assert taken(IMU, imu()) == [(1.0, 0.9, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))]
    for covariances, quantity in (((-1.0, 0.0), 'turning rate'), ((0.0, -1.0), 'acceleration')):
        with pytest.raises(InputError, match=f'no {quantity}: its covariance begins with -1'):
            taken(IMU, imu(*covariances))


@pytest.mark.parametrize(('distance', 'is_taken'), [
    (0.1, True), (0.0999, False), (4.0, True), (4.001, False), (math.nan, False)])
def test_a_distance_is_taken_within_the_range_of_its_sensor(distance, is_taken):
    kind = RANGE._replace(numbers_of=lambda _: (0.1, 4.0, distance))  # a Range has single floats
    assert RANGE.numbers_of(Range(min_range=1.0, max_range=4.0, range=2.0)) == (1.0, 4.0, 2.0)
    if is_taken:
        assert taken(kind, None) == [('one', 1.0, 0.9, distance, None)]
    else:
        with pytest.raises(InputError, match='not between its 0.1 and 4 m'):
            taken(kind, None)


def test_of_a_feature_x_counts_and_of_a_pose_each_axis_that_is_known():
    fix = PointStamped()
    fix.point.x, fix.point.y = 0.3, 7.0
    assert taken(FIX, fix) == [('one', 1.0, 0.9, 0.3, None)]
    message = PoseWithCovarianceStamped()
    pose = message.pose.pose
    pose.position.x, pose.position.y = 0.3, -0.2
    pose.orientation.z, pose.orientation.w = math.sin(0.05), math.cos(0.05)
    x, y, yaw = (('one.x', 1.0, 0.9, 0.3), ('one.y', 1.0, 0.9, -0.2), ('one.theta', 1.0, 0.9, 0.1))
    for variances, found in (((0.01, -1.0, 0.0), [(*x, 0.01), (*yaw, None)]),
                             ((0.0, 0.02, 0.5), [(*x, None), (*y, 0.02), (*yaw, 0.5)]),
                             ((-1.0, math.nan, math.inf), [(*y, None)])):
        message.pose.covariance[0], message.pose.covariance[7], message.pose.covariance[35] = (
            variances)
        assert taken(POSE, message) == found


def test_settings_name_the_sensors():
    assert inputs(EstimatorSetup.of({})) == {
        'imu': IMU, 'range_1': RANGE, 'range_2': RANGE, 'fix_x': FIX, 'fix_pose': POSE}
    values = {'distances': ('left', ''), 'fixes': ('seam',), 'poses': ('',), 'seam.delay': 0.01}
    setup = EstimatorSetup.of(values)
    assert inputs(setup).keys() == {'imu', 'left', 'seam'} and setup.fixes['seam'].delay == 0.01
