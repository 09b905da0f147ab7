"""Simulated world as a node."""

import math
from types import SimpleNamespace

from nodes.node_rig import NodeBench
import pytest
from rclpy.parameter import Parameter

from facade_manipulator import topics
from facade_manipulator.kinematics import compose, Geometry, inverse_kinematics, Pose
from facade_manipulator.nodes.conversions import joint_state, pose_stamped, ros_time
from facade_manipulator.nodes.planar_messages import planar_pose, seconds
from facade_manipulator.simulation import gondola_simulator
from facade_manipulator.simulation.gondola_simulator import (
    GondolaSimulatorNode,
    raw_fields,
)

HEAD = Pose(0.03, 0.25, 0.02)  # in frame rail
POSITIONS = inverse_kinematics(Geometry(), HEAD)


class Bench(NodeBench):
    """Simulator, and carriages at rest."""

    def __init__(self, ros, **parameters):
        super().__init__(ros, GondolaSimulatorNode, parameters)

    def send(self, positions=POSITIONS):
        self.publish(
            topics.JOINT_STATES, joint_state(ros_time(), positions, (0.0, 0.0, 0.0))
        )

    def stream(self):
        """Send the positions now and at 50 Hz from then on."""
        self.send()
        self.node.create_timer(0.02, self.send)


def test_estimates_have_frame_and_variances(ros):
    received = Bench(ros).collect(topics.DISTURBANCE)
    ros.until(lambda: received, 'an estimate')
    assert received[-1].header.frame_id == 'facade'
    variances = received[-1].pose.covariance[[0, 35]]
    assert variances == pytest.approx((1e-6, math.radians(0.1) ** 2))


@pytest.mark.parametrize('scenario', ['breeze', 'sensors', 'pressing'])
def test_each_simulated_measurement_has_a_frame_of_its_namespace(ros, scenario):
    overrides = [Parameter('scenario', value=scenario)]
    simulator = ros.add(
        GondolaSimulatorNode(namespace='gondola_1', parameter_overrides=overrides)
    )
    measurements = (
        *GondolaSimulatorNode.RAW_SENSOR_TOPICS,
        topics.DISTURBANCE,
        topics.CONTACT_WRENCH,
    )
    offered = {publisher.topic_name for publisher in simulator.publishers}
    bench = ros.node(namespace='gondola_1')
    received = {}
    for topic in measurements:
        if f'/gondola_1/{topic.name}' in offered:
            qos = topic.subscription_qos
            received[topic.name] = ros.collect(bench, *topic[:2], qos)
    carriages = bench.create_publisher(*topics.JOINT_STATES)

    def publish_carriages():
        carriages.publish(joint_state(ros_time(), POSITIONS, (0.0, 0.0, 0.0)))

    bench.create_timer(0.02, publish_carriages)
    ros.until(lambda: received and all(received.values()), 'each measurement')
    frames = {name: found[-1].header.frame_id for name, found in received.items()}
    assert all(frame.startswith('gondola_1/') for frame in frames.values()), frames
    raw = {
        topic.name for topic in GondolaSimulatorNode.RAW_SENSOR_TOPICS
    } & frames.keys()
    assert {frames[name] for name in raw} == {f'gondola_1/{name}' for name in raw}


def by_stamp(messages):
    """Return the poses by their stamps [s]."""
    return {
        seconds(one.header.stamp): planar_pose(one.pose, 'pose') for one in messages
    }


def test_head_and_errors_follow_rail_carriages_and_goal(ros):
    bench = Bench(ros)
    received = [*map(bench.collect, GondolaSimulatorNode.POSES)]
    bench.publish(topics.GOAL_POSE, pose_stamped('facade', ros_time(), HEAD))
    bench.stream()
    ros.until(lambda: all(len(poses) > 10 for poses in received), 'the errors')
    tables = [by_stamp(messages) for messages in received]
    newest = max(set.intersection(*map(set, tables)))
    head, rail, error, uncompensated = (table[newest] for table in tables)
    assert head == pytest.approx(compose(rail, HEAD), abs=1e-4)
    assert error.y == pytest.approx(head.y - HEAD.y)
    # the carriages are at rest
    assert uncompensated.y == pytest.approx(head.y - HEAD.y, abs=1e-3)


def test_errors_without_subscriber_are_not_computed(ros, monkeypatch):
    calls = []
    monkeypatch.setattr(
        gondola_simulator, 'difference', lambda *poses: calls.append(poses)
    )
    bench = Bench(ros)
    heads = bench.collect(topics.HEAD_POSE)
    bench.publish(topics.GOAL_POSE, pose_stamped('facade', ros_time(), HEAD))
    bench.stream()
    count = len(GondolaSimulatorNode.POSES)
    ros.until(
        lambda: len(bench.tested._poses) == count and len(heads) > 3, 'goal and poses'
    )
    assert calls == []


def test_wall_acts_on_head_sensor_and_carriages(ros):
    bench = Bench(ros, scenario='pressing')
    wrenches, loads = map(
        bench.collect, (topics.CONTACT_WRENCH, topics.CARRIAGE_FORCES)
    )
    bench.stream()

    def is_pushed_back(load):
        return load.effort[0] > 0.0 > load.effort[1]

    ros.until(lambda: any(one.wrench.force.y < -5.0 for one in wrenches), 'a wrench')
    # The wall at 0.19 m pushes a head at 0.25 m back; the loads may arrive after the wrench.
    ros.until(lambda: any(map(is_pushed_back, loads)), 'the loads')


@pytest.mark.parametrize(
    ('scenario', 'published'),
    [
        ('breeze', [topics.DISTURBANCE]),
        ('sensors', [topics.IMU, topics.RANGE_1, topics.RANGE_2, topics.FIX_X]),
    ],
)
def test_simulator_publishes_only_measurements_of_its_scenario(
    ros, scenario, published
):
    bench = Bench(ros, scenario=scenario)
    received = [*map(bench.collect, published)]
    ros.until(lambda: all(received), 'the measurements')

    def short(name):
        return name.rpartition('/')[2]

    names = {short(publisher.topic_name) for publisher in bench.tested.publishers}
    expected = {short(topic.name) for topic in published}
    expected |= {short(topic.name) for topic in GondolaSimulatorNode.POSES}
    assert names - {'diagnostics', 'rosout', 'parameter_events'} == expected


def test_raw_measurements_fill_the_fields_of_their_messages():
    values = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    imu = raw_fields(topics.IMU.name, *values)
    distance = raw_fields(topics.RANGE_1.name, *values)
    fix = raw_fields(topics.FIX_X.name, *values)
    assert imu['angular_velocity'].x == 1.0
    assert imu['linear_acceleration'].z == 6.0
    assert distance['range'] == fix['point'].x == 1.0


@pytest.mark.parametrize('positions', [(-0.49, 0.49, 0.0), (math.nan, 0.1, 0.0)])
def test_impossible_joint_states_are_rejected_and_counted(ros, positions):
    bench = Bench(ros)
    heads = bench.collect(topics.HEAD_POSE)
    bench.send(positions)
    ros.until(lambda: bench.rejection_count() == 1, 'the count of the rejection')
    assert not heads


def test_viewer_is_closed_with_the_node(ros, monkeypatch):
    calls = []
    viewer = SimpleNamespace(
        sync=lambda: calls.append('sync'), close=lambda: calls.append('close')
    )
    monkeypatch.setattr(gondola_simulator, 'open_viewer', lambda world: viewer)
    bench = Bench(ros, viewer=True)
    ros.until(lambda: 'sync' in calls, 'a picture')
    bench.tested.close()
    assert calls[-1] == 'close'
