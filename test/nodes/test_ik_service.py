from itertools import pairwise
import math
import re

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan
import pytest
from qualities import DRIVER_STATUS, LATCHED, LATEST, RECENT, RELIABLE
from sensor_msgs.msg import JointState

from facade_manipulator.kinematics import (
    Carriages,
    forward_kinematics,
    Geometry,
    inverse_kinematics,
    Pose,
)
from facade_manipulator.messages import planar_pose, seconds
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.nodes.ik_service import IkServiceNode, LEAD
from facade_manipulator.ros.conversions import pose_stamped, stamp
from facade_manipulator.ros.diagnostics import DriverStatus

pytestmark = pytest.mark.quick

GEOMETRY = Geometry()
MIDDLE = Pose(0.05, 0.25, 0.1)
SPEED = MotionLimits().speed


@pytest.fixture
def bench(ros):
    """Give an ik_service node and everything around it."""
    class Bench:
        node = ros.add(IkServiceNode())
        tester = ros.node('tester')

        def __init__(self):
            self.setpoints = ros.collect(self.tester, JointState, 'joint_setpoints', LATEST)
            self.statuses = ros.collect(
                self.tester, DiagnosticStatus, 'ik_service/status', LATCHED)
            self.rejections = ros.collect(
                self.tester, DiagnosticStatus, 'ik_service/rejections', RECENT)
            self.heads = ros.collect(self.tester, PoseStamped, 'end_effector_pose', RELIABLE)
            self.goals = self.tester.create_publisher(PoseStamped, 'corrected_pose', LATEST)
            self.states = self.tester.create_publisher(JointState, 'joint_states', RELIABLE)
            ros.until(lambda: self.goals.get_subscription_count() == 1
                      and self.states.get_subscription_count() == 1
                      and self.node.count_subscribers('joint_setpoints') == 1
                      and self.statuses, 'the graph')

        def now(self):
            return self.tester.get_clock().now().nanoseconds * 1e-9

        def rejection(self, message):
            self.statuses.clear()
            self.goals.publish(message)
            ros.until(lambda: self.statuses, 'a status')
            assert self.statuses[-1].level == DiagnosticStatus.ERROR
            assert self.setpoints == []
            return self.statuses[-1].message

        def solve(self, goal, start=None, tolerance=0.0):
            request = GetPlan.Request(goal=goal, tolerance=tolerance)
            if start is not None:
                request.start = start
            return ros.call(self.tester, GetPlan, 'ik_service/solve', request).plan

    made = Bench()
    made.until = ros.until
    return made


def rail(pose, time=0.0):
    return pose_stamped('rail', time, pose)


def carriages_at(pose, **more):
    return JointState(
        name=['q1', 'q2', 'q3'], position=inverse_kinematics(GEOMETRY, pose), **more)


def test_a_stream_of_goals_becomes_setpoints_with_positions_and_velocities(bench):
    begin, step, speed = bench.now(), 0.01, 0.2
    for k in range(5):
        pose = MIDDLE._replace(x=MIDDLE.x + speed * k * step)
        bench.goals.publish(rail(pose, begin + k * step))
        bench.until(lambda count=k: len(bench.setpoints) > count, 'a setpoint')
    last = bench.setpoints[-1]
    assert list(last.name) == ['q1', 'q2', 'q3']
    assert list(last.position) == pytest.approx(inverse_kinematics(GEOMETRY, pose), abs=1e-12)
    assert list(last.velocity) == pytest.approx([speed] * 3, rel=1e-3)
    assert seconds(last.header.stamp) == pytest.approx(begin + 4 * step, abs=1e-6)


def test_a_goal_that_comes_alone_is_approached_from_where_the_head_is(bench):
    start = Pose(-0.05, 0.25, 0.0)
    assert bench.node._approaching.is_canceled()  # nothing to lead, nothing to wake up for
    bench.states.publish(carriages_at(start))
    bench.until(lambda: bench.heads, 'end_effector_pose')
    begin = bench.now()
    bench.goals.publish(rail(MIDDLE))
    there = list(inverse_kinematics(GEOMETRY, MIDDLE))
    bench.until(lambda: bench.setpoints and list(bench.setpoints[-1].position)
                == pytest.approx(there, abs=1e-9), 'the setpoint of the goal')
    times = [seconds(item.header.stamp) for item in bench.setpoints]
    assert times == sorted(times) and times[0] >= begin + LEAD  # of each, ahead of its time
    assert abs(bench.setpoints[0].position[2] - start.x) < 0.001
    assert all(abs(b.position[2] - a.position[2]) <= SPEED * (then - now) + 1e-6
               for (now, a), (then, b) in pairwise(zip(times, bench.setpoints, strict=True)))
    bench.until(bench.node._approaching.is_canceled, 'the end of the approach')
    count = len(bench.setpoints)
    bench.goals.publish(rail(MIDDLE._replace(y=0.4)))
    bench.until(lambda: bench.statuses[-1].level == DiagnosticStatus.ERROR, 'the rejection')
    assert len(bench.setpoints) == count


def test_a_goal_that_comes_alone_is_approached_though_the_clock_was_set_back(bench):
    bench.states.publish(carriages_at(MIDDLE))
    bench.until(lambda: bench.heads, 'end_effector_pose')
    bench.goals.publish(rail(MIDDLE, bench.now()))
    bench.until(lambda: bench.setpoints, 'a setpoint')
    bench.until(bench.node._approaching.is_canceled, 'the end of the approach')
    count = len(bench.setpoints)
    bench.node._last_goal_time += 600.0  # the goal before was stamped before the step
    bench.goals.publish(rail(MIDDLE._replace(x=MIDDLE.x + 0.1), bench.now()))
    bench.until(lambda: len(bench.setpoints) > count, 'the next setpoint')
    assert abs(bench.setpoints[count].position[2] - MIDDLE.x) < 0.01


def test_a_goal_that_cannot_be_gives_no_setpoint_but_a_status_with_value_and_bound(bench):
    out_of_plane = rail(MIDDLE)
    out_of_plane.pose.position.z = 0.1
    for message, expected in (
            (out_of_plane, 'z = 0.1 m is out of the plane'),
            (rail(MIDDLE._replace(x=math.nan)), 'x = nan is not a finite number'),
            (pose_stamped('facade', 0.0, MIDDLE), "in frame 'facade', expected 'rail'"),
            (rail(MIDDLE._replace(y=0.4)), 'bound 0.352 m'),
            (rail(MIDDLE._replace(y=0.055)), 'q3 - q1'),
            (rail(MIDDLE._replace(x=0.5)), 'q2'),
            (rail(MIDDLE._replace(y=-0.25)), 'y = -0.25 m'),
            (rail(Pose(0.0, 0.35199, 0.0)), 'conditioning index')):
        assert expected in bench.rejection(message)


@pytest.mark.parametrize('age, message', [
    (3600.0, 'corrected_pose is 3600.0'), (5.5, 's old, bound 5 s'),
    (-1.5, 's from the future, bound 1 s')])
def test_pose_of_another_time_moves_nothing(bench, age, message):
    assert message in bench.rejection(rail(MIDDLE, bench.now() - age))


def test_old_pose_leaves_a_stream_as_it_is(bench):
    bench.goals.publish(rail(MIDDLE, bench.now()))
    bench.until(lambda: len(bench.setpoints) == 1, 'a setpoint')
    bench.goals.publish(rail(MIDDLE._replace(x=MIDDLE.x + 0.08), bench.now() - 3600.0))
    bench.until(lambda: bench.node._rejections.total == 1, 'the rejection')
    bench.goals.publish(rail(MIDDLE, bench.now()))
    bench.until(lambda: len(bench.setpoints) == 2, 'the next setpoint')
    assert bench.setpoints[0].position == bench.setpoints[1].position


def test_second_publisher_of_joint_states_is_named_and_moves_nothing(bench, ros):
    bench.states.publish(carriages_at(MIDDLE))
    bench.until(lambda: bench.heads, 'end_effector_pose')
    foreign = ros.node('joint_state_publisher')
    zeros = foreign.create_publisher(JointState, 'joint_states', RELIABLE)
    message = ('joint_states has 2 publishers (/joint_state_publisher, /tester), bound 1; '
               'next: end one of the nodes')
    bench.until(lambda: bench.node._outcome() == ('error', message), 'the error')
    bench.heads.clear()
    for states in (JointState(name=['q1', 'q2', 'q3'], position=[0.0] * 3),
                   carriages_at(MIDDLE._replace(x=0.0))):
        rejected = bench.node._rejections.total
        zeros.publish(states)
        bench.until(lambda n=rejected: bench.node._rejections.total > n, 'the rejection')
    for _ in range(2):  # the second one is no stream with the first
        rejected = bench.node._rejections.total
        bench.goals.publish(rail(MIDDLE))
        bench.until(lambda n=rejected: bench.node._rejections.total > n, 'the rejected goal')
    assert 'joint_states rejected: joint_states has 2' in bench.node._rejections.last_message
    assert not bench.heads and not bench.setpoints
    foreign.destroy_publisher(zeros)
    bench.until(lambda: not bench.node._sources.fault, 'one publisher')
    bench.states.publish(carriages_at(MIDDLE))
    bench.until(lambda: bench.heads, 'end_effector_pose')
    bench.goals.publish(rail(MIDDLE._replace(x=MIDDLE.x + 0.01)))
    bench.until(lambda: bench.setpoints, 'an approach')


def test_refusals_are_counted_by_reason_in_the_diagnostics(bench):
    arrays = []
    bench.tester.create_subscription(DiagnosticArray, '/diagnostics', arrays.append, RELIABLE)
    bench.rejection(pose_stamped('facade', 0.0, MIDDLE))

    def counted():
        values = {item.key: item.value for array in arrays for status in array.status
                  if status.name == 'ik_service: goal' for item in status.values}
        return values.get('rejected: frame') == '1'
    bench.until(counted, 'the counter')


def test_after_a_rejected_goal_the_next_good_one_is_followed(bench):
    bench.rejection(rail(MIDDLE._replace(y=0.4)))
    bench.goals.publish(rail(MIDDLE, bench.now()))
    bench.until(lambda: bench.setpoints, 'a setpoint')


def test_the_pose_of_the_head_is_that_of_the_carriages_at_their_stamp(bench):
    carriages = inverse_kinematics(GEOMETRY, MIDDLE)
    message = JointState(name=['q3', 'q1', 'q2'],
                         position=[carriages.q3, carriages.q1, carriages.q2])
    message.header.stamp = stamp(12.5)
    bench.states.publish(message)
    bench.until(lambda: bench.heads, 'end_effector_pose')
    head = bench.heads[-1]
    assert head.header.frame_id == 'rail' and seconds(head.header.stamp) == 12.5
    assert planar_pose(head.pose, 'head') == pytest.approx(MIDDLE, abs=1e-9)


def test_solve_answers_with_the_carriages_of_one_pose(bench):
    plan = bench.solve(rail(MIDDLE))
    assert plan.header.frame_id == 'actuator_space'
    point = plan.poses[0].pose.position
    assert len(plan.poses) == 1
    assert (point.x, point.y, point.z) == pytest.approx(inverse_kinematics(GEOMETRY, MIDDLE))


def test_solve_answers_with_a_straight_path_whose_poses_lie_within_the_spacing(bench):
    goal = Pose(-0.1, 0.28, -0.1)
    plan = bench.solve(rail(goal), rail(MIDDLE), 0.002)
    poses = [forward_kinematics(GEOMETRY, Carriages(p.x, p.y, p.z))
             for p in (item.pose.position for item in plan.poses)]
    assert poses[0] == pytest.approx(MIDDLE, abs=1e-9)
    assert poses[-1] == pytest.approx(goal, abs=1e-9)
    for a, b in zip(poses, poses[1:], strict=False):
        assert math.hypot(b.x - a.x, b.y - a.y) <= 0.002
    share = [(pose.x - MIDDLE.x) / (goal.x - MIDDLE.x) for pose in poses]
    assert [pose.theta for pose in poses] == pytest.approx(
        [MIDDLE.theta + s * (goal.theta - MIDDLE.theta) for s in share], abs=1e-9)


def test_solve_rejects_with_an_empty_plan_and_the_reason_on_its_own_topic(bench):
    bench.statuses.clear()
    for message, goal, *more in (
            ('bound 0.352 m', rail(Pose(0.0, 0.4, 0.0))),
            ("'facade'", pose_stamped('facade', 0.0, MIDDLE)),
            ("start is in frame 'map'", rail(MIDDLE), pose_stamped('map', 0.0, MIDDLE)),
            ('tolerance|poses, bound', rail(Pose(-0.3, 0.25, 0.0)), rail(Pose(0.3, 0.25, 0.0)),
             1e-7),
            ('tolerance = -1.0 m is not a distance', rail(MIDDLE), rail(MIDDLE), -1.0),
            ('tolerance = nan', rail(MIDDLE), rail(MIDDLE), math.nan),
            (r'b \|sin', rail(Pose(0.0, 0.25, -0.25)), rail(Pose(0.0, 0.25, 0.5)))):
        bench.rejections.clear()
        assert len(bench.solve(goal, *more).poses) == 0
        bench.until(lambda: bench.rejections, 'the rejection')
        assert re.search(message, bench.rejections[-1].message)
        assert bench.statuses == []  # nobody asked the machine to move


def test_every_rejected_request_is_published_with_its_limit_and_the_stamp_of_its_goal(bench):
    times = [12.25, 13.5, 13.5]
    for time in times:
        bench.solve(rail(Pose(0.0, 0.4, 0.0), time))
    bench.until(lambda: len(bench.rejections) == len(times), 'one rejection for each request')
    values = [{item.key: item.value for item in status.values} for status in bench.rejections]
    assert [each['goal stamp'] for each in values] == [
        '12.250000000', '13.500000000', '13.500000000']
    assert values[0] == {
        'goal stamp': '12.250000000', 'reason': 'unreachable', 'quantity': values[0]['quantity'],
        'value': '0.4', 'bound': '0.352', 'unit': 'm'}


@pytest.fixture
def driver(bench):
    """Give what publishes what the driver is doing, and waits until it is known."""
    publisher = bench.tester.create_publisher(DiagnosticStatus, DRIVER_STATUS, LATCHED)

    def publish(state, activity='holding', next_step='', since=math.inf):
        status = DriverStatus(state, activity, next_step, since)
        publisher.publish(status.to_message('ok', state))
        bench.until(lambda: bench.node._driver.status == status, state)

    return publish


def test_the_status_says_what_the_machine_does(bench, driver):
    def until(message, level):
        bench.until(lambda: (bench.statuses[-1].message, bench.statuses[-1].level)
                    == (message, level), f'{message}, not {bench.statuses[-1].message}')

    driver('unconfigured', next_step='configure')
    until('no goal is followed: the drives are unconfigured; next: configure',
          DiagnosticStatus.WARN)
    bench.goals.publish(rail(MIDDLE, bench.now()))
    driver('stopped', next_step='clear_faults, activate')
    until('no goal is followed: the drives are stopped; next: clear_faults, activate',
          DiagnosticStatus.WARN)
    assert bench.setpoints == []
    driver('active', since=bench.now())
    until('holding: no goal since the drives were activated', DiagnosticStatus.OK)
    bench.goals.publish(rail(MIDDLE, bench.now()))
    bench.until(lambda: bench.setpoints, 'a setpoint')
    driver('active', 'following', since=bench.now() - 1.0)
    until('following the goals', DiagnosticStatus.OK)
    driver('active', 'holding', since=bench.now() - 1.0)
    until('holding: no goal comes', DiagnosticStatus.OK)


def test_a_goal_from_before_the_activation_moves_nothing(bench, driver):
    start = Pose(-0.05, 0.25, 0.0)
    bench.states.publish(carriages_at(start))
    bench.until(lambda: bench.heads, 'end_effector_pose')
    driver('inactive')
    bench.goals.publish(rail(MIDDLE))
    bench.until(lambda: bench.node._waiting, 'the goal')
    driver('active', since=bench.now())
    assert bench.node._approaching.is_canceled()
    bench.goals.publish(rail(MIDDLE))
    bench.until(lambda: bench.setpoints, 'a setpoint')
    driver('stopped')
    bench.until(bench.node._approaching.is_canceled, 'the end of the approach')


def test_a_goal_right_after_the_activation_is_approached(bench, driver):
    driver('activating')
    since = bench.now()
    bench.goals.publish(rail(MIDDLE))
    bench.until(lambda: bench.node._waiting, 'the goal')
    driver('active', since=since)
    bench.until(lambda: bench.setpoints, 'a setpoint')


def test_joint_states_that_cannot_be_give_no_head_and_are_counted(bench):
    bench.states.publish(JointState(name=['q1', 'q2'], position=[0.0, 0.1]))
    bench.until(lambda: bench.node._rejections.total, 'the rejection')
    assert bench.heads == []
