"""Simulated world as a node."""

import math
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray
import pytest
from rclpy.parameter import Parameter

from facade_manipulator import topics
from facade_manipulator.kinematics import compose, Geometry, inverse_kinematics, Pose
from facade_manipulator.nodes.conversions import joint_state, pose_stamped, ros_time
from facade_manipulator.nodes.messages import planar_pose, seconds
from facade_manipulator.simulation import gondola_simulator
from facade_manipulator.simulation.gondola_simulator import GondolaSimulatorNode, POSES

HEAD = Pose(0.03, 0.25, 0.02)  # in frame rail
POSITIONS = inverse_kinematics(Geometry(), HEAD)


class Bench:
    """Simulator, and carriages at rest."""

    def __init__(self, ros, **parameters):
        self.ros, self.node = ros, ros.node()
        self.simulator = GondolaSimulatorNode(parameter_overrides=[
            Parameter(name, value=value) for name, value in parameters.items()])
        ros.add(self.simulator)
        self.joints = self.node.create_publisher(*topics.JOINT_STATES)
        ros.until(self.joints.get_subscription_count, 'the simulator')

    def collect(self, topic):
        return self.ros.collect(self.node, *topic)

    def send(self, positions=POSITIONS):
        self.joints.publish(joint_state(ros_time(), positions, (0.0, 0.0, 0.0)))


def test_estimates_have_latency_frame_and_variances(ros):
    bench, received = Bench(ros), []
    kind, name, qos = topics.DISTURBANCE
    bench.node.create_subscription(
        kind, name, lambda message: received.append((ros_time(), message)), qos)
    ros.until(lambda: len(received) >= 20, 'twenty estimates')
    arrival, message = received[-1]
    assert message.header.frame_id == 'facade'
    assert arrival - seconds(message.header.stamp) > 0.039
    assert message.pose.covariance[[0, 35]] == pytest.approx((1e-6, math.radians(0.1) ** 2))


def test_head_and_errors_follow_rail_carriages_and_goal(ros):
    bench = Bench(ros)
    received = [bench.collect(topic) for topic in POSES]
    goals = bench.node.create_publisher(*topics.GOAL_POSE)
    ros.until(goals.get_subscription_count, 'the subscription of goals')
    goals.publish(pose_stamped('facade', ros_time(), HEAD))
    bench.node.create_timer(0.02, bench.send)
    ros.until(lambda: all(len(poses) > 10 for poses in received), 'the errors')
    tables = [{seconds(one.header.stamp): planar_pose(one.pose, 'pose') for one in poses}
              for poses in received]
    newest = max(set.intersection(*map(set, tables)))
    head, rail, error, uncompensated = (table[newest] for table in tables)
    assert head == pytest.approx(compose(rail, HEAD), abs=1e-4)
    assert error.y == pytest.approx(head.y - HEAD.y)
    assert uncompensated.y == pytest.approx(head.y - HEAD.y, abs=1e-3)  # the carriages stand still


def test_wall_acts_on_head_sensor_and_carriages(ros):
    bench = Bench(ros, scenario='pressing')
    wrenches, loads = map(bench.collect, (topics.CONTACT_WRENCH, topics.CARRIAGE_FORCES))
    bench.node.create_timer(0.02, bench.send)
    ros.until(lambda: any(message.wrench.force.y < -5.0 for message in wrenches), 'a wrench')
    # The wall at 0.19 m pushes a head at 0.25 m back; the loads may arrive after the wrench.
    ros.until(lambda: any(one.effort[0] > 0.0 > one.effort[1] for one in loads), 'the loads')


@pytest.mark.parametrize(('scenario', 'published'), [
    ('breeze', [topics.DISTURBANCE]),
    ('sensors', [topics.IMU, topics.RANGE_1, topics.RANGE_2, topics.FIX_X])])
def test_simulator_publishes_only_measurements_of_its_scenario(ros, scenario, published):
    bench = Bench(ros, scenario=scenario)
    received = [bench.collect(topic) for topic in published]
    ros.until(lambda: all(received), 'the measurements')
    names = {publisher.topic_name.rpartition('/')[2] for publisher in bench.simulator.publishers}
    assert names - {'diagnostics', 'rosout', 'parameter_events'} == {
        topic.name.rpartition('/')[2] for topic in (*POSES, *published)}


@pytest.mark.parametrize('positions', [(-0.49, 0.49, 0.0), (math.nan, 0.1, 0.0)])
def test_impossible_joint_states_are_rejected_and_counted(ros, positions):
    bench = Bench(ros)
    diagnostics = ros.collect(bench.node, DiagnosticArray, '/diagnostics')
    heads = bench.collect(topics.HEAD_POSE)
    bench.send(positions)
    ros.until(lambda: any(
        item.key == 'rejected' and item.value == '1' for message in diagnostics
        for item in message.status[0].values), 'the count of the rejection')
    assert not heads


def test_viewer_is_closed_with_the_node(ros, monkeypatch):
    calls = []
    monkeypatch.setattr(gondola_simulator, 'open_viewer', lambda world: SimpleNamespace(
        sync=lambda: calls.append('sync'), close=lambda: calls.append('close')))
    bench = Bench(ros, viewer=True)
    ros.until(lambda: 'sync' in calls, 'a picture')
    bench.simulator.close()
    assert calls[-1] == 'close'
