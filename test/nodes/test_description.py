"""robot_description and ik_service/joint_states, as viewers and robot_state_publisher use them."""

from __future__ import annotations

from mechanism import DESIGN as GEOMETRY
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import String
import yaml

from facade_manipulator import config_path, interfaces
from facade_manipulator.kinematics import inverse_kinematics, mechanism_of, Pose, positions, urdf
from facade_manipulator.messages import Frames, planar_pose
from facade_manipulator.nodes.ik_service import IkServiceNode
from facade_manipulator.ros import class_of, profile, publisher, stamp
from facade_manipulator.ros.conversions import pose_stamped

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
    return ros.collect(tester, class_of(topic), topic.name, profile(topic.quality))


def test_the_mechanism_is_described_to_who_comes_late_and_its_joints_move_with_the_carriages(
        ros, node, tester):
    described = collect(ros, tester, interfaces.ROBOT_DESCRIPTION)
    moved = collect(ros, tester, interfaces.MECHANISM_STATES)
    states = publisher(tester, interfaces.JOINT_STATES)
    message = JointState(name=['q1', 'q2', 'q3'], position=inverse_kinematics(GEOMETRY, MIDDLE))
    message.header.stamp = stamp(12.5)

    def seen():
        states.publish(message)
        return described and moved
    ros.until(seen, 'the description and the joints')
    assert described == [String(data=urdf(GEOMETRY, 'gondola_1/'))]
    expected = positions(mechanism_of(GEOMETRY), MIDDLE)
    assert [*moved[0].position] == pytest.approx(expected[:-1])
    assert len(moved[0].name) == 7 and moved[0].header.stamp == message.header.stamp


def test_messages_carry_the_frames_of_the_namespace(ros, node, tester):
    heads = collect(ros, tester, interfaces.END_EFFECTOR_POSE)
    setpoints = collect(ros, tester, interfaces.JOINT_SETPOINTS)
    states, goals = (publisher(tester, one) for one in (
        interfaces.JOINT_STATES, interfaces.CORRECTED_POSE))
    carriages = JointState(name=['q1', 'q2', 'q3'], position=inverse_kinematics(GEOMETRY, MIDDLE))

    def seen():
        states.publish(carriages)
        goals.publish(pose_stamped(FRAMES.rail, 1.0, MIDDLE))
        return heads and setpoints
    ros.until(seen, 'head and setpoint')
    assert {one.header.frame_id for one in (heads[0], setpoints[0])} == {FRAMES.rail}
    assert planar_pose(heads[0].pose, 'head') == pytest.approx(MIDDLE)
    goals.publish(pose_stamped('rail', 2.0, MIDDLE))
    ros.until(lambda: "expected 'gondola_1/rail'" in node._rejections.last_message,
              'the rejection of a frame without its prefix')


def test_the_rviz_file_shows_published_topics_in_frame_rail():
    manager = yaml.safe_load(config_path('manipulator.rviz').read_text())['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == 'rail'
    shown = {topic['Value']: topic['Durability Policy']
             for display in manager['Displays'] if display['Enabled']
             for key, topic in display.items() if key in ('Topic', 'Description Topic')}
    drawn = (interfaces.GOAL_POSE, interfaces.ROBOT_DESCRIPTION)
    assert shown == {one.name: 'Transient Local' if one.quality.latched else 'Volatile'
                     for one in drawn}
