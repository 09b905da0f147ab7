"""Variances of all inputs: one rule decides whether a value was measured."""

import math

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from nodes.node_rig import NodeBench
import pytest
from sensor_msgs.msg import Imu, Range

from facade_manipulator import topics
from facade_manipulator.errors import InputError
from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.conversions import stamp
from facade_manipulator.nodes.disturbance_estimator import DisturbanceEstimatorNode

UNMEASURED = (-1.0, -math.inf, math.nan, math.inf, 1e9)


class Compensation(NodeBench):
    """Compensator, which receives messages without the middleware."""

    def __init__(self, ros):
        super().__init__(ros, CompensatorNode)
        self._estimates = []
        correction = self.tested._compensator.correction
        correction.add_estimate = self._estimates.append

    def receive(self, message):
        """Return whether the compensator uses x of an estimate."""
        self.tested._add_estimate(message)
        return self._estimates[-1].known[0]


class Estimation(NodeBench):
    """Estimator, which receives messages without the middleware."""

    def __init__(self, ros):
        super().__init__(ros, DisturbanceEstimatorNode)

    def receive(self, message):
        """Return whether the estimator uses the first value of a message."""
        node = self.tested
        estimator = self.tested._estimator
        stamps = [one.stamp for one in estimator.channels.values()]
        try:
            if isinstance(message, Imu):
                node._receive_imu(message)
                return estimator._gate.stamp > 0.0
            if isinstance(message, Range):
                node._receive_distance('range_1', message)
            else:
                node._receive_pose('fix_pose', message)
                return estimator.channels['fix_pose.x'].stamp > 0.0
        except InputError as error:
            assert error.reason == 'not_measured'
        return stamps != [one.stamp for one in estimator.channels.values()]


def _set_pose(message, variance):
    message.header.frame_id = 'facade'
    message.pose.pose.orientation.w = 1.0
    message.pose.covariance[0] = variance
    return message


def _pose(variance):
    return _set_pose(PoseWithCovarianceStamped(), variance)


def _odometry(variance):
    return _set_pose(Odometry(child_frame_id='rail'), variance)


def _imu(rates=0.0, forces=0.0):
    message = Imu()
    message.linear_acceleration.z = 9.81
    message.angular_velocity_covariance[0] = rates
    message.linear_acceleration_covariance[0] = forces
    return message


def _range(variance):
    return Range(min_range=0.1, max_range=2.0, range=0.5, variance=variance)


INPUTS = [  # each input whose message has variances
    (topics.DISTURBANCE, Compensation, _pose),
    (topics.DISTURBANCE_ODOMETRY, Compensation, _odometry),
    (topics.FIX_POSE, Estimation, _pose),
    (topics.IMU, Estimation, _imu),
    (topics.IMU, Estimation, lambda variance: _imu(forces=variance)),
    (topics.RANGE_1, Estimation, _range),
    (topics.RANGE_2, Estimation, _range),
]


def _variances(kind):
    """Return whether a message type has variances."""
    fields = kind.get_fields_and_field_types()
    return any(
        'variance' in f'{name} {type_name}'.lower()
        for name, type_name in fields.items()
    )


def test_table_has_all_inputs_with_variances():
    found = set()
    for one in vars(topics).values():
        if isinstance(one, topics.Topic) and _variances(one.type):
            found.add(one.name)
    assert found == {topic.name for topic, _, _ in INPUTS}


@pytest.mark.parametrize(('topic', 'bench', 'message'), INPUTS)
def test_unmeasured_value_of_each_input_is_not_used(ros, topic, bench, message):
    tested = bench(ros)

    def is_used(variance):
        sent = message(variance)
        sent.header.stamp = stamp(tested.now())
        return tested.receive(sent)

    assert [variance for variance in UNMEASURED if is_used(variance)] == []
    assert is_used(0.0)
