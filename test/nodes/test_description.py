"""robot_description and ik_service/joint_states, as viewers and robot_state_publisher use them."""

from __future__ import annotations

import math

from mechanism import DESIGN as GEOMETRY
import numpy as np
import pytest
from sensor_msgs.msg import JointState
import yaml

from facade_manipulator import config_path, topics
from facade_manipulator.kinematics import inverse_kinematics, Pose
from facade_manipulator.kinematics import joints as joint_points
from facade_manipulator.messages import Frames, planar_pose, seconds
from facade_manipulator.nodes.conversions import pose_stamped, stamp
from facade_manipulator.nodes.ik_service import IkServiceNode

urdf_reader = pytest.importorskip('pytransform3d.urdf', reason='pytransform3d is not installed')
pytestmark = pytest.mark.quick

MIDDLE = Pose(0.05, 0.25, 0.1)
NAMESPACE, FRAMES = '/gondola_1', Frames.of('/gondola_1')


@pytest.fixture
def node(ros):
    return ros.add(IkServiceNode(namespace=NAMESPACE))


@pytest.fixture
def tester(ros, node):
    return ros.node('tester', namespace=NAMESPACE)


def collect(ros, tester, topic):
    return ros.collect(tester, *topic)


def joints_of(ros, tester, head: Pose) -> tuple[str, JointState]:
    """Return the URDF and the joint states that the node publishes with the head at a pose."""
    described = collect(ros, tester, topics.ROBOT_DESCRIPTION)
    moved = collect(ros, tester, topics.MECHANISM_STATES)
    states = tester.create_publisher(*topics.JOINT_STATES)
    message = JointState(name=['q1', 'q2', 'q3'], position=inverse_kinematics(GEOMETRY, head))
    message.header.stamp = stamp(12.5)

    def received():
        states.publish(message)
        return described and moved
    ros.until(received, 'the description and the joints')
    return described[0].data, moved[0]


@pytest.mark.parametrize('head', [MIDDLE, Pose(-0.1, 0.25, -0.2)])
def test_joint_states_and_urdf_give_the_link_poses(ros, node, tester, head):
    manager = urdf_reader.UrdfTransformManager()
    description, joints = joints_of(ros, tester, head)
    manager.load_urdf(description)
    assert len(joints.name) == 7 and seconds(joints.header.stamp) == 12.5
    for name, position in zip(joints.name, joints.position, strict=True):
        manager.set_joint(name, position)

    def place(link: str) -> np.ndarray:
        return manager.get_transform(FRAMES.prefix + link, FRAMES.rail)

    cosine, sine = math.cos(head.theta), math.sin(head.theta)
    assert place('end_effector') == pytest.approx(np.array([
        [cosine, -sine, 0.0, head.x], [sine, cosine, 0.0, head.y],
        [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]), abs=1e-9)
    at = joint_points(GEOMETRY, head)
    for number, begin, end in ((1, at.a1, at.b1), (2, at.a2, at.b2)):
        link = place(f'link_{number}')
        tip = link @ [GEOMETRY.link_length, 0.0, 0.0, 1.0]
        assert place(f'carriage_{number}')[:2, 3] == pytest.approx(begin, abs=1e-9)
        assert link[:2, 3] == pytest.approx(begin, abs=1e-9)
        assert tip[:2] == pytest.approx(end, abs=1e-9)
    assert place('carriage_3')[:2, 3] == pytest.approx(at.a3, abs=1e-9)
    assert place('platform')[:2, 3] == pytest.approx(at.p, abs=1e-9)


def test_joint_states_are_published_only_while_a_node_subscribes(ros, node, tester):
    states = tester.create_publisher(*topics.JOINT_STATES)
    heads = collect(ros, tester, topics.END_EFFECTOR_POSE)
    message = JointState(name=['q1', 'q2', 'q3'], position=inverse_kinematics(GEOMETRY, MIDDLE))

    def received():
        states.publish(message)
        return heads
    ros.until(received, 'the pose of the head')
    assert node._description._published == -math.inf
    moved = collect(ros, tester, topics.MECHANISM_STATES)
    heads.clear()
    message.header.stamp = stamp(1.0)
    ros.until(lambda: received() and moved, 'the joints')


def test_messages_carry_the_frames_of_the_namespace(ros, node, tester):
    heads = collect(ros, tester, topics.END_EFFECTOR_POSE)
    setpoints = collect(ros, tester, topics.JOINT_SETPOINTS)
    states, goals = (tester.create_publisher(*one) for one in (
        topics.JOINT_STATES, topics.CORRECTED_POSE))
    carriages = JointState(name=['q1', 'q2', 'q3'], position=inverse_kinematics(GEOMETRY, MIDDLE))

    def seen():
        states.publish(carriages)
        goals.publish(pose_stamped(FRAMES.rail, 0.0, MIDDLE))
        return heads and setpoints
    ros.until(seen, 'head and setpoint')
    assert {one.header.frame_id for one in (heads[0], setpoints[0])} == {FRAMES.rail}
    assert planar_pose(heads[0].pose, 'head') == pytest.approx(MIDDLE)
    goals.publish(pose_stamped('rail', 0.0, MIDDLE))
    ros.until(lambda: "expected 'gondola_1/rail'" in node.rejections.last_message,
              'the rejection of a frame without its prefix')


def test_the_rviz_file_shows_published_topics_in_frame_rail():
    manager = yaml.safe_load(config_path('manipulator.rviz').read_text())['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == 'rail'
    shown = {topic['Value']: topic['Durability Policy']
             for display in manager['Displays'] if display['Enabled']
             for key, topic in display.items() if key in ('Topic', 'Description Topic')}
    drawn = (topics.GOAL_POSE, topics.ROBOT_DESCRIPTION)
    assert shown == {one.name: 'Transient Local' if one.qos == topics.LATCHED else 'Volatile'
                     for one in drawn}
