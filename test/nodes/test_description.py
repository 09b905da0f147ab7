"""robot_description and ik_service/joint_states, as viewers and robot_state_publisher use them."""

from __future__ import annotations

import math

from mechanism import DESIGN as GEOMETRY
from node_bench import NodeBench
import pytest
import yaml

from facade_manipulator import config_path, topics
from facade_manipulator.kinematics import inverse_kinematics, Pose
from facade_manipulator.nodes.conversions import joint_state, pose_stamped
from facade_manipulator.nodes.ik_service import IkServiceNode
from facade_manipulator.nodes.messages import Frames, planar_pose, seconds

urdf_reader = pytest.importorskip('pytransform3d.urdf', reason='pytransform3d is not installed')
pytestmark = pytest.mark.quick

NAMESPACE, FRAMES = '/gondola_1', Frames.of('/gondola_1')


def test_description_joints_and_poses_agree_in_a_namespace(ros):
    """The tree itself is tested with the kinematics."""
    bench = NodeBench(ros, IkServiceNode, namespace=NAMESPACE)
    described, heads, setpoints = map(bench.collect, (
        topics.ROBOT_DESCRIPTION, topics.END_EFFECTOR_POSE, topics.JOINT_SETPOINTS))
    head = Pose(-0.1, 0.25, -0.2)
    position = inverse_kinematics(GEOMETRY, head)

    def publish(time=12.5):
        bench.publish(topics.JOINT_STATES, joint_state(time, position, (0.0, 0.0, 0.0)))
        bench.publish(topics.CORRECTED_POSE, pose_stamped(FRAMES.rail, 0.0, head))

    ros.until(lambda: publish() or (described and heads and setpoints), 'poses and setpoints')
    assert bench.tested._description._published == -math.inf  # no node subscribes to the joints
    assert {one.header.frame_id for one in (heads[0], setpoints[0])} == {FRAMES.rail}
    assert seconds(heads[0].header.stamp) == 12.5
    assert planar_pose(heads[0].pose, 'head') == pytest.approx(head)
    moved = bench.collect(topics.MECHANISM_STATES)
    ros.until(lambda: publish() or moved, 'the joints')
    manager, joints = urdf_reader.UrdfTransformManager(), moved[0]
    manager.load_urdf(described[0].data)
    assert len(joints.name) == 7 and seconds(joints.header.stamp) == 12.5
    for name, value in zip(joints.name, joints.position, strict=True):
        manager.set_joint(name, value)
    place = manager.get_transform(FRAMES.end_effector, FRAMES.rail)
    assert place[:2, 3] == pytest.approx(head[:2], abs=1e-9)
    assert math.atan2(place[1, 0], place[0, 0]) == pytest.approx(head.theta)
    bench.publish(topics.CORRECTED_POSE, pose_stamped('rail', 0.0, head))
    assert "expected 'gondola_1/rail'" in bench.until_rejected('frame')


def test_the_rviz_file_shows_published_topics_in_frame_rail():
    manager = yaml.safe_load(config_path('manipulator.rviz').read_text())['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == 'rail'
    shown = {topic['Value']: topic['Durability Policy']
             for display in manager['Displays'] if display['Enabled']
             for key, topic in display.items() if key in ('Topic', 'Description Topic')}
    assert shown == {one.name: 'Transient Local' if one.qos == topics.LATCHED else 'Volatile'
                     for one in (topics.GOAL_POSE, topics.ROBOT_DESCRIPTION)}
