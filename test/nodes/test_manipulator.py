"""Compensator and ik_service in one process, with calls instead of messages between them."""

from functools import partial
from time import monotonic

from nodes.node_rig import NodeBench
import pytest

from facade_manipulator import topics
from facade_manipulator.kinematics import Geometry, inverse_kinematics, Pose
from facade_manipulator.nodes.base_node import CallbackError
from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.conversions import joint_state, pose_stamped, ros_time
from facade_manipulator.nodes.ik_service import IkServiceNode

GOAL = Pose(0.05, 0.25, 0.0)


class Connected(NodeBench):
    """Both nodes, a supervisor that sends a goal, and a driver."""

    def __init__(self, ros, remapping=(), remapping_of_ik_service=()):
        make = partial(CompensatorNode, connects_later=True)
        super().__init__(ros, make, cli_args=['--ros-args', *remapping])
        self.ik_service = ros.add(
            IkServiceNode(
                connects_later=True, cli_args=['--ros-args', *remapping_of_ik_service]
            )
        )
        self.tested.connect(self.ik_service)
        self.ik_service.connect(self.tested)
        self.setpoints = self.collect(topics.JOINT_SETPOINTS)
        self.publish(topics.GOAL_POSE, pose_stamped('facade', 0.0, GOAL))

    def subscribed_topics(self):
        """Return the topics to which each node subscribes."""

        def topics_of(node):
            return {one.topic_name for one in node.subscriptions}

        return [topics_of(self.tested), topics_of(self.ik_service)]


def test_external_subscribers_receive_the_messages_between_both_nodes(ros):
    both = Connected(ros)
    carriages = inverse_kinematics(Geometry(), GOAL)

    def publish_carriages():
        message = joint_state(ros_time(), carriages, (0.0, 0.0, 0.0))
        both.publish(topics.JOINT_STATES, message)

    both.node.create_timer(0.02, publish_carriages)
    following = both.tested._compensator.following
    ros.until(
        lambda: both.setpoints and following.newest(monotonic()), 'setpoints and head'
    )
    between = topics.CORRECTED_POSE, topics.END_EFFECTOR_POSE
    assert [both.node.count_subscribers(topic.name) for topic in between] == [0, 0]
    corrected, heads = map(both.collect, between)
    ros.until(lambda: corrected and heads, 'the messages')

    def has_setpoint():
        return corrected[0].header in [one.header for one in both.setpoints]

    ros.until(has_setpoint, 'a setpoint')


def test_second_publisher_stops_the_setpoints_of_connected_nodes(ros):
    both = Connected(ros)
    ros.until(lambda: both.setpoints, 'setpoints')
    ros.node('player').create_publisher(*topics.CORRECTED_POSE)
    diagnostics = both.ik_service.diagnostics
    # a few rejections later no setpoint of before is under way
    ros.until(
        lambda: diagnostics.rejections().get('rejected: publishers', 0) > 5,
        'rejections',
    )
    both.setpoints.clear()
    ros.until(
        lambda: diagnostics.rejections()['rejected: publishers'] > 20, 'more rejections'
    )
    assert not both.setpoints


def test_connected_nodes_do_not_subscribe_to_each_other(ros):
    by_compensator, by_ik_service = Connected(ros).subscribed_topics()
    assert '/end_effector_pose' not in by_compensator
    assert '/corrected_pose' not in by_ik_service


def test_topic_with_two_names_is_not_connected(ros):
    both = Connected(ros, ['-r', 'corrected_pose:=elsewhere'])
    corrected = both.collect(topics.CORRECTED_POSE._replace(name='elsewhere'))
    ros.until(lambda: len(corrected) > 5, 'corrected poses')
    assert not both.setpoints
    assert '/corrected_pose' in both.subscribed_topics()[1]


def test_topic_with_one_other_name_is_connected(ros):
    remapping = ['-r', 'corrected_pose:=elsewhere']
    both = Connected(ros, remapping, remapping)
    ros.until(lambda: both.setpoints, 'setpoints')
    assert '/elsewhere' not in both.subscribed_topics()[1]


def test_defect_is_attributed_to_the_called_node(ros, monkeypatch):
    both = Connected(ros)
    ros.until(lambda: both.setpoints, 'setpoints')
    monkeypatch.setattr(both.ik_service._gate, 'offer', None)
    with pytest.raises(CallbackError) as caught:
        both.tested._update()
    assert caught.value.node is both.ik_service
