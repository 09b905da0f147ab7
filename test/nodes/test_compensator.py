"""The compensator node, spoken to as its neighbours do."""

import math

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import (
    Point,
    PointStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    WrenchStamped,
)
from geometry_msgs.msg import Pose as PoseMessage
from nav_msgs.msg import Odometry
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import SetBool, Trigger

from facade_manipulator import topics
from facade_manipulator.kinematics import Pose
from facade_manipulator.kinematics.planar import compose
from facade_manipulator.messages import HOLD, millimetres, planar_pose, seconds, status_values
from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.conversions import pose_message, pose_stamped, stamp
from facade_manipulator.nodes.driver_status import DriverStatus
from facade_manipulator.topics import LATCHED, LATEST, RECENT, RELIABLE

FOLLOWED = {'followed x [mm]': 1e3, 'followed y [mm]': 1e3,
            'followed angle [deg]': math.degrees(1.0)}
GOAL, OUTSIDE = Pose(0.03, 0.25, 0.02), Pose(0.0, 0.9, 0.0)
DISTURBANCE = Pose(0.05, 0.01, 0.02)


class Neighbours:
    """Supervisor, estimator and ik_service in one test node."""

    def __init__(self, ros, **parameters):
        self.ros = ros
        parameters = {'correction.fade_time': 0.3, **parameters}
        self.compensator = ros.add(CompensatorNode(parameter_overrides=[
            Parameter(name, value=value) for name, value in parameters.items()]))
        self.node = ros.node()
        self.disturbance = Pose(*DISTURBANCE)
        self.goals = self.node.create_publisher(PoseStamped, 'goal_pose', LATEST)
        self.estimates = self.node.create_publisher(
            PoseWithCovarianceStamped, 'disturbance', qos_profile_sensor_data)
        self.heads = self.node.create_publisher(PoseStamped, 'end_effector_pose', RELIABLE)
        self.corrected = ros.collect(self.node, PoseStamped, 'corrected_pose', LATEST)
        self.references = ros.collect(self.node, PoseStamped, 'compensator/reference')
        self.diagnostics = ros.collect(self.node, DiagnosticArray, '/diagnostics')
        for publisher in (self.goals, self.estimates, self.heads):
            ros.until(lambda p=publisher: p.get_subscription_count() == 1, 'the compensator')

    def now(self):
        return self.node.get_clock().now().nanoseconds * 1e-9

    def estimate(self, pose=None, frame='facade', age=0.0, covariance={}):  # noqa: B006  # read
        message = PoseWithCovarianceStamped()
        message.header.frame_id = frame
        message.header.stamp = stamp(self.now() - age)
        message.pose.pose = pose_message(pose or self.disturbance)
        for index, variance in covariance.items():
            message.pose.covariance[index] = variance
        self.estimates.publish(message)

    def start_estimator(self):
        self.timer = self.node.create_timer(0.02, self.estimate)

    def send_goal(self, pose=GOAL, frame='facade'):
        self.goals.publish(pose_stamped(frame, self.now(), pose))

    def pose(self):
        """Return the newest corrected pose, the goal before there is one."""
        return planar_pose(self.corrected[-1].pose, 'pose') if self.corrected else GOAL

    def until_corrected(self, condition, what):
        self.ros.until(lambda: self.corrected and condition(self.pose()), what)

    def value(self, key):
        for message in reversed(self.diagnostics):
            for item in message.status[0].values:
                if item.key == key:
                    return item.value
        return None

    def until_rejected(self, reason):
        self.ros.until(lambda: self.value(f'rejected: {reason}') == '1', reason)

    def message(self):
        return self.diagnostics[-1].status[0].message if self.diagnostics else ''


@pytest.fixture
def neighbours(ros):
    return Neighbours(ros)


def on_the_wall(pose):
    return compose(DISTURBANCE, pose)


@pytest.mark.quick
def test_goal_status_names_the_followed_goal_after_a_rejection(neighbours):
    def collect(qos=LATCHED):
        return neighbours.ros.collect(neighbours.node, *topics.GOAL_STATUS[:2], qos)

    statuses = collect(RECENT)  # progress of the previous goal follows a rejection at once
    for goal, followed in ((OUTSIDE, None), (GOAL, GOAL), (OUTSIDE, GOAL)):
        statuses.clear()
        neighbours.send_goal(goal)
        state = 'rejected' if goal is OUTSIDE else 'accepted'
        neighbours.ros.until(lambda s=state: any(s in one.message for one in statuses), state)
        late = collect()
        neighbours.ros.until(lambda late=late: late, 'goal_status')
        values = status_values(late[-1])
        assert [float(values[key]) / scale for key, scale in FOLLOWED.items()
                if key in values] == pytest.approx(list(followed or ()), abs=1e-6)


def near(pose, goal, tolerance=1e-3):
    return max(abs(a - b) for a, b in zip(pose, goal, strict=True)) < tolerance


def test_goal_is_corrected_until_disabled_silent_or_tared(neighbours):
    def until_on_the_wall(what='the corrected goal'):
        neighbours.until_corrected(lambda pose: near(on_the_wall(pose), GOAL), what)

    neighbours.start_estimator()
    neighbours.send_goal()
    until_on_the_wall()
    message = neighbours.corrected[-1]
    assert message.header.frame_id == 'rail'
    assert seconds(message.header.stamp) - neighbours.now() < 0.07
    reference = neighbours.references[-1]
    assert reference.header.frame_id == 'facade'
    assert planar_pose(reference.pose, 'reference') == pytest.approx(tuple(GOAL), abs=1e-6)
    neighbours.ros.until(lambda: neighbours.message() == 'compensating', 'the diagnosis')
    assert neighbours.value('horizon [ms]') == '60'
    for enabled, way in ((False, 'out'), (True, 'in')):
        reply = neighbours.ros.call(
            neighbours.node, SetBool, 'compensator/enable', SetBool.Request(data=enabled))
        assert reply.success and f'fades {way}' in reply.message
        if enabled:
            until_on_the_wall('the correction to fade in')
        else:
            neighbours.until_corrected(lambda pose: near(pose, GOAL), 'it to fade out')
    neighbours.node.destroy_timer(neighbours.timer)
    neighbours.ros.until(lambda: 'silent' in neighbours.message(), 'the diagnosis')
    neighbours.until_corrected(lambda pose: near(pose, GOAL), 'the goal itself')
    neighbours.start_estimator()
    until_on_the_wall('the correction again')
    reply = neighbours.ros.call(neighbours.node, Trigger, 'compensator/tare')
    assert reply.success and 'x +50.0 mm' in reply.message
    neighbours.until_corrected(lambda pose: near(pose, GOAL), 'the goal at the new place')


@pytest.mark.quick
def test_goal_without_an_estimate_is_published_uncorrected(neighbours):
    neighbours.send_goal()
    neighbours.until_corrected(lambda pose: near(pose, GOAL, 1e-6), 'the goal')
    neighbours.ros.until(lambda: 'no valid estimate' in neighbours.message(), 'the diagnosis')


@pytest.mark.quick
def test_bad_goal_is_rejected_and_counted(neighbours):
    neighbours.send_goal()
    neighbours.until_corrected(lambda pose: near(pose, GOAL, 1e-6), 'the good goal')
    for reason, pose, *frame in (
            ('not_finite', Pose(math.nan, 0.25, 0.0)), ('frame', GOAL, 'rail'),
            ('unreachable', Pose(0.0, 0.5, 0.0)), ('stroke', Pose(0.49, 0.25, 0.0)),
            ('carriage_gap', Pose(0.0, 0.06, 0.0))):
        neighbours.send_goal(pose, *frame)
        neighbours.until_rejected(reason)
        assert 'bound' in neighbours.value('last rejection') or reason in ('not_finite', 'frame')
        assert near(neighbours.pose(), GOAL, 1e-6)


@pytest.mark.quick
@pytest.mark.parametrize('age, reason', [(3600.0, 'stale'), (5.5, 'stale'), (-1.5, 'future')])
def test_goal_of_another_time_is_rejected_with_its_age(neighbours, age, reason):
    neighbours.send_goal()
    neighbours.until_corrected(lambda pose: near(pose, GOAL, 1e-6), 'the goal')
    neighbours.goals.publish(pose_stamped(
        'facade', neighbours.now() - age, GOAL._replace(x=GOAL.x + 0.05)))
    neighbours.until_rejected(reason)
    words = f'goal_pose is {abs(age):.0f}'[:-1]
    assert neighbours.value('last rejection').startswith(words)
    assert near(neighbours.pose(), GOAL, 1e-6)


@pytest.mark.quick
def test_repetition_of_the_followed_goal_is_ignored(neighbours):
    statuses = neighbours.ros.collect(
        neighbours.node, DiagnosticStatus, topics.GOAL_STATUS.name, RECENT)
    goal = pose_stamped('facade', neighbours.now() - 4.0, GOAL)
    neighbours.goals.publish(goal)
    neighbours.ros.until(lambda: any('reached' in one.message or 'moving' in one.message
                                     for one in statuses), 'the goal')
    followed = neighbours.compensator._goal
    neighbours.compensator._receive_goal(goal)
    neighbours.compensator._receive_goal(pose_stamped('facade', 0.0, GOAL))
    assert neighbours.compensator._goal is followed
    neighbours.compensator._receive_goal(pose_stamped('facade', neighbours.now(), GOAL))
    assert neighbours.compensator._goal is not followed
    assert not neighbours.compensator.rejections.total


@pytest.mark.quick
def test_second_publisher_of_goals_is_named_and_moves_nothing(neighbours):
    ros = neighbours.ros
    neighbours.send_goal()
    neighbours.until_corrected(lambda pose: near(pose, GOAL, 1e-6), 'the goal')
    player = ros.node('rosbag2_player')
    goals = player.create_publisher(PoseStamped, 'goal_pose', LATEST)
    ros.until(lambda: 'goal_pose has 2 publishers (/rosbag2_player, /tester), bound 1'
              in neighbours.message(), 'the error')
    assert neighbours.diagnostics[-1].status[0].level == DiagnosticStatus.ERROR
    statuses = ros.collect(neighbours.node, DiagnosticStatus, topics.GOAL_STATUS.name, RECENT)
    goals.publish(pose_stamped('facade', neighbours.now(), GOAL._replace(x=0.0)))
    neighbours.until_rejected('publishers')
    ros.until(lambda: any('rejected: goal_pose rejected: goal_pose has 2' in one.message
                          for one in statuses), 'goal_status')
    assert near(neighbours.pose(), GOAL, 1e-6)


@pytest.mark.quick
def test_bad_estimate_is_rejected_and_counted(neighbours):
    for reason, arguments in {
            'not_finite': {'pose': Pose(math.inf, 0.0, 0.0)}, 'frame': {'frame': 'map'},
            'stale': {'age': 1.0}, 'future': {'age': -1.0},
            'range': {'pose': Pose(5.0, 0.0, 0.0)}}.items():
        neighbours.estimate(**arguments)
        neighbours.until_rejected(reason)
        assert 'no valid estimate' in neighbours.message()


def odometry(time, child, x=0.0, tilt=0.0):
    message = Odometry(child_frame_id=child)
    message.header.frame_id, message.header.stamp = 'facade', stamp(time)
    message.pose.pose = PoseMessage(
        position=Point(x=x, z=0.4), orientation=Quaternion(x=math.sin(tilt / 2),
                                                           w=math.cos(tilt / 2)))
    return message


@pytest.mark.parametrize(('child', 'place'), [('rail', 0.05), ('prism', 0.55)])
def test_odometry_of_rail_or_estimator_is_an_estimate(ros, child, place):
    neighbours = Neighbours(ros, **{'estimate.mounting': [0.5 * (child == 'prism'), 0.0, 0.0]})
    estimates = neighbours.node.create_publisher(
        Odometry, 'disturbance_odometry', qos_profile_sensor_data)
    timer = neighbours.node.create_timer(0.02, lambda: estimates.publish(
        odometry(neighbours.now(), child, place, tilt=0.01)))
    neighbours.send_goal()
    neighbours.until_corrected(
        lambda pose: near(compose(Pose(0.05, 0.0, 0.0), pose), GOAL), 'the corrected goal')
    neighbours.ros.until(lambda: neighbours.value('left out of the estimate')
                         == 'z +400.0 mm, tilt 0.57 deg', 'what is out of the plane')
    timer.cancel()
    for message, reason in ((odometry(neighbours.now(), child, place, tilt=0.06), 'out_of_plane'),
                            (odometry(neighbours.now(), '', place), 'frame')):
        estimates.publish(message)
        neighbours.until_rejected(reason)


@pytest.mark.quick
def test_best_effort_publisher_of_goals_is_reported(neighbours):
    neighbours.node.create_publisher(PoseStamped, 'goal_pose', qos_profile_sensor_data)
    neighbours.until_rejected('quality')
    assert 'goal_pose has an incompatible publisher' in neighbours.value('last rejection')


@pytest.mark.quick
def test_tare_without_an_estimate_is_rejected(neighbours):
    reply = neighbours.ros.call(neighbours.node, Trigger, 'compensator/tare')
    assert not reply.success
    assert 'none has come' in reply.message


@pytest.mark.quick
def test_path_begins_at_the_head(neighbours):
    head = Pose(-0.05, 0.24, 0.0)
    for _ in range(3):
        neighbours.heads.publish(pose_stamped('rail', neighbours.now(), head))
        neighbours.ros.executor.spin_once(0.02)
    neighbours.send_goal()
    neighbours.ros.until(lambda: neighbours.corrected, 'a corrected pose')
    first = planar_pose(neighbours.corrected[0].pose, 'pose')
    assert near(first, head, 0.01)


@pytest.mark.quick
def test_goal_from_before_the_activation_moves_nothing(neighbours):
    driver = neighbours.node.create_publisher(*topics.DRIVER_STATUS)
    ros = neighbours.ros

    def publish(status):
        driver.publish(status.to_message('ok', status.state))
        ros.until(lambda: neighbours.compensator._driver.status == status, status.state)

    publish(DriverStatus('inactive', 'holding', 'activate'))
    neighbours.send_goal()
    ros.until(lambda: neighbours.compensator._goal, 'the goal')
    publish(DriverStatus('active', 'holding', '', neighbours.now()))
    neighbours.start_estimator()
    ros.until(lambda: neighbours.value('age of the estimate [ms]') not in (None, 'inf'), 'time')
    assert neighbours.corrected == []
    neighbours.send_goal()
    ros.until(lambda: neighbours.corrected, 'a corrected pose')
    publish(DriverStatus('halted', 'holding', 'clear_faults'))
    neighbours.corrected.clear()
    publish(DriverStatus('active', 'holding', '', neighbours.now()))
    ros.until(lambda: neighbours.value('corrected poses'), 'diagnostics')
    told = len(neighbours.diagnostics)
    ros.until(lambda: len(neighbours.diagnostics) > told + 1, 'time')
    assert len(neighbours.corrected) <= 1  # that was on its way when the drives were halted


@pytest.mark.quick
def test_goal_right_after_the_activation_is_followed(neighbours):
    """It may come before the driver's status does, which another process publishes."""
    driver = neighbours.node.create_publisher(*topics.DRIVER_STATUS)
    idle = DriverStatus('activating', 'holding', '')
    driver.publish(idle.to_message('ok', ''))
    neighbours.ros.until(lambda: neighbours.compensator._driver.status == idle, 'the driver')
    since = neighbours.now()
    neighbours.send_goal()
    neighbours.ros.until(lambda: neighbours.compensator._goal, 'the goal')
    statuses = neighbours.ros.collect(
        neighbours.node, DiagnosticStatus, topics.GOAL_STATUS.name, RECENT)
    driver.publish(DriverStatus('active', 'holding', '', since).to_message('ok', ''))
    neighbours.ros.until(lambda: neighbours.corrected, 'a corrected pose')
    neighbours.ros.until(lambda: 'accepted' in [one.message for one in statuses], 'goal_status')


@pytest.mark.quick
def test_hold_ends_the_goal_at_the_head(neighbours):
    node, ros = neighbours.node, neighbours.ros
    statuses = ros.collect(node, *topics.GOAL_STATUS[:2], RECENT)
    reply = ros.call(node, Trigger, 'compensator/hold')
    assert not reply.success and 'the head follows no goal' in reply.message
    neighbours.send_goal()
    neighbours.until_corrected(lambda pose: near(pose, GOAL, 1e-6), 'the goal')
    reply = ros.call(node, Trigger, 'compensator/hold')
    assert reply.success and reply.message == (
        f'the head stays on the wall at {millimetres(GOAL)}')
    ros.until(lambda: [one for one in statuses if one.message == f'ended: {HOLD}'], 'the end')


@pytest.mark.quick
@pytest.mark.parametrize('during', [False, True])
def test_goal_from_before_or_during_driver_silence_moves_nothing(
        ros, monkeypatch, during):
    monkeypatch.setattr('facade_manipulator.nodes.driver_status.SILENCE', 0.3)
    neighbours = Neighbours(ros)
    node, watch = neighbours.node, neighbours.compensator._driver
    driver = node.create_publisher(*topics.DRIVER_STATUS)
    statuses = ros.collect(node, DiagnosticStatus, topics.GOAL_STATUS.name, RECENT)
    active = DriverStatus('active', 'holding', '', neighbours.now()).to_message('ok', '')
    driver.publish(active)
    ros.until(lambda: watch.status and not watch.idle, 'the driver')
    neighbours.send_goal()
    ros.until(lambda: any('ended' in one.message for one in statuses), 'the silence')
    if during:
        neighbours.send_goal()
        ros.until(lambda: 'rejected' in statuses[-1].message, 'the rejection')
    statuses.clear()
    neighbours.corrected.clear()
    driver.publish(active)
    ros.until(lambda: not watch.idle, 'the driver again')
    ros.until(lambda: watch.idle, 'another silence')
    assert len(neighbours.corrected) <= 1 and not statuses  # one may have been on its way
    driver.publish(active)
    ros.until(lambda: not watch.idle, 'the driver again')
    neighbours.send_goal()
    ros.until(lambda: neighbours.corrected, 'a corrected pose')


def wrench(now, frame='end_effector', force=-10.0):
    message = WrenchStamped()
    message.header.frame_id, message.header.stamp = frame, stamp(now)
    message.wrench.force.y = force
    return message


@pytest.fixture
def pressing(ros):
    """Give neighbours of a head that touches a wall, and the status of its goal."""
    made = Neighbours(ros, **{
        'contact.enabled': True, 'contact.force': 10.0, 'contact.retreat': 0.015,
        'contact.ramp_time': 1.0})
    sensor = made.node.create_publisher(WrenchStamped, 'contact_wrench', qos_profile_sensor_data)
    made.progress = ros.collect(made.node, DiagnosticStatus, topics.GOAL_STATUS.name, LATCHED)
    made.wall = 0.24

    def feel():
        noise = 0.01 * math.sin(1e3 * made.now())
        sensor.publish(wrench(
            made.now(), force=noise - 600.0 * max(made.pose().y - made.wall, 0.0)))

    made.node.create_timer(0.02, feel)
    return made


def test_goal_is_shifted_until_the_force_is_reached(ros, pressing):
    progress = pressing.progress
    pressing.send_goal()
    ros.until(lambda: any('zero' in message.message for message in progress), 'why it waits')
    pressed = pressing.wall + 10.0 / 600.0
    pressing.until_corrected(lambda pose: abs(pose.y - pressed) < 1e-3, 'the desired force')
    ros.until(lambda: status_values(progress[-1])['pressing'] == 'holding the force', 'the state')
    force, bound = (float(status_values(progress[-1])[key]) for key in (
        'force on the wall [N]', 'bound of its error [N]'))
    assert abs(force - 10.0) < bound


def test_lateral_offset_is_corrected(ros):
    neighbours = Neighbours(ros, **{'lateral.enabled': True})
    sensor = neighbours.node.create_publisher(
        PointStamped, 'lateral_offset', qos_profile_sensor_data)

    def see():
        message = PointStamped()
        message.header.frame_id = 'end_effector'
        message.header.stamp = stamp(neighbours.now())
        message.point.x = GOAL.x + 0.02 - neighbours.pose().x
        sensor.publish(message)

    neighbours.node.create_timer(0.02, see)
    neighbours.send_goal()
    neighbours.until_corrected(lambda pose: abs(pose.x - GOAL.x - 0.02) < 1e-3, 'the slip')


@pytest.mark.quick
def test_bad_wrench_is_rejected_and_counted(neighbours):
    sensor = neighbours.node.create_publisher(
        WrenchStamped, 'contact_wrench', qos_profile_sensor_data)
    neighbours.ros.until(lambda: sensor.get_subscription_count() == 1, 'the compensator')
    for reason, age, wrong in (('frame', 0.0, {'frame': 'rail'}), ('stale', 2.0, {}),
                               ('not_finite', 0.0, {'force': math.nan})):
        sensor.publish(wrench(neighbours.now() - age, **wrong))
        neighbours.until_rejected(reason)
