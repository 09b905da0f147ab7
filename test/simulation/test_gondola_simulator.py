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
from facade_manipulator.nodes.conversions import joint_state, pose_stamped
from facade_manipulator.nodes.messages import planar_pose, seconds
from facade_manipulator.simulation import gondola_simulator
from facade_manipulator.simulation.gondola_simulator import GondolaSimulatorNode
from facade_manipulator.topics import GOAL_POSE, JOINT_STATES

HEAD = Pose(0.03, 0.25, 0.02)  # in frame rail
POSITIONS = inverse_kinematics(Geometry(), HEAD)
POSES = 'head_pose', 'rail_pose', 'wall_error', 'uncompensated_error'


class Bench:
    """A simulator, and carriages that stand still."""

    def __init__(self, ros, **parameters):
        self.ros, self.node = ros, ros.node()
        self.simulator = GondolaSimulatorNode(parameter_overrides=[
            Parameter(name, value=value) for name, value in parameters.items()])
        ros.add(self.simulator)
        self.joints = self.node.create_publisher(*JOINT_STATES)
        self.poses = {name: ros.collect(
            self.node, PoseStamped, f'gondola_simulator/{name}') for name in POSES}
        ros.until(self.joints.get_subscription_count, 'the simulator')

    def now(self):
        return self.node.get_clock().now().nanoseconds * 1e-9

    def send(self, positions=POSITIONS):
        self.joints.publish(joint_state(self.now(), positions, (0.0, 0.0, 0.0)))

    def stand(self):
        self.node.create_timer(0.02, self.send)
        self.ros.until(lambda: len(self.poses['head_pose']) > 10, 'the head')

    def newest(self, *names):
        """Return the poses of the newest instant that all topics have."""
        tables = [{seconds(one.header.stamp): planar_pose(one.pose, name)
                   for one in self.poses[name]} for name in names]
        newest = max(set.intersection(*map(set, tables)))
        return [table[newest] for table in tables]


def test_estimates_come_late_with_frame_and_variances(ros):
    bench, received = Bench(ros), []
    bench.node.create_subscription(
        PoseWithCovarianceStamped, 'disturbance',
        lambda message: received.append((bench.now(), message)), qos_profile_sensor_data)
    ros.until(lambda: len(received) >= 20, 'twenty estimates')
    arrival, message = received[-1]
    assert message.header.frame_id == 'facade'
    assert arrival - seconds(message.header.stamp) > 0.039
    assert message.pose.covariance[[0, 35]] == pytest.approx((1e-6, math.radians(0.1) ** 2))


def test_head_and_errors_follow_rail_carriages_and_goal(ros):
    bench = Bench(ros)
    goals = bench.node.create_publisher(*GOAL_POSE)
    ros.until(goals.get_subscription_count, 'the subscription of goals')
    bench.stand()
    assert not bench.poses['wall_error']
    goals.publish(pose_stamped('facade', bench.now(), HEAD))
    ros.until(lambda: len(bench.poses['uncompensated_error']) > 5, 'the errors')
    head, rail, error, uncompensated = bench.newest(*POSES)
    assert head == pytest.approx(compose(rail, HEAD), abs=1e-4)
    assert error.y == pytest.approx(head.y - HEAD.y)
    assert uncompensated.y == pytest.approx(head.y - HEAD.y, abs=1e-3)  # the carriages stand still


def test_wall_pushes_head_sensor_and_carriages(ros):
    bench = Bench(ros, scenario='pressing')
    wrenches = ros.collect(bench.node, WrenchStamped, 'contact_wrench', qos_profile_sensor_data)
    loads = ros.collect(bench.node, JointState, 'gondola_simulator/carriage_forces')
    bench.stand()
    ros.until(lambda: any(message.wrench.force.y < -5.0 for message in wrenches), 'a wrench')
    # the wall at 0.19 m pushes a head at 0.25 m back; the loads may arrive after the wrench
    ros.until(lambda: any(one.effort[0] > 0.0 > one.effort[1] for one in loads), 'the loads')


@pytest.mark.parametrize(('scenario', 'absent', 'present'), [
    ('breeze', {'imu', 'fix_x', 'contact_wrench'}, {'disturbance'}),
    ('sensors', {'disturbance', 'contact_wrench'}, {'imu', 'range_1', 'range_2', 'fix_x'}),
    ('pressing', {'imu'}, {'disturbance', 'contact_wrench'})])
def test_simulator_publishes_only_the_topics_of_its_scenario(ros, scenario, absent, present):
    node = Bench(ros, scenario=scenario).simulator
    names = {publisher.topic_name.lstrip('/') for publisher in node.publishers}
    assert present <= names and not names & absent


@pytest.mark.parametrize('positions', [(-0.49, 0.49, 0.0), (math.nan, 0.1, 0.0)])
def test_impossible_joint_states_are_rejected_and_counted(ros, positions):
    bench = Bench(ros)
    diagnostics = ros.collect(bench.node, DiagnosticArray, '/diagnostics')
    bench.send(positions)
    ros.until(lambda: any(
        item.key == 'rejected' and item.value == '1' for message in diagnostics
        for item in message.status[0].values), 'the count of the rejection')
    assert not bench.poses['head_pose']


def test_viewer_without_a_display_is_rejected(ros, monkeypatch):
    for variable in ('DISPLAY', 'WAYLAND_DISPLAY'):
        monkeypatch.delenv(variable, raising=False)
    with pytest.raises(ParameterError, match='this computer has no display'):
        Bench(ros, viewer=True)


def test_viewer_is_closed_with_the_node(ros, monkeypatch):
    calls = []
    monkeypatch.setattr(gondola_simulator, 'open_viewer', lambda world: SimpleNamespace(
        sync=lambda: calls.append('sync'), close=lambda: calls.append('close')))
    bench = Bench(ros, viewer=True)
    ros.until(lambda: 'sync' in calls, 'a picture')
    bench.simulator.close()
    assert calls[-1] == 'close'
