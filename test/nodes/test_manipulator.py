"""compensator and ik_service in one process: from goals on the wall to setpoints."""

import pytest
from sensor_msgs.msg import JointState

from facade_manipulator import topics
from facade_manipulator.kinematics import Carriages, Geometry, inverse_kinematics, Pose
from facade_manipulator.messages import CARRIAGES, planar_pose, seconds
from facade_manipulator.nodes.conversions import pose_stamped
from facade_manipulator.nodes.manipulator import make_nodes

pytestmark = pytest.mark.quick
PLACE = Pose(0.02, 0.25, 0.0)


class Bench:
    """Both nodes, a supervisor that repeats a goal, and the setpoints."""

    def __init__(self, ros):
        self.compensator, self.ik_service = (ros.add(node) for node in make_nodes())
        self.node = ros.node()
        self.setpoints = ros.collect(self.node, *topics.JOINT_SETPOINTS[:2], 100)
        goals = self.node.create_publisher(*topics.GOAL_POSE)
        self.node.create_timer(0.1, lambda: goals.publish(pose_stamped('facade', 0.0, PLACE)))


@pytest.fixture
def bench(ros):
    return Bench(ros)


def test_goal_on_the_wall_becomes_one_setpoint_a_pose(ros, bench):
    poses = ros.collect(bench.node, *topics.CORRECTED_POSE[:2], 100)
    ros.until(lambda: len(poses) > 20 and len(bench.setpoints) > 20, 'poses and setpoints')
    wanted = inverse_kinematics(Geometry(), PLACE)
    assert Carriages(*bench.setpoints[-1].position) == pytest.approx(wanted)
    assert planar_pose(poses[-1].pose, 'pose') == pytest.approx(PLACE)
    times = [seconds(message.header.stamp) for message in bench.setpoints]
    assert all(b > a for a, b in zip(times, times[1:], strict=False))


def test_second_publisher_of_corrected_poses_moves_nothing(ros, bench):
    ros.until(lambda: bench.setpoints, 'setpoints')
    poses = ros.node('rosbag2_player').create_publisher(*topics.CORRECTED_POSE)
    ros.until(poses.get_subscription_count, 'the subscription')
    bench.setpoints.clear()
    poses.publish(pose_stamped('rail', 0.0, Pose(0.02, 0.251, 0.0)))
    ros.until(lambda: bench.ik_service.rejections.total > 20, 'the rejections')
    assert 'corrected_pose has 2 publishers' in bench.ik_service.rejections.last_message
    elsewhere = inverse_kinematics(Geometry(), Pose(0.02, 0.251, 0.0))
    assert not any(Carriages(*m.position) == pytest.approx(elsewhere) for m in bench.setpoints)
    level, message = bench.ik_service._outcome()
    assert level == 'error' and '/rosbag2_player' in message


def test_path_begins_at_the_head_of_joint_states(ros, bench):
    heads = ros.collect(bench.node, *topics.END_EFFECTOR_POSE)
    states = bench.node.create_publisher(*topics.JOINT_STATES)
    start = inverse_kinematics(Geometry(), PLACE._replace(x=-0.1))

    def publish():
        message = JointState(name=CARRIAGES, position=start)
        message.header.stamp = bench.node.get_clock().now().to_msg()
        states.publish(message)

    bench.node.create_timer(0.01, publish)
    ros.until(lambda: heads, 'the pose of the head')
    assert planar_pose(heads[-1].pose, 'head') == pytest.approx(PLACE._replace(x=-0.1))
    bench.setpoints.clear()
    ros.until(lambda: bench.compensator._compensator.initialisations, 'the path')
    ros.until(lambda: bench.setpoints and Carriages(*bench.setpoints[-1].position)
              == pytest.approx(start, abs=0.02), 'a setpoint near the head')
