"""The gondola simulator node."""

import json
import math
import signal

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, WrenchStamped
import pytest
from qualities import LATEST, RELIABLE
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from support import wait_until

from facade_manipulator.kinematics import Geometry, inverse_kinematics, Pose
from facade_manipulator.lab.demo.gondola_simulator import GondolaSimulatorNode
from facade_manipulator.messages import planar_pose, seconds
from facade_manipulator.ros.conversions import pose_stamped, stamp

GOAL = Pose(0.03, 0.25, 0.02)


class Manipulator:
    """A mechanism that stands still at the goal."""

    def __init__(self, ros, scenario='breeze'):
        self.ros = ros
        self.simulator = GondolaSimulatorNode(
            parameter_overrides=[Parameter('scenario', value=scenario)])
        ros.add(self.simulator)
        self.node = ros.node()
        self.goals = self.node.create_publisher(PoseStamped, 'goal_pose', LATEST)
        self.joints = self.node.create_publisher(JointState, 'joint_states', RELIABLE)
        self.errors = ros.collect(self.node, PoseStamped, 'gondola_simulator/wall_error')
        self.disturbances = ros.collect(
            self.node, PoseStamped, 'gondola_simulator/uncompensated_error')
        self.heads = ros.collect(self.node, PoseStamped, 'gondola_simulator/head_pose')
        self.diagnostics = ros.collect(self.node, DiagnosticArray, '/diagnostics')
        for publisher in (self.goals, self.joints):
            ros.until(lambda p=publisher: p.get_subscription_count() == 1, 'the simulator')

    def now(self):
        return self.node.get_clock().now().nanoseconds * 1e-9

    def send_goal(self, pose=GOAL, frame='facade'):
        self.goals.publish(pose_stamped(frame, self.now(), pose))

    def send_joints(self, names=('q1', 'q2', 'q3'), positions=None):
        message = JointState(
            name=list(names),
            position=list(positions or inverse_kinematics(Geometry(), GOAL)))
        message.header.stamp = stamp(self.now())
        self.joints.publish(message)

    def stand(self):
        self.node.create_timer(0.02, self.send_joints)

    def value(self, key):
        for message in reversed(self.diagnostics):
            for item in message.status[0].values:
                if item.key == key:
                    return item.value
        return None

    def report(self):
        return json.loads(
            self.ros.call(self.node, Trigger, 'gondola_simulator/report').message)


@pytest.fixture
def manipulator(ros):
    return Manipulator(ros)


def test_estimates_come_late_with_their_frame_and_variances(manipulator):
    node = manipulator.node
    heard = []
    node.create_subscription(
        PoseWithCovarianceStamped, 'disturbance',
        lambda message: heard.append((manipulator.now(), message)), qos_profile_sensor_data)
    manipulator.ros.until(lambda: len(heard) >= 20, 'twenty estimates')
    arrival, message = heard[-1]
    assert message.header.frame_id == 'facade'
    assert arrival - seconds(message.header.stamp) > 0.039
    assert message.pose.covariance[0] == pytest.approx(1e-6)
    assert message.pose.covariance[35] == pytest.approx(math.radians(0.1) ** 2, rel=1e-3)
    stamps = [seconds(message.header.stamp) for _, message in heard]
    assert stamps == sorted(stamps)


def test_a_mechanism_that_stands_still_has_the_uncompensated_error(manipulator):
    manipulator.send_goal()
    manipulator.stand()
    manipulator.ros.until(
        lambda: len(manipulator.errors) > 20 and len(manipulator.disturbances) > 20, 'errors')
    by_stamp = {seconds(m.header.stamp): m for m in manipulator.disturbances}
    pairs = [(m, by_stamp[seconds(m.header.stamp)]) for m in manipulator.errors
             if seconds(m.header.stamp) in by_stamp]
    assert pairs
    for error, disturbance in pairs[-5:]:  # the world's carriages first go there
        assert error.header.frame_id == 'facade'
        assert planar_pose(error.pose, 'error') == pytest.approx(
            tuple(planar_pose(disturbance.pose, 'disturbance')), abs=1e-6)


def test_the_report_counts_what_settled(manipulator):
    assert manipulator.report()['samples'] == 0
    manipulator.send_goal()
    manipulator.stand()
    manipulator.ros.until(lambda: int(manipulator.value('samples') or 0) > 20, 'samples')
    report = manipulator.report()
    for axis in ('x', 'y', 'theta'):
        assert report['axes'][axis]['attenuation_db'] == pytest.approx(0.0, abs=0.01)
        assert report['axes'][axis]['disturbance_rms'] > 0.0
        assert report['samples'] > 20


def test_gondola_feels_the_head_and_the_sensor_the_wall(ros):
    manipulator = Manipulator(ros, 'pressing')
    felt = ros.collect(manipulator.node, WrenchStamped, 'contact_wrench', qos_profile_sensor_data)
    loads = ros.collect(manipulator.node, JointState, 'gondola_simulator/carriage_forces')
    manipulator.stand()
    ros.until(lambda: any(message.wrench.force.y < -5.0 for message in felt), 'a wrench')
    ros.until(lambda: manipulator.simulator._world.rail.y < -1e-3, 'the push-back')
    outer, other, _ = loads[-1].effort  # the wall at 0.19 m pushes a head at 0.25 m back
    assert outer > 0.0 > other


def test_before_a_goal_only_the_head_is_shown(manipulator):
    manipulator.stand()
    manipulator.ros.until(lambda: len(manipulator.heads) > 5, 'the head')
    assert manipulator.errors == []


@pytest.mark.parametrize(('send', 'reason'), [
    (lambda m: m.send_goal(Pose(0.0, 0.5, 0.0)), 'unreachable'),
    (lambda m: m.send_goal(frame='rail'), 'frame'),
    (lambda m: m.send_goal(Pose(math.nan, 0.25, 0.0)), 'not_finite'),
    (lambda m: m.send_joints(positions=(-0.49, 0.49, 0.0)), None),
    (lambda m: m.send_joints(names=('q1', 'q1', 'q3')), None),
    (lambda m: m.send_joints(positions=(math.nan, 0.1, 0.0)), None),
])
def test_bad_input_is_rejected_and_counted(manipulator, send, reason):
    send(manipulator)
    key = f'rejected: {reason}' if reason else 'rejected'
    manipulator.ros.until(lambda: manipulator.value(key) == '1', 'the count of the rejection')
    assert manipulator.errors == []
    assert manipulator.report()['samples'] == 0


def test_the_process_ends_cleanly_on_a_signal(start_process, ros):
    process = start_process('facade_manipulator.lab.demo.gondola_simulator')
    heard = ros.collect(ros.node(), DiagnosticArray, '/diagnostics')
    ros.until(lambda: heard, 'diagnostics')
    process.send_signal(signal.SIGINT)
    wait_until(lambda: process.poll() is not None, 'the process to end')
    assert process.returncode == 0, process.log.read_text()
