"""compensator and ik_service in one process: from goals on the wall to setpoints."""

import pytest

from facade_manipulator import topics
from facade_manipulator.kinematics import Carriages, Geometry, inverse_kinematics, Pose
from facade_manipulator.nodes.conversions import joint_state, pose_stamped
from facade_manipulator.nodes.manipulator import make_nodes
from facade_manipulator.nodes.messages import planar_pose, seconds

PLACE, HEAD = Pose(0.02, 0.25, 0.0), Pose(-0.1, 0.25, 0.0)


@pytest.mark.quick
def test_goal_becomes_setpoints_from_the_head_on(ros):
    compensator, _ = (ros.add(node) for node in make_nodes())
    tester = ros.node()
    setpoints = ros.collect(tester, *topics.JOINT_SETPOINTS[:2], 100)
    goals, states = (tester.create_publisher(*one) for one in (
        topics.GOAL_POSE, topics.JOINT_STATES))
    tester.create_timer(0.1, lambda: goals.publish(pose_stamped('facade', 0.0, PLACE)))
    wanted, start = (inverse_kinematics(Geometry(), pose) for pose in (PLACE, HEAD))
    ros.until(lambda: setpoints and Carriages(*setpoints[-1].position) == pytest.approx(wanted),
              'the setpoint of the goal')
    times = [seconds(message.header.stamp) for message in setpoints]
    assert all(b > a for a, b in zip(times, times[1:], strict=False))
    heads = ros.collect(tester, *topics.END_EFFECTOR_POSE)
    tester.create_timer(0.01, lambda: states.publish(joint_state(
        seconds(tester.get_clock().now().to_msg()), start, (0.0, 0.0, 0.0))))
    ros.until(lambda: heads, 'the pose of the head')
    assert planar_pose(heads[-1].pose, 'head') == pytest.approx(HEAD)
    ros.until(lambda: compensator._compensator.initialisations, 'the path')
    setpoints.clear()
    ros.until(lambda: setpoints and Carriages(*setpoints[-1].position)
              == pytest.approx(start, abs=0.02), 'a setpoint near the head')
