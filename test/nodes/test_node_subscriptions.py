"""Limit of one publisher per topic: the second is named, the messages of both are rejected."""

import re

from nodes.node_rig import diagnostics_of, NodeBench, NODES
import pytest
from rclpy.node import Node
from sensor_msgs.msg import JointState

from facade_manipulator import topics
from facade_manipulator.errors import InputError
from facade_manipulator.nodes.node_subscriptions import PublisherWatch
from facade_manipulator.topics import JOINT_STATES, SENSOR

NAME = JOINT_STATES.name


class Inputs:
    """Node with one input topic, and its received messages."""

    def __init__(self, ros, arguments=()):
        self.node = ros.node('ik_service', cli_args=arguments)
        self.received = []
        self.changes = []
        self.diagnostics = diagnostics_of(self.node)

        def note_change():
            self.changes.append(self.watch.fault)

        self.watch = PublisherWatch(self.node, self.diagnostics, note_change)
        self.watch.subscribe(JOINT_STATES, self.received.append)


@pytest.mark.parametrize(
    'topic', [JOINT_STATES, JOINT_STATES._replace(name='/site/states')]
)
def test_messages_of_two_publishers_are_rejected_until_one_leaves(ros, topic):
    inputs = Inputs(ros, ['--ros-args', '-r', f'{NAME}:={topic.name}'])
    driver = ros.node('driver')
    foreign = ros.node('foreign')
    ours = driver.create_publisher(*topic)
    ros.until(ours.get_subscription_count, 'the subscription')
    ours.publish(JointState())
    ros.until(lambda: len(inputs.received) == 1, 'a message')
    theirs = foreign.create_publisher(*topic)
    ros.until(theirs.get_subscription_count, 'the subscription of the second')
    for publisher in (theirs, ours, theirs):
        publisher.publish(JointState())
    ros.until(
        lambda: inputs.diagnostics.rejections()['rejected'] == 3, 'three rejections'
    )
    fault = (
        f'{NAME} has 2 publishers (/driver, /foreign), above the limit 1; '
        'next: end one of the nodes, or wait 20 s if a node has crashed'
    )
    ros.until(lambda: inputs.watch.fault == fault, 'both names')
    with pytest.raises(InputError, match=re.escape(fault)):
        inputs.watch.require_sole(NAME)
    foreign.destroy_publisher(theirs)
    ros.until(lambda: not inputs.watch.fault, 'one publisher')
    ours.publish(JointState())
    ros.until(lambda: len(inputs.received) == 2, 'a message again')
    assert inputs.changes[-1] == ''


@pytest.mark.parametrize(
    ('topic', 'qos', 'words'),
    [
        (
            JOINT_STATES,
            SENSOR,
            'reliability is best effort and must be reliable',
        ),
        (
            topics.DRIVER_STATUS,
            topics.NEWEST,
            'durability is volatile and must be transient local',
        ),
    ],
)
def test_incompatible_publisher_is_reported_until_it_leaves(ros, topic, qos, words):
    inputs = Inputs(ros)
    driver = ros.node('driver')
    if topic is not JOINT_STATES:
        inputs.watch.subscribe(topic, inputs.received.append)
    made = driver.create_publisher(*topic._replace(qos=qos))
    ros.until(lambda: inputs.diagnostics.last_rejection, 'the rejection')
    fault = f'{topic.name} has an incompatible publisher: its {words}'
    assert inputs.diagnostics.last_rejection.startswith(f'{fault}; next: correct')
    for _ in range(3):
        inputs.watch.look()
        assert inputs.watch.fault_of(topic.name) == fault
    changes = len(inputs.changes)
    driver.destroy_publisher(made)
    ros.until(lambda: not inputs.watch.fault_of(topic.name), 'the end of the fault')
    assert len(inputs.changes) > changes


@pytest.mark.parametrize(
    'name, component, topic',
    [
        ('driver', 'operation', topics.JOINT_SETPOINTS),
        ('ik_service', 'goal', topics.CORRECTED_POSE),
        ('ik_service', 'goal', JOINT_STATES),
        ('compensator', 'correction', topics.GOAL_POSE),
        ('disturbance_estimator', 'motion', topics.RANGE_1),
    ],
)
def test_second_publisher_of_an_input_is_an_error(ros, name, component, topic):
    bench = NodeBench(ros, NODES[name])
    made = ros.node('player').create_publisher(*topic)
    ros.until(made.get_subscription_count, 'the subscription')
    bench.publish(topic, topic.type())
    bench.until_status(
        component, f'{topic.name} has 2 publishers (/player, /tester)', 'error'
    )
    made.publish(topic.type())
    ros.until(
        lambda: 'has 2 publishers' in bench.tested.diagnostics.last_rejection,
        'the rejection',
    )
    assert 'rejected: publishers' in bench.tested.diagnostics.rejections()


@pytest.mark.parametrize('name', NODES)
def test_publishers_are_counted_only_of_subscribed_topics(ros, monkeypatch, name):
    """A discovery server reports the publishers of a topic only to its subscribers."""
    counted = set()
    count = Node.count_publishers

    def note(node, topic):
        counted.add(topic)
        return count(node, topic)

    monkeypatch.setattr(Node, 'count_publishers', note)
    node = ros.add(NODES[name]())
    ros.until(lambda: counted, 'the count')
    assert counted <= {one.topic_name for one in node.subscriptions}
