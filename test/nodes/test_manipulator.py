import math

from geometry_msgs.msg import PoseStamped
import pytest
from qualities import LATEST, RELIABLE
from sensor_msgs.msg import JointState

from facade_manipulator.kinematics import Carriages, Geometry, inverse_kinematics, Pose
from facade_manipulator.messages import CARRIAGES, planar_pose, seconds
from facade_manipulator.nodes.manipulator import make_nodes
from facade_manipulator.ros.conversions import pose_stamped

pytestmark = pytest.mark.quick

PLACE = Pose(0.02, 0.25, 0.0)


@pytest.fixture
def setpoints(ros):
    """Make both nodes with a goal on the wall; return the setpoints that come of it."""
    _, ros.ik_service = nodes = make_nodes()
    for node in nodes:
        ros.add(node)
    tester = ros.node()
    heard = ros.collect(tester, JointState, 'joint_setpoints', 100)
    goals = tester.create_publisher(PoseStamped, 'goal_pose', LATEST)
    tester.create_timer(0.1, lambda: goals.publish(pose_stamped('facade', 0.0, PLACE)))
    ros.until(lambda: len(heard) > 5, 'setpoints')
    ros.tester = tester
    return heard


def test_a_goal_on_the_wall_becomes_poses_that_all_hear_and_each_one_setpoint(ros, setpoints):
    wanted = inverse_kinematics(Geometry(), PLACE)
    assert Carriages(*setpoints[-1].position) == pytest.approx(wanted)
    poses = ros.collect(ros.tester, PoseStamped, 'corrected_pose', 100)
    ros.until(lambda: len(poses) > 20, 'corrected poses')
    assert planar_pose(poses[-1].pose, 'pose') == pytest.approx(PLACE)
    times = [seconds(message.header.stamp) for message in setpoints]
    assert all(math.isfinite(time) for time in times)
    assert all(b > a for a, b in zip(times, times[1:], strict=False))


def test_pose_from_elsewhere_moves_nothing_and_is_named(ros, setpoints):
    """The compensator's own poses go on, since they use no topic."""
    poses = ros.node('rosbag2_player').create_publisher(PoseStamped, 'corrected_pose', LATEST)
    ros.until(poses.get_subscription_count, 'the subscription')
    elsewhere = inverse_kinematics(Geometry(), Pose(0.02, 0.251, 0.0))
    poses.publish(pose_stamped(
        'rail', seconds(setpoints[-1].header.stamp) + 0.001, Pose(0.02, 0.251, 0.0)))
    ros.until(lambda: 'corrected_pose has 2 publishers' in ros.ik_service._rejections.last_message,
              'the rejection')
    count = len(setpoints)
    ros.until(lambda: len(setpoints) > count + 20, 'further setpoints')
    assert not any(Carriages(*m.position) == pytest.approx(elsewhere) for m in setpoints)
    level, message = ros.ik_service._outcome()
    assert level == 'error' and '/rosbag2_player' in message


def test_the_course_begins_at_the_head_that_joint_states_tell(ros):
    """The head goes from one node to the other past the topic, which has other listeners."""
    for node in make_nodes():
        ros.add(node)
    tester = ros.node()
    setpoints = ros.collect(tester, JointState, 'joint_setpoints', 100)
    heads = ros.collect(tester, PoseStamped, 'end_effector_pose', 100)
    states = tester.create_publisher(JointState, 'joint_states', RELIABLE)
    goals = tester.create_publisher(PoseStamped, 'goal_pose', LATEST)
    start = inverse_kinematics(Geometry(), PLACE._replace(x=-0.1))

    def told():
        message = JointState(name=CARRIAGES, position=start)
        message.header.stamp = tester.get_clock().now().to_msg()
        states.publish(message)
        return heads

    ros.until(told, 'the pose of the head')
    assert planar_pose(heads[-1].pose, 'head') == pytest.approx(PLACE._replace(x=-0.1))

    def followed():
        told()
        goals.publish(pose_stamped('facade', 0.0, PLACE))
        return setpoints

    ros.until(followed, 'setpoints')
    assert Carriages(*setpoints[0].position) == pytest.approx(start, abs=0.01)
