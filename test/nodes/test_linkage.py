"""What a URDF cannot say as markers, while someone looks; the mechanism in its own topics."""

from __future__ import annotations

import cmath
import math

from diagnostic_msgs.msg import DiagnosticStatus
from mechanism import DESIGN as GEOMETRY
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray
import yaml

from facade_manipulator import config_path, interfaces
from facade_manipulator.kinematics import inverse_kinematics, mechanism_of, Pose, positions, urdf
from facade_manipulator.messages import Frames, planar_pose
from facade_manipulator.nodes.ik_service import IkServiceNode
from facade_manipulator.nodes.linkage import CROSS_LENGTH, markers, OLDEST, STATE_COLOURS
from facade_manipulator.ros import class_of, LEVELS, profile, publisher, stamp
from facade_manipulator.ros.conversions import pose_stamped

pytestmark = pytest.mark.quick

MIDDLE = Pose(0.05, 0.25, 0.1)
NAMESPACE, FRAMES = '/gondola_1', Frames.of('/gondola_1')


def by_name(*arguments, **named):
    return {marker.ns: marker for marker in markers(FRAMES, *arguments, **named)}


def middle(points):
    return tuple(sum(axis) / len(points) for axis in zip(
        *((point.x, point.y) for point in points), strict=True))


def test_goal_and_wall_are_drawn_on_the_wall_and_the_corrected_goal_on_the_rail():
    picture = by_name(0.3, MIDDLE, Pose(0.1, 0.2, 0.0))
    assert {name: marker.header.frame_id for name, marker in picture.items()} == {
        'goal': FRAMES.facade, 'wall': FRAMES.facade, 'corrected goal': FRAMES.rail,
        'state': FRAMES.rail}
    assert middle(picture['goal'].points) == pytest.approx(MIDDLE[:2])
    assert middle(picture['corrected goal'].points) == pytest.approx((0.1, 0.2))
    wall = picture['wall']
    assert wall.pose.position.y - 0.5 * wall.scale.y == pytest.approx(0.3)


def test_a_cross_lies_along_the_axes_of_its_pose_and_the_wall_stands_before_the_rail():
    picture = by_name(0.3, MIDDLE, MIDDLE)
    for name in ('goal', 'corrected goal'):
        a, b, c, d = (complex(point.x, point.y) for point in picture[name].points)
        assert (b - a) == pytest.approx(2.0 * CROSS_LENGTH * cmath.exp(1j * MIDDLE.theta))
        assert (d - c) == pytest.approx(1j * (b - a))
    assert picture['state'].pose.position.y < 0.0 < picture['wall'].scale.y
    assert picture['wall'].scale.x > picture['wall'].scale.z > picture['wall'].scale.y
    for marker in picture.values():
        assert marker.frame_locked and marker.action == Marker.ADD
        assert marker.lifetime.sec + 1e-9 * marker.lifetime.nanosec == pytest.approx(OLDEST)
        assert marker.pose.orientation.w == 1.0 and not marker.pose.position.x


@pytest.mark.parametrize('level', STATE_COLOURS)
def test_the_state_has_the_colour_of_its_level(level):
    status = DiagnosticStatus(level=LEVELS[level], message='as it is')
    state = by_name(status=status)['state']
    colour = state.color
    assert (colour.r, colour.g, colour.b, colour.a) == STATE_COLOURS[level]
    assert state.text == 'as it is'


def test_a_silent_driver_is_said_to_be():
    assert by_name()['state'].text == 'the driver is silent'


@pytest.fixture
def node(ros):
    return ros.add(IkServiceNode(namespace=NAMESPACE))


@pytest.fixture
def tester(ros, node):
    return ros.node('tester', namespace=NAMESPACE)


def collect(ros, tester, topic):
    return ros.collect(tester, class_of(topic), topic.name, profile(topic.quality))


def test_markers_come_only_while_someone_subscribes(ros, node, tester):
    arrays = []
    assert tester.count_subscribers('goal_pose') == 0
    subscription = tester.create_subscription(
        MarkerArray, 'ik_service/linkage', arrays.append, profile(interfaces.LINKAGE.quality))
    ros.until(lambda: arrays, 'markers')
    ros.until(lambda: tester.count_subscribers('goal_pose') == 1, 'the subscriptions')
    tester.destroy_subscription(subscription)
    ros.until(lambda: tester.count_subscribers('goal_pose') == 0, 'the end of the subscriptions')
    assert node._linkage._timer.is_canceled()


def test_the_markers_show_goals_and_the_state_of_the_drives_and_outlive_what_cannot_be(
        ros, node, tester):
    arrays = collect(ros, tester, interfaces.LINKAGE)
    goals, corrected, status = (publisher(tester, topic) for topic in (
        interfaces.GOAL_POSE, interfaces.CORRECTED_POSE, interfaces.DRIVER_STATUS))

    def seen():
        goals.publish(pose_stamped(FRAMES.facade, 0.0, MIDDLE))
        corrected.publish(pose_stamped(FRAMES.rail, 0.0, Pose(math.nan, 0.25, 0.0)))
        status.publish(DiagnosticStatus(level=DiagnosticStatus.ERROR, message='stopped: a fault'))
        found = {marker.ns: marker for marker in arrays[-1].markers} if arrays else {}
        return 'goal' in found and found['state'].text == 'stopped: a fault' and found

    found = ros.until(seen, 'the whole picture')
    assert set(found) == {'goal', 'wall', 'state'}
    assert found['wall'].header.stamp.sec and found['wall'].lifetime.nanosec


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


def test_all_messages_carry_the_frames_of_the_namespace(ros, node, tester):
    heads = collect(ros, tester, interfaces.END_EFFECTOR_POSE)
    setpoints = collect(ros, tester, interfaces.JOINT_SETPOINTS)
    maps = collect(ros, tester, interfaces.WORKSPACE)
    states, goals = (publisher(tester, one) for one in (
        interfaces.JOINT_STATES, interfaces.CORRECTED_POSE))
    carriages = JointState(name=['q1', 'q2', 'q3'], position=inverse_kinematics(GEOMETRY, MIDDLE))

    def seen():
        states.publish(carriages)
        goals.publish(pose_stamped(FRAMES.rail, 1.0, MIDDLE))
        return heads and setpoints and maps
    ros.until(seen, 'head, setpoint and map')
    assert {one.header.frame_id for one in (heads[0], setpoints[0], maps[0])} == {FRAMES.rail}
    assert planar_pose(heads[0].pose, 'head') == pytest.approx(MIDDLE)
    goals.publish(pose_stamped('rail', 2.0, MIDDLE))
    ros.until(lambda: "expected 'gondola_1/rail'" in node._rejections.last_message,
              'the rejection of a frame without its prefix')


def test_the_rviz_file_shows_what_the_node_publishes_in_its_frame():
    manager = yaml.safe_load(config_path('manipulator.rviz').read_text())['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == 'rail'
    shown = {topic['Value']: topic['Durability Policy']
             for display in manager['Displays'] if display['Enabled']
             for key, topic in display.items() if key in ('Topic', 'Description Topic')}
    drawn = (interfaces.WORKSPACE, interfaces.LINKAGE, interfaces.ROBOT_DESCRIPTION)
    assert shown == {one.name: 'Transient Local' if one.quality.latched else 'Volatile'
                     for one in drawn}
