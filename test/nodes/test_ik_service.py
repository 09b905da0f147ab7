"""The ik_service node: corrected poses to setpoints, the pose of the head, and requests."""

from itertools import pairwise
import math
import re

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.srv import GetPlan
import pytest
from sensor_msgs.msg import JointState

from facade_manipulator import topics
from facade_manipulator.kinematics import (
    Carriages,
    forward_kinematics,
    Geometry,
    inverse_kinematics,
    Pose,
)
from facade_manipulator.messages import planar_pose, seconds, status_values
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.nodes.conversions import pose_stamped, stamp
from facade_manipulator.nodes.driver_status import DriverStatus
from facade_manipulator.nodes.ik_service import IkServiceNode, LEAD

pytestmark = pytest.mark.quick

GEOMETRY = Geometry()
MIDDLE = Pose(0.05, 0.25, 0.1)
SPEED = MotionLimits().speed


class Bench:
    """An ik_service node and the programs around it."""

    def __init__(self, ros):
        self.until, self.call = ros.until, ros.call
        self.node, self.tester = ros.add(IkServiceNode()), ros.node('tester')
        self.setpoints = ros.collect(self.tester, *topics.JOINT_SETPOINTS)
        self.diagnostics = ros.collect(self.tester, DiagnosticArray, '/diagnostics')
        self.rejections = ros.collect(self.tester, *topics.REJECTIONS)
        self.heads = ros.collect(self.tester, *topics.END_EFFECTOR_POSE)
        self.goals = self.tester.create_publisher(*topics.CORRECTED_POSE)
        self.states = self.tester.create_publisher(*topics.JOINT_STATES)
        self.until(lambda: self.goals.get_subscription_count() == 1
                   and self.states.get_subscription_count() == 1
                   and self.node.count_subscribers('joint_setpoints') == 1
                   and self.diagnostics, 'the graph')

    def now(self):
        return self.tester.get_clock().now().nanoseconds * 1e-9

    @property
    def status(self):
        """Return the newest status of component goal."""
        return self.diagnostics[-1].status[0]

    def until_outcome(self, message, level=DiagnosticStatus.OK):
        self.until(lambda: (self.status.message, self.status.level) == (message, level),
                   f'{message}, not {self.status.message}')

    def until_rejected(self, count=1):
        total = self.node.rejections.total
        self.until(lambda: self.node.rejections.total >= total + count, 'the rejection')
        return self.node.rejections.last_message

    def send(self, message):
        self.goals.publish(message)

    def until_head(self, pose):
        self.states.publish(carriages_at(pose))
        self.until(lambda: self.heads, 'end_effector_pose')

    def solve(self, goal, start=None, tolerance=0.0):
        request = GetPlan.Request(goal=goal, tolerance=tolerance)
        if start is not None:
            request.start = start
        return self.call(self.tester, GetPlan, 'ik_service/solve', request).plan

    @property
    def is_approaching(self):
        return not self.node._approach_timer.is_canceled()


@pytest.fixture
def bench(ros):
    return Bench(ros)


def rail(pose, time=0.0):
    return pose_stamped('rail', time, pose)


def carriages_at(pose):
    return JointState(name=['q1', 'q2', 'q3'], position=inverse_kinematics(GEOMETRY, pose))


def test_stream_of_poses_becomes_positions_and_velocities(bench):
    begin, step, speed = bench.now(), 0.01, 0.2
    for k in range(5):
        pose = MIDDLE._replace(x=MIDDLE.x + speed * k * step)
        bench.send(rail(pose, begin + k * step))
        bench.until(lambda count=k: len(bench.setpoints) > count, 'a setpoint')
    last = bench.setpoints[-1]
    assert list(last.name) == ['q1', 'q2', 'q3']
    assert list(last.position) == pytest.approx(inverse_kinematics(GEOMETRY, pose), abs=1e-12)
    assert list(last.velocity) == pytest.approx([speed] * 3, rel=1e-3)
    assert seconds(last.header.stamp) == pytest.approx(begin + 4 * step, abs=1e-6)


def test_single_pose_is_approached_from_the_head(bench):
    start = Pose(-0.05, 0.25, 0.0)
    assert not bench.is_approaching
    bench.until_head(start)
    begin = bench.now()
    bench.send(rail(MIDDLE))
    there = list(inverse_kinematics(GEOMETRY, MIDDLE))
    bench.until(lambda: bench.setpoints and list(bench.setpoints[-1].position)
                == pytest.approx(there, abs=1e-9), 'the setpoint of the goal')
    times = [seconds(item.header.stamp) for item in bench.setpoints]
    assert times == sorted(times) and times[0] >= begin + LEAD
    assert abs(bench.setpoints[0].position[2] - start.x) < 0.001
    assert all(abs(b.position[2] - a.position[2]) <= SPEED * (then - now) + 1e-6
               for (now, a), (then, b) in pairwise(zip(times, bench.setpoints, strict=True)))
    bench.until(lambda: not bench.is_approaching, 'the end of the approach')
    count = len(bench.setpoints)
    bench.send(rail(MIDDLE._replace(y=0.4)))
    bench.until_rejected()
    assert len(bench.setpoints) == count


def test_single_pose_is_approached_after_clock_is_set_back(bench):
    bench.until_head(MIDDLE)
    bench.send(rail(MIDDLE, bench.now()))
    bench.until(lambda: bench.setpoints and not bench.is_approaching, 'the approach')
    count = len(bench.setpoints)
    bench.node._followed_time += 600.0  # the previous pose was stamped before the step
    bench.send(rail(MIDDLE._replace(x=MIDDLE.x + 0.1), bench.now()))
    bench.until(lambda: len(bench.setpoints) > count, 'the next setpoint')
    assert abs(bench.setpoints[count].position[2] - MIDDLE.x) < 0.01


OUT_OF_PLANE = rail(MIDDLE)
OUT_OF_PLANE.pose.position.z = 0.1


@pytest.mark.parametrize('message, expected', [
    (OUT_OF_PLANE, 'z = 0.1 m is out of the plane'),
    (rail(MIDDLE._replace(x=math.nan)), 'x = nan is not a finite number'),
    (pose_stamped('facade', 0.0, MIDDLE), "in frame 'facade', expected 'rail'"),
    (rail(MIDDLE._replace(y=0.4)), 'bound 0.352 m'),
    (rail(MIDDLE._replace(y=0.055)), 'q3 - q1'),
    (rail(MIDDLE._replace(x=0.5)), 'q2'),
    (rail(MIDDLE._replace(y=-0.25)), 'y = -0.25 m'),
    (rail(Pose(0.0, 0.35199, 0.0)), 'conditioning index'),
])
def test_impossible_pose_is_rejected_with_value_and_bound(bench, message, expected):
    bench.send(message)
    assert expected in bench.until_rejected()
    bench.until(lambda: expected in bench.status.message, 'the status')
    assert bench.status.level == DiagnosticStatus.ERROR
    assert bench.setpoints == []
    bench.send(rail(MIDDLE, bench.now()))
    bench.until(lambda: bench.setpoints, 'a setpoint of the next pose')
    bench.until_outcome('following the goals')


@pytest.mark.parametrize('age, message', [
    (3600.0, 'corrected_pose is 3600.0'), (5.5, 's old, bound 5 s'),
    (-1.5, 's from the future, bound 1 s')])
def test_pose_of_another_time_is_rejected(bench, age, message):
    bench.send(rail(MIDDLE, bench.now() - age))
    assert message in bench.until_rejected()
    assert bench.setpoints == []


def test_old_pose_does_not_disturb_a_stream(bench):
    bench.send(rail(MIDDLE, bench.now()))
    bench.until(lambda: len(bench.setpoints) == 1, 'a setpoint')
    bench.send(rail(MIDDLE._replace(x=MIDDLE.x + 0.08), bench.now() - 3600.0))
    bench.until_rejected()
    bench.send(rail(MIDDLE, bench.now()))
    bench.until(lambda: len(bench.setpoints) == 2, 'the next setpoint')
    assert bench.setpoints[0].position == bench.setpoints[1].position


def test_second_publisher_of_joint_states_moves_nothing(bench, ros):
    bench.until_head(MIDDLE)
    foreign = ros.node('joint_state_publisher')
    zeros = foreign.create_publisher(*topics.JOINT_STATES)
    bench.until_outcome('joint_states has 2 publishers (/joint_state_publisher, /tester), bound '
                        '1; next: end one of the nodes', DiagnosticStatus.ERROR)
    bench.heads.clear()
    for states in (JointState(name=['q1', 'q2', 'q3'], position=[0.0] * 3),
                   carriages_at(MIDDLE._replace(x=0.0))):
        zeros.publish(states)
        bench.until_rejected()
    for _ in range(2):
        bench.send(rail(MIDDLE))
        assert 'joint_states rejected: joint_states has 2' in bench.until_rejected()
    assert not bench.heads and not bench.setpoints
    foreign.destroy_publisher(zeros)
    bench.until(lambda: not bench.node._inputs.fault, 'one publisher')
    bench.until_head(MIDDLE)
    bench.send(rail(MIDDLE._replace(x=MIDDLE.x + 0.01)))
    bench.until(lambda: bench.setpoints, 'an approach')


def test_rejections_are_counted_by_reason_in_diagnostics(bench):
    bench.send(pose_stamped('facade', 0.0, MIDDLE))
    bench.until(lambda: status_values(bench.status).get('rejected: frame') == '1', 'the counter')


def test_head_is_published_with_the_stamp_of_the_carriages(bench):
    carriages = inverse_kinematics(GEOMETRY, MIDDLE)
    message = JointState(name=['q3', 'q1', 'q2'],
                         position=[carriages.q3, carriages.q1, carriages.q2])
    message.header.stamp = stamp(12.5)
    bench.states.publish(message)
    bench.until(lambda: bench.heads, 'end_effector_pose')
    head = bench.heads[-1]
    assert head.header.frame_id == 'rail' and seconds(head.header.stamp) == 12.5
    assert planar_pose(head.pose, 'head') == pytest.approx(MIDDLE, abs=1e-9)


def test_incomplete_joint_states_are_rejected_and_give_no_head(bench):
    bench.states.publish(JointState(name=['q1', 'q2'], position=[0.0, 0.1]))
    bench.until_rejected()
    assert bench.heads == []


def test_solve_returns_the_carriages_of_a_pose(bench):
    plan = bench.solve(rail(MIDDLE))
    assert plan.header.frame_id == 'actuator_space'
    point = plan.poses[0].pose.position
    assert len(plan.poses) == 1
    assert (point.x, point.y, point.z) == pytest.approx(inverse_kinematics(GEOMETRY, MIDDLE))


def test_solve_returns_a_straight_path_within_the_spacing(bench):
    goal = Pose(-0.1, 0.28, -0.1)
    plan = bench.solve(rail(goal), rail(MIDDLE), 0.002)
    poses = [forward_kinematics(GEOMETRY, Carriages(p.x, p.y, p.z))
             for p in (item.pose.position for item in plan.poses)]
    assert poses[0] == pytest.approx(MIDDLE, abs=1e-9)
    assert poses[-1] == pytest.approx(goal, abs=1e-9)
    assert all(math.hypot(b.x - a.x, b.y - a.y) <= 0.002 for a, b in pairwise(poses))
    share = [(pose.x - MIDDLE.x) / (goal.x - MIDDLE.x) for pose in poses]
    assert [pose.theta for pose in poses] == pytest.approx(
        [MIDDLE.theta + s * (goal.theta - MIDDLE.theta) for s in share], abs=1e-9)


@pytest.mark.parametrize('message, goal, more', [
    ('bound 0.352 m', rail(Pose(0.0, 0.4, 0.0)), ()),
    ("'facade'", pose_stamped('facade', 0.0, MIDDLE), ()),
    ("start is in frame 'map'", rail(MIDDLE), (pose_stamped('map', 0.0, MIDDLE),)),
    ('poses, bound', rail(Pose(-0.3, 0.25, 0.0)), (rail(Pose(0.3, 0.25, 0.0)), 1e-7)),
    ('tolerance = -1.0 m is not a distance', rail(MIDDLE), (rail(MIDDLE), -1.0)),
    ('tolerance = nan', rail(MIDDLE), (rail(MIDDLE), math.nan)),
    (r'b \|sin', rail(Pose(0.0, 0.25, -0.25)), (rail(Pose(0.0, 0.25, 0.5)),))])
def test_rejected_solve_has_an_empty_plan_and_a_reason(bench, message, goal, more):
    assert len(bench.solve(goal, *more).poses) == 0
    bench.until(lambda: bench.rejections, 'the rejection')
    assert re.search(message, bench.rejections[-1].message)
    assert bench.node._outcome() == ('ok', 'no goal yet')  # the request moves nothing


def test_each_rejected_solve_is_published_with_its_limit(bench):
    times = [12.25, 13.5, 13.5]
    for time in times:
        bench.solve(rail(Pose(0.0, 0.4, 0.0), time))
    bench.until(lambda: len(bench.rejections) == len(times), 'one rejection for each request')
    values = [status_values(status) for status in bench.rejections]
    assert [each['goal stamp'] for each in values] == [
        '12.250000000', '13.500000000', '13.500000000']
    assert values[0] == {
        'goal stamp': '12.250000000', 'reason': 'unreachable', 'quantity': values[0]['quantity'],
        'value': '0.4', 'bound': '0.352', 'unit': 'm'}


@pytest.fixture
def driver(bench):
    """Return a function that publishes driver/status and waits until the node has it."""
    publisher = bench.tester.create_publisher(*topics.DRIVER_STATUS)

    def publish(state, activity='holding', next_step='', since=math.inf):
        status = DriverStatus(state, activity, next_step, since)
        publisher.publish(status.to_message('ok', state))
        bench.until(lambda: bench.node._driver.status == status, state)

    return publish


def test_diagnostics_report_whether_goals_are_followed(bench, driver):
    driver('unconfigured', next_step='configure')
    bench.until_outcome('no goal is followed: the drives are unconfigured; next: configure',
                        DiagnosticStatus.WARN)
    bench.send(rail(MIDDLE, bench.now()))
    driver('stopped', next_step='clear_faults, activate')
    bench.until_outcome('no goal is followed: the drives are stopped; next: clear_faults, '
                        'activate', DiagnosticStatus.WARN)
    assert bench.setpoints == []
    driver('active', since=bench.now())
    bench.until_outcome('holding: no goal since the drives were activated')
    bench.send(rail(MIDDLE, bench.now()))
    bench.until(lambda: bench.setpoints, 'a setpoint')
    driver('active', 'following', since=bench.now() - 1.0)
    bench.until_outcome('following the goals')
    driver('active', 'holding', since=bench.now() - 1.0)
    bench.until_outcome('holding: no goal is received')


def test_pose_from_before_the_activation_moves_nothing(bench, driver):
    bench.until_head(Pose(-0.05, 0.25, 0.0))
    driver('inactive')
    bench.send(rail(MIDDLE))
    bench.until(lambda: bench.node._waiting, 'the goal')
    driver('active', since=bench.now())
    assert not bench.is_approaching
    bench.send(rail(MIDDLE))
    bench.until(lambda: bench.setpoints, 'a setpoint')
    driver('stopped')
    bench.until(lambda: not bench.is_approaching, 'the end of the approach')


def test_pose_right_after_the_activation_is_approached(bench, driver):
    driver('activating')
    since = bench.now()
    bench.send(rail(MIDDLE))
    bench.until(lambda: bench.node._waiting, 'the goal')
    driver('active', since=since)
    bench.until(lambda: bench.setpoints, 'a setpoint')


def test_only_a_force_sensor_publishes_contact_wrench(bench):
    assert bench.tester.count_publishers('contact_wrench') == 0
