"""Durability of topics: telemetry shows the present, states are latched, commands arrive."""

from nodes.node_rig import NodeBench, NODES
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile

from facade_manipulator import topics
from facade_manipulator.client import ManipulatorClient
from facade_manipulator.nodes.planar_messages import seconds
from facade_manipulator.topics import LatchedTopic, Topic

TOPICS = [one for one in vars(topics).values() if isinstance(one, Topic)]
LATCHED = {one.name for one in TOPICS if isinstance(one, LatchedTopic)}
#: goals, poses and setpoints, whose first message a volatile publisher may lose
COMMANDS = {
    topics.GOAL_POSE.name,
    topics.CORRECTED_POSE.name,
    topics.JOINT_SETPOINTS.name,
    topics.SOFTWARE_STOP.name,
}
#: endpoints of rcl itself
OF_ROS = {'/rosout', '/parameter_events', '/driver/transition_event'}


def durabilities(node, infos_of) -> dict[str, set[str]]:
    """Return the names of the durabilities in the graph by topic of this package."""
    found = {}
    for name, _ in node.get_topic_names_and_types():
        infos = [info for info in infos_of(name) if info.node_name != 'observer']
        if infos and name not in OF_ROS:
            short = name if name == '/diagnostics' else name.lstrip('/')
            found[short] = {info.qos_profile.durability.name for info in infos}
    return found


def as_ros2_topic_echo(node, topic: str) -> QoSProfile:
    """Return the quality of service with which `ros2 topic echo` subscribes."""
    offered = [
        info.qos_profile.durability for info in node.get_publishers_info_by_topic(topic)
    ]
    is_latched = all(one is DurabilityPolicy.TRANSIENT_LOCAL for one in offered)
    return QoSProfile(
        depth=10,
        durability=(
            DurabilityPolicy.TRANSIENT_LOCAL
            if is_latched
            else DurabilityPolicy.VOLATILE
        ),
    )


@pytest.mark.parametrize('name', NODES)
def test_only_states_and_commands_are_offered_after_publication(ros, name):
    ros.add(NODES[name]())
    observer = ros.node('observer')
    offered = ros.until(
        lambda: durabilities(observer, observer.get_publishers_info_by_topic),
        'the publishers',
    )
    wrong = {}
    for topic, kinds in offered.items():
        if kinds != {'TRANSIENT_LOCAL' if topic in LATCHED | COMMANDS else 'VOLATILE'}:
            wrong[topic] = kinds
    assert not wrong


@pytest.mark.parametrize(
    'make', [*NODES.values(), ManipulatorClient], ids=[*NODES, 'client']
)
def test_only_states_are_requested_from_before_subscription(ros, make):
    made = make()
    node = getattr(made, 'node', made)
    if node is made:
        ros.add(made)
    observer = ros.node('observer')
    requested = ros.until(
        lambda: durabilities(observer, observer.get_subscriptions_info_by_topic),
        'the subscriptions',
    )
    if node is not made:
        made.close()
    wrong = {}
    for topic, kinds in requested.items():
        if topic not in LATCHED and kinds != {'VOLATILE'}:
            wrong[topic] = kinds
    assert not wrong


def test_first_echoed_diagnostics_are_newer_than_the_echo(ros):
    bench = NodeBench(ros, NODES['ik_service'])
    for _ in range(3):
        bench.components.clear()
        ros.until(lambda: bench.components, 'diagnostics')
    echo = ros.node('echo')
    ros.until(lambda: echo.count_publishers('/diagnostics'), 'the publisher')
    begin = bench.now()
    received = ros.collect(
        echo, *topics.DIAGNOSTICS[:2], as_ros2_topic_echo(echo, '/diagnostics')
    )
    ros.until(lambda: received, 'the first message')
    assert seconds(received[0].header.stamp) > begin
