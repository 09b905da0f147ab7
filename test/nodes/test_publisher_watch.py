"""One publisher for each topic: the second one is named, and the messages of both are rejected."""

from __future__ import annotations

import pytest
from sensor_msgs.msg import JointState

from facade_manipulator.errors import InputError
from facade_manipulator.nodes import publisher_watch
from facade_manipulator.nodes.diagnostics import Rejections
from facade_manipulator.nodes.publisher_watch import PublisherWatch
from facade_manipulator.topics import JOINT_STATES, RELIABLE

pytestmark = pytest.mark.quick
NAME = JOINT_STATES.name


class Inputs:
    """A node with one input topic, and what it has received."""

    def __init__(self, ros, **options):
        self.node, self.received, self.changes = ros.node('ik_service', **options), [], []
        self.rejections = Rejections(self.node)
        self.watch = PublisherWatch(
            self.node, self.rejections, lambda: self.changes.append(self.watch.fault))
        self.subscription = self.watch.subscribe(JOINT_STATES, self.received.append)


def test_messages_of_two_publishers_are_rejected_until_one_leaves(ros):
    inputs, driver, foreign = Inputs(ros), ros.node('driver'), ros.node('foreign')
    ours = driver.create_publisher(JointState, NAME, RELIABLE)
    ros.until(ours.get_subscription_count, 'the subscription')
    ours.publish(JointState())
    ros.until(lambda: len(inputs.received) == 1, 'a message')
    inputs.watch.require_sole(NAME)
    theirs = foreign.create_publisher(JointState, NAME, RELIABLE)
    ros.until(theirs.get_subscription_count, 'the subscription of the second')
    for publisher in (theirs, ours, theirs):
        publisher.publish(JointState())
    ros.until(lambda: inputs.rejections.total == 3, 'three rejections')
    assert inputs.rejections.values()['rejected: publishers'] == 3
    fault = f'{NAME} has 2 publishers (/driver, /foreign), bound 1'
    ros.until(lambda: inputs.watch.fault == f'{fault}; next: end one of the nodes', 'both names')
    with pytest.raises(InputError, match='joint_states rejected: joint_states has 2 publishers'):
        inputs.watch.require_sole(NAME)
    foreign.destroy_publisher(theirs)
    ros.until(lambda: not inputs.watch.fault, 'one publisher')
    ours.publish(JointState())
    ros.until(lambda: len(inputs.received) == 2, 'a message again')
    assert inputs.changes[-1] == ''


def test_publishers_of_a_remapped_topic_are_counted(ros):
    inputs = Inputs(ros, cli_args=['--ros-args', '-r', f'{NAME}:=/site/states'])
    made = [ros.node(name).create_publisher(JointState, '/site/states', RELIABLE)
            for name in ('one', 'two')]
    ros.until(lambda: 'has 2 publishers (/one, /two)' in inputs.watch.fault, 'both')
    assert len(made) == 2


def test_second_publisher_without_a_match_is_found_by_the_timer(ros, monkeypatch):
    monkeypatch.setattr(publisher_watch, 'LOOK_PERIOD', 0.05)
    inputs = Inputs(ros)
    inputs.watch.watch('imu')  # its subscription is of a queue, without events
    made = [ros.node(name).create_publisher(JointState, 'imu', RELIABLE)
            for name in ('one', 'two')]
    ros.until(lambda: 'imu has 2 publishers (/one, /two)' in inputs.watch.fault, 'both')
    assert len(made) == 2
