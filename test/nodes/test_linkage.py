"""The picture of the linkage: markers from poses, published while someone looks."""

from __future__ import annotations

import math

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from hypothesis import given
from mechanism import DESIGN as GEOMETRY
from mechanism import workspace_poses
import pytest
from qualities import LATEST, RELIABLE
from rclpy.qos import qos_profile_sensor_data
from visualization_msgs.msg import Marker, MarkerArray
import yaml

from facade_manipulator import config_path
from facade_manipulator.kinematics import inverse_kinematics, Pose
from facade_manipulator.kinematics.linkage import joints
from facade_manipulator.messages import planar_pose
from facade_manipulator.nodes.ik_service import IkServiceNode
from facade_manipulator.nodes.linkage import markers, MechanismView, STATE_COLOURS
from facade_manipulator.ros.conversions import pose_message, pose_stamped

MIDDLE = Pose(0.05, 0.25, 0.1)


@given(workspace_poses())
def test_every_joint_keeps_its_distance_from_its_neighbour(pose):
    at = joints(GEOMETRY, pose)
    assert math.dist(at.a1, at.b1) == pytest.approx(GEOMETRY.link_length)
    assert math.dist(at.a2, at.b2) == pytest.approx(GEOMETRY.link_length)
    assert math.dist(at.b1, at.b2) == pytest.approx(2.0 * GEOMETRY.platform_half_length)
    assert (at.a1[0], at.a2[0], at.a3[0]) == inverse_kinematics(GEOMETRY, pose)


def by_name(scene):
    return {marker.ns: marker for marker in markers(GEOMETRY, scene)}


def test_in_still_air_the_goal_is_drawn_where_it_is_and_the_wall_at_its_distance():
    picture = by_name(MechanismView(goal=MIDDLE, wall=0.3))
    assert middle(picture['goal'].points) == pytest.approx((MIDDLE.x, MIDDLE.y))
    wall = picture['wall']
    assert wall.pose.position.y - 0.5 * wall.scale.y == pytest.approx(0.3)


def test_when_the_gondola_sways_goal_and_wall_move_the_other_way_as_seen_from_the_rail():
    picture = by_name(MechanismView(goal=MIDDLE, disturbance=Pose(0.1, -0.01, 0.0)))
    assert middle(picture['goal'].points) == pytest.approx((MIDDLE.x - 0.1, MIDDLE.y + 0.01))
    assert picture['wall'].pose.position.y == (
        by_name(MechanismView())['wall'].pose.position.y + 0.01)


def test_carriages_are_as_wide_as_their_gap_and_touch_where_they_must_stop():
    at_the_gap = by_name(MechanismView(head=Pose(0.0, _nearest(), 0.0)))
    left, middle_one = at_the_gap['carriage q1'], at_the_gap['carriage q3']
    assert left.scale.x == GEOMETRY.carriage_gap
    edges = (left.pose.position.x + 0.5 * left.scale.x,
             middle_one.pose.position.x - 0.5 * middle_one.scale.x)
    assert edges[0] == pytest.approx(edges[1], abs=1e-9)


def _nearest():
    span = GEOMETRY.platform_half_length - GEOMETRY.carriage_gap
    return math.sqrt(GEOMETRY.link_length ** 2 - span ** 2)


@pytest.mark.parametrize('level', STATE_COLOURS)
def test_the_linkage_has_the_colour_of_its_state(level):
    picture = by_name(MechanismView(head=MIDDLE, level=level))
    colour = picture['links'].color
    assert (colour.r, colour.g, colour.b, colour.a) == STATE_COLOURS[level]


@pytest.mark.parametrize('head', [None, Pose(0.0, 0.5, 0.0), Pose(math.nan, 0.2, 0.0)])
def test_a_head_that_is_not_known_or_cannot_be_is_not_drawn(head):
    assert set(by_name(MechanismView(head=head))) == {'rail', 'wall', 'state'}


def middle(points):
    return tuple(sum(axis) / len(points) for axis in zip(
        *((point.x, point.y) for point in points), strict=True))


def test_markers_come_only_while_someone_subscribes(ros):
    node = ros.add(IkServiceNode())
    tester = ros.node('tester')
    assert node.count_subscribers('goal_pose') == 0
    arrays = []
    subscription = tester.create_subscription(
        MarkerArray, 'ik_service/linkage', arrays.append, LATEST)
    ros.until(lambda: arrays, 'markers')
    ros.until(lambda: tester.count_subscribers('goal_pose') == 1, 'the subscriptions')
    tester.destroy_subscription(subscription)
    ros.until(lambda: tester.count_subscribers('goal_pose') == 0, 'the end of the subscriptions')
    assert node._linkage._timer.is_canceled()


def test_the_markers_show_head_goals_and_the_state_of_the_drives(ros):
    ros.add(IkServiceNode())
    tester = ros.node('tester')
    arrays = ros.collect(tester, MarkerArray, 'ik_service/linkage', LATEST)
    heads = tester.create_publisher(PoseStamped, 'end_effector_pose', RELIABLE)
    goals = tester.create_publisher(PoseStamped, 'goal_pose', LATEST)
    disturbances = tester.create_publisher(
        PoseWithCovarianceStamped, 'disturbance', qos_profile_sensor_data)
    diagnostics = tester.create_publisher(DiagnosticArray, '/diagnostics', RELIABLE)
    status = DiagnosticStatus(
        name='driver: operation', level=DiagnosticStatus.ERROR, message='stopped: a fault')

    def seen():
        heads.publish(pose_stamped('rail', 0.0, MIDDLE))
        goals.publish(pose_stamped('facade', 0.0, MIDDLE))
        message = PoseWithCovarianceStamped()
        message.pose.pose = pose_message(Pose(0.1, 0.0, 0.0))
        disturbances.publish(message)
        diagnostics.publish(DiagnosticArray(status=[status]))
        found = {marker.ns: marker for marker in arrays[-1].markers} if arrays else {}
        ready = {'links', 'goal'} <= set(found) and found['state'].text == status.message
        return ready and found['wall'].pose.position.x != 0.0 and found
    found = ros.until(seen, 'the whole picture')
    assert {marker.header.frame_id for marker in found.values()} == {'rail'}
    links = found['links']
    assert links.type == Marker.LINE_LIST and len(links.points) == 4
    assert (links.color.r, links.color.a) == pytest.approx((0.84, 1.0))
    arrow = planar_pose(found['end effector'].pose, 'arrow')
    assert arrow == pytest.approx((*MIDDLE[:2], MIDDLE.theta + 0.5 * math.pi))
    assert middle(found['goal'].points) == pytest.approx((MIDDLE.x - 0.1, MIDDLE.y))
    assert found['wall'].header.stamp != Time() and found['wall'].lifetime.nanosec


def test_a_pose_that_cannot_be_does_not_stop_the_picture(ros):
    ros.add(IkServiceNode())
    tester = ros.node('tester')
    arrays = ros.collect(tester, MarkerArray, 'ik_service/linkage', LATEST)
    heads = tester.create_publisher(PoseStamped, 'end_effector_pose', RELIABLE)
    ros.until(lambda: arrays and heads.get_subscription_count() == 1, 'the subscription')
    heads.publish(pose_stamped('rail', 0.0, Pose(math.nan, 0.25, 0.0)))
    heads.publish(pose_stamped('rail', 0.0, Pose(0.0, 5.0, 0.0)))
    count = len(arrays)
    ros.until(lambda: len(arrays) > count + 2, 'more pictures')


def test_the_rviz_file_shows_what_the_node_publishes_in_its_frame(ros):
    node = ros.add(IkServiceNode())
    manager = yaml.safe_load(config_path('manipulator.rviz').read_text())['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == 'rail'
    classes = {'ik_service/workspace': 'nav_msgs/msg/OccupancyGrid',
               'ik_service/linkage': 'visualization_msgs/msg/MarkerArray'}
    published = dict(node.get_publisher_names_and_types_by_node('ik_service', '/'))
    shown = {display['Topic']['Value']: display['Topic'] for display in manager['Displays']
             if display['Enabled'] and 'Topic' in display}
    assert set(shown) == set(classes)
    for topic, name in classes.items():
        assert published[f'/{topic}'] == [name]
    assert shown['ik_service/workspace']['Durability Policy'] == 'Transient Local'
