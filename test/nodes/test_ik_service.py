"""Ik_service node: corrected poses to setpoints, the pose of the head, and requests."""

import math
from time import monotonic

from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan
from nodes.node_rig import NodeBench
import numpy as np
import pytest

from facade_manipulator import topics
from facade_manipulator.kinematics import (
    Geometry,
    inverse_kinematics,
    Mechanism,
    MIN_CONDITIONING,
    Pose,
    positions,
    tree,
    urdf,
)
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.motion.head_path import ReferenceSettings
from facade_manipulator.motion.pose_follower import PoseFollower
from facade_manipulator.motion.setpoints import SetpointStream
from facade_manipulator.nodes.conversions import joint_state, pose_stamped
from facade_manipulator.nodes.driver_status import SILENT
from facade_manipulator.nodes.ik_service import IkServiceNode
from facade_manipulator.nodes.planar_messages import planar_pose, seconds, status_values

GEOMETRY = Geometry()
MIDDLE = Pose(0.05, 0.25, 0.1)


class Bench(NodeBench):
    """Ik_service node and the programs around it."""

    def __init__(self, ros, **options):
        super().__init__(ros, IkServiceNode, **options)
        self.until = ros.until
        self.setpoints = self.collect(topics.JOINT_SETPOINTS)
        self.rejected_requests = self.collect(topics.REJECTIONS)
        self.heads = self.collect(topics.END_EFFECTOR_POSE)

        def is_ready():  # without a driver
            is_connected = self.tested.count_subscribers('joint_setpoints') == 1
            return is_connected and self.components and self.gate.is_open

        ros.until(is_ready, 'the graph')

    def send(self, pose, time=0.0, frame='rail'):
        self.publish(topics.CORRECTED_POSE, pose_stamped(frame, time, pose))

    def until_head(self, pose):
        self.publish(topics.JOINT_STATES, carriages_at(pose))
        self.until(lambda: self.heads, 'end_effector_pose')

    def solve(self, goal, start=None, tolerance=0.0):
        request = GetPlan.Request(
            goal=goal, start=start or PoseStamped(), tolerance=tolerance
        )
        return self.call(topics.SOLVE, request).plan

    @property
    def is_approaching(self):
        return self.tested._poses.is_approaching


@pytest.fixture
def bench(ros):
    return Bench(ros)


def rail(pose, time=0.0):
    return pose_stamped('rail', time, pose)


def carriages_at(pose, time=0.0):
    return joint_state(time, inverse_kinematics(GEOMETRY, pose), (0.0, 0.0, 0.0))


def test_stream_of_poses_becomes_positions_and_velocities(bench):
    begin = bench.now()
    speed = 0.2
    for k in range(5):
        pose = MIDDLE._replace(x=MIDDLE.x + 0.01 * k * speed)
        bench.send(pose, begin + 0.01 * k)
        bench.until(lambda count=k: len(bench.setpoints) > count, 'a setpoint')
    last = bench.setpoints[-1]
    assert tuple(last.name) == AXIS_NAMES
    assert list(last.position) == pytest.approx(
        inverse_kinematics(GEOMETRY, pose), abs=1e-12
    )
    assert list(last.velocity) == pytest.approx([speed] * 3, rel=1e-3)
    assert seconds(last.header.stamp) == pytest.approx(begin + 0.04, abs=1e-6)


def test_single_pose_is_approached_from_the_head(bench):
    start = Pose(-0.05, 0.25, 0.0)
    bench.until_head(start)
    begin = bench.now()
    bench.send(MIDDLE)
    bench.until(
        lambda: bench.setpoints and not bench.is_approaching, 'the end of the approach'
    )
    times = [seconds(item.header.stamp) for item in bench.setpoints]
    q3 = [item.position[2] for item in bench.setpoints]
    assert times == sorted(times)
    assert times[0] >= begin + PoseFollower.APPROACH_LEAD
    assert q3[0] == pytest.approx(start.x, abs=1e-3)
    assert q3[-1] == pytest.approx(MIDDLE.x, abs=1e-3)
    speeds = np.diff(q3) / np.diff(times)
    # stamps are rounded to 0.24 us
    assert speeds.max() <= ReferenceSettings().speed[0] + 1e-4


@pytest.mark.parametrize('period', [0.01, 0.05, 0.15])
def test_first_pose_of_a_stream_starts_no_approach(bench, period):
    bench.until_head(MIDDLE._replace(x=MIDDLE.x - 0.01))
    begin = monotonic()
    poses = [MIDDLE._replace(x=MIDDLE.x + 0.001 * number) for number in range(6)]
    for number, pose in enumerate(poses):
        due = begin + number * period
        bench.until(lambda end=due: monotonic() >= end, 'the next pose')
        bench.send(pose, bench.now())

    def is_last_there():
        last = pytest.approx(poses[-1].x)
        return bench.setpoints and bench.setpoints[-1].position[2] == last

    bench.until(is_last_there, 'the last setpoint')
    q3 = [item.position[2] for item in bench.setpoints]
    expected = {round(pose.x, 9) for pose in poses[1:]}
    assert {round(one, 9) for one in q3} <= expected
    assert min(item.velocity[2] for item in bench.setpoints) > 0.0
    assert not bench.is_approaching


def test_single_pose_is_approached_after_clock_is_set_back(bench):
    bench.until_head(MIDDLE)
    bench.send(MIDDLE, bench.now())
    bench.until(lambda: bench.setpoints and not bench.is_approaching, 'the approach')
    count = len(bench.setpoints)
    bench.tested._poses._newest_time += (
        600.0  # the previous pose was stamped before the step
    )
    bench.send(MIDDLE._replace(x=MIDDLE.x + 0.1), bench.now())
    bench.until(lambda: len(bench.setpoints) > count, 'the next setpoint')
    assert abs(bench.setpoints[count].position[2] - MIDDLE.x) < 0.01


def test_impossible_pose_is_rejected_with_value_and_bound(bench):
    for count, (pose, expected, *more) in enumerate(
        (
            (MIDDLE._replace(x=math.nan), 'x = nan is not a finite number'),
            (MIDDLE, "in frame 'facade', expected 'rail'", 0.0, 'facade'),
            (MIDDLE, 's old, above the limit 5 s', bench.now() - 3600.0),
            (
                MIDDLE._replace(y=0.4),
                'limit 0.352 m (geometry.link_length); next: choose',
            ),
            (MIDDLE._replace(y=0.055), 'q3 - q1'),
            (MIDDLE._replace(x=0.5), 'q2'),
            (MIDDLE._replace(y=-0.25), 'y = -0.25 m'),
            (Pose(0.0, 0.35199, 0.0), 'conditioning index'),
        )
    ):
        bench.send(pose, *more)
        bench.until(
            lambda before=count: bench.rejection_count() > before, 'the rejection'
        )
        assert expected in bench.tested.diagnostics.last_rejection
        bench.until_status('goal', expected, 'error')
    assert bench.setpoints == []
    bench.until(
        lambda: status_values(bench.components['goal'])['rejected: frame'] == '1',
        'the counter',
    )
    bench.send(MIDDLE, bench.now())
    bench.until(lambda: bench.setpoints, 'a setpoint of the next pose')
    bench.until_status('goal', 'following the goals', 'ok')


def test_solve_returns_carriages_of_a_pose_or_path(bench):
    goal = Pose(-0.1, 0.28, -0.1)
    single = bench.solve(rail(MIDDLE))
    path = bench.solve(rail(goal), rail(MIDDLE), 0.002)
    stream = SetpointStream(GEOMETRY, MIN_CONDITIONING)
    assert {pose.header.frame_id for pose in single.poses} == {'actuator_space'}
    for plan, expected in (
        (single, [inverse_kinematics(GEOMETRY, MIDDLE)]),
        (path, stream.path(MIDDLE, goal, 0.002)),
    ):
        points = [pose.pose.position for pose in plan.poses]
        found = [(one.x, one.y, one.z) for one in points]
        assert found == [pytest.approx(carriages) for carriages in expected]


def test_rejected_solve_has_an_empty_plan_and_a_reason(bench):
    for message, goal, start, tolerance in (
        ("'facade'", pose_stamped('facade', 0.0, MIDDLE), None, 0.0),
        (
            "start is in frame 'map'",
            rail(MIDDLE),
            pose_stamped('map', 0.0, MIDDLE),
            0.0,
        ),
        (
            'limit 10000 steps',
            rail(Pose(-0.3, 0.25, 0.0)),
            rail(Pose(0.3, 0.25, 0.0)),
            1e-7,
        ),
        ('b |sin', rail(Pose(0.0, 0.25, -0.25)), rail(Pose(0.0, 0.25, 0.5)), 0.0),
        (
            'limit 0.352 m (geometry.link_length); next: choose',
            rail(Pose(0.0, 0.4, 0.0), 12.25),
            None,
            0.0,
        ),
    ):
        assert len(bench.solve(goal, start, tolerance).poses) == 0
        bench.until(lambda: bench.rejected_requests, 'the rejection')
        rejection = bench.rejected_requests.pop()
        assert message in rejection.message
    values = status_values(rejection)
    assert values.pop('quantity')
    assert values == {
        'goal stamp': '12.250000000',
        'reason': 'unreachable',
        'value': '0.4',
        'bound': '0.352',
        'unit': 'm',
    }
    # the requests move no carriage
    bench.until_status('goal', 'no goal yet', 'ok')


def test_diagnostics_report_whether_goals_are_followed(bench):
    bench.publish_driver('stopped', next_step='clear_faults, activate')
    bench.until_status(
        'goal',
        'no goal is followed: the drives are stopped; next: clear_faults, activate',
        'warn',
    )
    bench.publish_driver('active', since=bench.now())
    bench.until_status('goal', 'holding: no goal since the drives were activated', 'ok')
    bench.send(MIDDLE, bench.now())
    bench.until(lambda: bench.setpoints, 'a setpoint')
    for activity, message in (
        ('following', 'following the goals'),
        ('holding', 'holding: no goal is being received'),
    ):
        bench.publish_driver('active', activity, since=bench.now() - 1.0)
        bench.until_status('goal', message, 'ok')


def test_pose_before_the_activation_moves_nothing(bench):
    bench.until_head(Pose(-0.05, 0.25, 0.0))
    bench.publish_driver('inactive')
    bench.send(MIDDLE)
    bench.until(lambda: bench.gate.held, 'the goal')
    bench.publish_driver('active', since=bench.now())
    assert not bench.is_approaching
    bench.publish_driver('activating')
    since = bench.now()
    # right after the activation, which the driver's status reports later
    bench.send(MIDDLE)
    bench.until(lambda: bench.gate.held, 'the goal')
    bench.publish_driver('active', since=since)
    bench.until(lambda: bench.setpoints, 'a setpoint')
    bench.publish_driver('stopped')
    bench.until(lambda: not bench.is_approaching, 'the end of the approach')


def test_held_pose_applies_at_the_time_it_passes(bench):
    bench.gate.PATIENCE = 60.0
    bench.publish_driver('activating')
    since = bench.now()
    bench.send(MIDDLE, since)
    bench.until(lambda: bench.gate.held, 'the pose')
    bench.until(lambda: bench.now() > since + 0.3, 'a late status')
    bench.publish_driver('active', since=since)
    bench.until(lambda: bench.setpoints, 'a setpoint')
    assert seconds(bench.setpoints[0].header.stamp) > since + 0.3


def test_pose_during_driver_silence_moves_nothing(bench):
    bench.gate.SILENCE = 0.3
    bench.until_head(Pose(-0.05, 0.25, 0.0))
    since = bench.now()
    bench.publish_driver('active', since=since)
    bench.until(lambda: bench.gate.status is SILENT, 'silence')
    bench.tested._receive_corrected_pose(rail(MIDDLE))
    bench.publish_driver('active', since=since)
    assert not bench.is_approaching
    assert not bench.setpoints
    bench.send(MIDDLE)
    bench.until(lambda: bench.setpoints, 'a setpoint for a new pose')


def test_joints_and_poses_have_frames_of_the_namespace(ros):
    bench = Bench(ros, namespace='/gondola_1')
    described = bench.collect(topics.ROBOT_DESCRIPTION)

    def publish():
        bench.publish(topics.JOINT_STATES, carriages_at(MIDDLE, 12.5))
        bench.send(MIDDLE, frame='gondola_1/rail')

    bench.until(
        lambda: publish() or (described and bench.heads and bench.setpoints), 'poses'
    )
    # no node subscribes to the joints
    assert bench.tested._description._published == -math.inf
    joints = bench.collect(topics.MECHANISM_STATES)
    bench.until(lambda: publish() or joints, 'the joints')
    assert described[0].data == urdf(GEOMETRY, 'gondola_1/')
    assert joints[0].name == [joint.name for joint in tree(GEOMETRY) if joint.name]
    assert list(joints[0].position) == pytest.approx(
        positions(Mechanism(GEOMETRY), MIDDLE)
    )
    head = bench.heads[0]
    assert planar_pose(head.pose, 'head') == pytest.approx(MIDDLE)
    for message in (head, joints[0]):
        assert seconds(message.header.stamp) == 12.5
    for message in (head, bench.setpoints[0]):
        assert message.header.frame_id == 'gondola_1/rail'
