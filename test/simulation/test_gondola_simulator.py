"""The simulated world as a node."""

import math
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, WrenchStamped
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import compose, Geometry, inverse_kinematics, Pose
from facade_manipulator.nodes.conversions import pose_stamped, stamp
from facade_manipulator.nodes.messages import planar_pose, seconds
from facade_manipulator.simulation import gondola_simulator
from facade_manipulator.simulation.gondola_simulator import GondolaSimulatorNode
from facade_manipulator.topics import GOAL_POSE, RELIABLE

HEAD = Pose(0.03, 0.25, 0.02)  # in frame rail
POSITIONS = inverse_kinematics(Geometry(), HEAD)


class Carriages:
    """Carriages that stand still."""

    def __init__(self, ros, **parameters):
        self.simulator = GondolaSimulatorNode(parameter_overrides=[
            Parameter(name, value=value) for name, value in parameters.items()])
        ros.add(self.simulator)
        self.node = ros.node()
        self._joints = self.node.create_publisher(JointState, 'joint_states', RELIABLE)
        self.heads, self.rails = (ros.collect(
            self.node, PoseStamped, f'gondola_simulator/{name}') for name in (
                'head_pose', 'rail_pose'))
        ros.until(lambda: self._joints.get_subscription_count() == 1, 'the simulator')

    def now(self):
        return self.node.get_clock().now().nanoseconds * 1e-9

    def send(self, names=('q1', 'q2', 'q3'), positions=POSITIONS):
        message = JointState(name=list(names), position=list(positions))
        message.header.stamp = stamp(self.now())
        self._joints.publish(message)

    def stand(self):
        self.node.create_timer(0.02, self.send)


def test_estimates_come_late_with_frame_and_variances(ros):
    carriages, received = Carriages(ros), []
    carriages.node.create_subscription(
        PoseWithCovarianceStamped, 'disturbance',
        lambda message: received.append((carriages.now(), message)), qos_profile_sensor_data)
    ros.until(lambda: len(received) >= 20, 'twenty estimates')
    arrival, message = received[-1]
    assert message.header.frame_id == 'facade'
    assert arrival - seconds(message.header.stamp) > 0.039
    assert message.pose.covariance[[0, 35]] == pytest.approx((1e-6, math.radians(0.1) ** 2))
    stamps = [seconds(message.header.stamp) for _, message in received]
    assert stamps == sorted(stamps)


def test_published_head_is_rail_times_carriages(ros):
    carriages = Carriages(ros)
    carriages.stand()
    ros.until(lambda: len(carriages.heads) > 30 and len(carriages.rails) > 30, 'the head')
    rails = {seconds(one.header.stamp): planar_pose(one.pose, 'rail') for one in carriages.rails}
    time, head = max((seconds(one.header.stamp), planar_pose(one.pose, 'head'))
                     for one in carriages.heads if seconds(one.header.stamp) in rails)
    assert head == pytest.approx(compose(rails[time], HEAD), abs=1e-4)


def test_wall_errors_compare_head_and_rail_with_goal(ros):
    carriages = Carriages(ros)
    errors, uncompensated = (ros.collect(
        carriages.node, PoseStamped, f'gondola_simulator/{name}') for name in (
            'wall_error', 'uncompensated_error'))
    goals = carriages.node.create_publisher(*GOAL_POSE)
    ros.until(lambda: goals.get_subscription_count() == 1, 'the subscription of goals')
    carriages.stand()
    ros.until(lambda: len(carriages.heads) > 10, 'the head')
    assert not errors
    goals.publish(pose_stamped('facade', carriages.now(), HEAD))
    ros.until(lambda: errors and uncompensated, 'the errors')
    ros.until(lambda: carriages.heads[-1].header.stamp == errors[-1].header.stamp, 'one cycle')
    head = planar_pose(carriages.heads[-1].pose, 'head')
    assert planar_pose(errors[-1].pose, 'error').y == pytest.approx(head.y - HEAD.y)
    assert planar_pose(uncompensated[-1].pose, 'error').y == pytest.approx(
        head.y - HEAD.y, abs=1e-3)  # the carriages stand still


def test_wall_pushes_head_sensor_and_carriages(ros):
    carriages = Carriages(ros, scenario='pressing')
    wrenches = ros.collect(
        carriages.node, WrenchStamped, 'contact_wrench', qos_profile_sensor_data)
    loads = ros.collect(carriages.node, JointState, 'gondola_simulator/carriage_forces')
    carriages.stand()
    ros.until(lambda: any(message.wrench.force.y < -5.0 for message in wrenches), 'a wrench')
    # the wall at 0.19 m pushes a head at 0.25 m back; the loads may arrive after the wrench
    ros.until(lambda: any(one.effort[0] > 0.0 > one.effort[1] for one in loads), 'the loads')


@pytest.mark.parametrize(('scenario', 'absent', 'present'), [
    ('breeze', {'imu', 'fix_x', 'contact_wrench'}, {'disturbance'}),
    ('sensors', {'disturbance', 'contact_wrench'}, {'imu', 'range_1', 'range_2', 'fix_x'}),
    ('pressing', {'imu'}, {'disturbance', 'contact_wrench'})])
def test_simulator_publishes_only_the_topics_of_its_scenario(ros, scenario, absent, present):
    node = Carriages(ros, scenario=scenario).simulator
    names = {publisher.topic_name.lstrip('/') for publisher in node.publishers}
    assert present <= names and not names & absent


@pytest.mark.parametrize(('names', 'positions'), [
    (('q1', 'q2', 'q3'), (-0.49, 0.49, 0.0)), (('q1', 'q1', 'q3'), POSITIONS),
    (('q1', 'q2', 'q3'), (math.nan, 0.1, 0.0))])
def test_impossible_joint_states_are_rejected_and_counted(ros, names, positions):
    carriages = Carriages(ros)
    diagnostics = ros.collect(carriages.node, DiagnosticArray, '/diagnostics')
    carriages.send(names, positions)
    ros.until(lambda: any(
        item.key == 'rejected' and item.value == '1' for message in diagnostics
        for item in message.status[0].values), 'the count of the rejection')
    assert not carriages.heads


def test_viewer_without_a_display_is_rejected(ros, monkeypatch):
    for variable in ('DISPLAY', 'WAYLAND_DISPLAY'):
        monkeypatch.delenv(variable, raising=False)
    with pytest.raises(ParameterError, match='this computer has no display'):
        GondolaSimulatorNode(parameter_overrides=[Parameter('viewer', value=True)])


def test_viewer_is_closed_with_the_node(ros, monkeypatch):
    calls = []
    monkeypatch.setattr(gondola_simulator, 'open_viewer', lambda world: SimpleNamespace(
        sync=lambda: calls.append('sync'), close=lambda: calls.append('close')))
    node = GondolaSimulatorNode(parameter_overrides=[Parameter('viewer', value=True)])
    ros.add(node)
    ros.until(lambda: 'sync' in calls, 'a picture')
    node.close()
    assert calls[-1] == 'close'
