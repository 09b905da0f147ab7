"""Compensator node among a supervisor, an estimator, sensors and the driver."""

import math
from time import monotonic
from types import SimpleNamespace

from geometry_msgs.msg import (
    Point,
    PointStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    TransformStamped,
    WrenchStamped,
)
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from nodes.node_rig import driver_message, NodeBench
import pytest
from std_srvs.srv import SetBool, Trigger

from facade_manipulator import topics
from facade_manipulator.compensation.goal import GoalState
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Pose, ZERO_POSE
from facade_manipulator.kinematics.planar import compose, millimetres
from facade_manipulator.nodes import conversions
from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.conversions import pose_message, pose_stamped, stamp
from facade_manipulator.nodes.driver_status import DriverStatus, SILENT
from facade_manipulator.nodes.planar_messages import planar_pose, seconds, status_values

GOAL = Pose(0.03, 0.25, 0.02)
DISTURBANCE = Pose(0.05, 0.01, 0.02)


class Neighbours(NodeBench):
    """Supervisor, estimator, sensors and ik_service in one test node."""

    def __init__(self, ros, parameters=None):
        super().__init__(
            ros, CompensatorNode, {'correction.fade_time': 0.3} | (parameters or {})
        )
        self.corrected = self.collect(topics.CORRECTED_POSE)
        self.references = self.collect(topics.REFERENCE)
        self.statuses = self.collect(topics.GOAL_STATUS)

    @property
    def compensation(self):
        """Return the core of the node under test."""
        return self.tested._compensator

    def stamped(self, message, frame):
        message.header.frame_id = frame
        message.header.stamp = stamp(self.now())
        return message

    def estimate(self):
        message = self.stamped(PoseWithCovarianceStamped(), 'facade')
        message.pose.pose = pose_message(DISTURBANCE)
        self.publish(topics.DISTURBANCE, message)

    def press(self, force):
        message = self.stamped(WrenchStamped(), 'end_effector')
        message.wrench.force.y = force
        self.publish(topics.CONTACT_WRENCH, message)

    def repeat(self, publish):
        return self.node.create_timer(0.02, publish)

    def send_goal(self, pose=GOAL, frame='facade', age=0.0):
        self.publish(topics.GOAL_POSE, pose_stamped(frame, self.now() - age, pose))

    def pose(self):
        """Return the newest corrected pose, or the goal before the first one."""
        return planar_pose(self.corrected[-1].pose, 'pose') if self.corrected else GOAL

    def until_pose(self, pose, what, tolerance=1e-3, disturbance=ZERO_POSE):
        """Wait for a corrected pose that holds the head at a pose on the wall."""

        def is_there():
            if not self.corrected:
                return False
            found = compose(disturbance, self.pose())
            return found == pytest.approx(pose, abs=tolerance)

        self.ros.until(is_there, what)

    def until_goal_status(self, message):
        def found():
            matching = [one for one in self.statuses if message in one.message]
            return matching[0] if matching else None

        return self.ros.until(found, message)


@pytest.fixture
def neighbours(ros):
    return Neighbours(ros)


@pytest.fixture
def following(neighbours):
    """Return the neighbours of a compensator that follows a goal."""
    neighbours.send_goal()
    neighbours.until_pose(GOAL, 'the goal', 1e-6)
    return neighbours


def test_transform_of_the_rail_needs_estimates_but_no_goal(ros, monkeypatch):
    """No wheel provides tf2_msgs, so a single transform replaces its message."""
    message = SimpleNamespace(TFMessage=TransformStamped)
    monkeypatch.setattr(conversions, 'import_module', lambda _: message)
    neighbours = Neighbours(ros)
    neighbours.tested._transform._message = lambda transforms: transforms[0]
    sent = ros.collect(neighbours.node, TransformStamped, '/tf', 100)
    timer = neighbours.repeat(neighbours.estimate)
    ros.until(lambda: sent, 'the transform')
    place = sent[-1].transform.translation
    assert (place.x, place.y) == pytest.approx(DISTURBANCE[:2], abs=1e-3)
    timer.cancel()

    def has_ended():
        return neighbours.now() - seconds(sent[-1].header.stamp) > 0.2

    ros.until(has_ended, 'the end of the transforms')


def test_goal_is_corrected_until_disabled_silent_or_tared(neighbours):
    timer = neighbours.repeat(neighbours.estimate)
    neighbours.send_goal()
    neighbours.until_pose(GOAL, 'the corrected goal', disturbance=DISTURBANCE)
    message = neighbours.corrected[-1]
    reference = neighbours.references[-1]
    assert message.header.frame_id == 'rail'
    assert reference.header.frame_id == 'facade'
    assert seconds(message.header.stamp) - neighbours.now() < 0.07
    assert reference.header.stamp in [one.header.stamp for one in neighbours.corrected]
    neighbours.compensation.following.lag = 0.04

    def is_reference_at_lagging_head():
        reference_time = seconds(neighbours.references[-1].header.stamp)
        pose_time = seconds(neighbours.corrected[-1].header.stamp)
        return reference_time == pytest.approx(pose_time + 0.04, abs=1e-6)

    neighbours.ros.until(
        is_reference_at_lagging_head,
        'a reference for the instant at which a lagging head is there',
    )
    assert planar_pose(reference.pose, 'reference') == pytest.approx(
        tuple(GOAL), abs=1e-6
    )
    neighbours.until_status('correction', 'compensating', 'ok')
    assert neighbours.value('correction', 'horizon [ms]') == '45'
    for is_enabled, direction, left in (
        (False, 'out', ZERO_POSE),
        (True, 'in', DISTURBANCE),
    ):
        reply = neighbours.call(topics.ENABLE, SetBool.Request(data=is_enabled))
        assert reply.success
        assert f'fades {direction}' in reply.message
        neighbours.until_pose(
            GOAL, f'the correction to fade {direction}', disturbance=left
        )
    timer.cancel()
    neighbours.until_status('correction', 'silent', 'error')
    neighbours.until_pose(GOAL, 'the goal itself')
    timer.reset()
    neighbours.until_pose(GOAL, 'the correction again', disturbance=DISTURBANCE)
    reply = neighbours.call(topics.TARE)
    assert reply.success
    assert 'x +50.0 mm' in reply.message
    neighbours.until_pose(GOAL, 'the goal at the new place')


def test_bad_goal_is_rejected_with_value_and_bound(following):
    """Without an estimate the corrected pose equals the goal."""
    following.until_status('correction', 'no valid estimate', 'warn')
    for count, (reason, message, pose, *more) in enumerate(
        (
            ('not_finite', 'goal_pose x = nan', Pose(math.nan, 0.25, 0.0)),
            ('frame', "in frame 'rail', expected 'facade'", GOAL, 'rail'),
            (
                'stale',
                's old, above the limit 5 s',
                Pose(0.0, 0.25, 0.0),
                'facade',
                5.5,
            ),
            (
                'future',
                's from the future, above the limit 1 s',
                Pose(0.0, 0.25, 0.0),
                'facade',
                -1.5,
            ),
            ('unreachable', 'limit 0.352 m', Pose(0.0, 0.5, 0.0)),
        )
    ):
        following.send_goal(pose, *more)
        assert message in following.until_rejected(reason)
        assert 'rejected: ' in following.until_goal_status(message).message
        assert following.rejection_count() == count + 1
        assert following.pose() == pytest.approx(GOAL)


def test_goal_status_before_the_first_goal_is_none(neighbours):
    status = neighbours.until_goal_status(
        'none: no goal was received; next: send goal_pose'
    )
    values = status_values(status)
    assert values['state'] == 'none'
    assert values['goal stamp'] == ''


def test_repetition_of_the_followed_goal_is_ignored(neighbours):
    goal = pose_stamped('facade', neighbours.now() - 4.0, GOAL)
    neighbours.publish(topics.GOAL_POSE, goal)
    neighbours.until_goal_status('moving')
    node = neighbours.tested
    for repeated in (goal, pose_stamped('facade', 0.0, GOAL)):
        node._receive_goal(repeated)
        assert node._goals.state is GoalState.MOVING
    node._receive_goal(pose_stamped('facade', neighbours.now(), GOAL))
    assert node._goals.state is GoalState.ACCEPTED
    assert not neighbours.rejection_count()


@pytest.mark.parametrize(('child', 'x'), [('rail', 0.05), ('prism', 0.55)])
def test_odometry_of_rail_or_estimator_is_accepted(ros, child, x):
    neighbours = Neighbours(
        ros, {'estimate.mounting': [0.5 * (child == 'prism'), 0.0, 0.0]}
    )

    def send(child=child, tilt=0.01):
        message = neighbours.stamped(Odometry(child_frame_id=child), 'facade')
        message.pose.pose.position = Point(x=x, z=0.4)
        half = tilt / 2
        message.pose.pose.orientation = Quaternion(x=math.sin(half), w=math.cos(half))
        neighbours.publish(topics.DISTURBANCE_ODOMETRY, message)

    timer = neighbours.repeat(send)
    neighbours.send_goal()
    neighbours.until_pose(GOAL, 'the corrected goal', disturbance=Pose(0.05, 0.0, 0.0))
    ros.until(
        lambda: (
            neighbours.value('correction', 'left out of the estimate')
            == 'z +400.0 mm, tilt 0.57 deg'
        ),
        'the parts out of the plane',
    )
    timer.cancel()
    for reason, wrong in (('out_of_plane', {'tilt': 0.06}), ('frame', {'child': ''})):
        send(**wrong)
        neighbours.until_rejected(reason)


def test_second_topic_with_estimates_is_rejected_and_reported(ros, neighbours):
    odometry = Odometry(child_frame_id='rail')
    odometry.pose.pose = pose_message(DISTURBANCE._replace(x=0.03))

    def send():
        message = neighbours.stamped(odometry, 'facade')
        neighbours.publish(topics.DISTURBANCE_ODOMETRY, message)

    neighbours._publisher(
        topics.DISTURBANCE_ODOMETRY
    )  # discovered before the estimates
    correction = neighbours.compensation.correction
    neighbours.repeat(neighbours.estimate)
    ros.until(lambda: math.isfinite(correction.age(0.0)), 'the first estimate')
    neighbours.repeat(send)
    neighbours.until_status(
        'correction',
        'estimates arrive on 2 topics (disturbance, disturbance_odometry), above the limit 1; '
        'next: end one of the nodes',
        'error',
    )
    assert neighbours.tested.diagnostics.rejections()['rejected: publishers']
    predicted = correction.predictor.predict(monotonic()).position
    assert predicted == pytest.approx(DISTURBANCE, abs=1e-3)


def test_second_driver_is_named_as_the_cause_of_silence(ros, neighbours):
    neighbours.publish_driver('active', since=neighbours.now())
    neighbours.send_goal()
    second = ros.node('second').create_publisher(*topics.DRIVER_STATUS)
    neighbours.until_goal_status('ended: driver/status has 2 publishers')
    neighbours.send_goal()
    neighbours.until_goal_status(
        'rejected: driver/status has 2 publishers (/second, /tester), above the limit 1; '
        'next: end one'
    )
    assert neighbours.rejection_count() == 1
    assert second.get_subscription_count() == 1


def test_two_drivers_from_the_start_move_nothing(ros, neighbours):
    """Their rejected status differs from that of a driver of another make, which has none."""
    drivers = []
    for name in ('first', 'second'):
        driver = ros.node(name).create_publisher(*topics.DRIVER_STATUS)
        drivers.append(driver)
    for driver in drivers:
        ros.until(driver.get_subscription_count, 'the compensator')
    status = DriverStatus('active', 'holding', '', neighbours.now())
    drivers[0].publish(driver_message(status))
    ros.until(lambda: neighbours.gate.status is SILENT, 'the rejection')
    neighbours.send_goal()
    neighbours.until_goal_status('rejected: driver/status has 2 publishers')
    assert not neighbours.corrected


def test_goal_right_after_the_activation_is_followed(neighbours):
    """The goal may arrive before the driver's status, which another process publishes."""
    neighbours.gate.PATIENCE = 60.0
    neighbours.publish_driver('activating')
    since = neighbours.now()
    neighbours.send_goal()
    neighbours.ros.until(lambda: neighbours.gate.held, 'the goal')
    neighbours.publish_driver('active', since=since)
    neighbours.ros.until(lambda: neighbours.corrected, 'a corrected pose')
    neighbours.until_goal_status('accepted')


class GoalAnswers:
    """Compensator without a running clock or middleware, and its answers by stamp."""

    def __init__(self, ros, monkeypatch):
        self.time = 1000.0
        for module in ('compensator', 'conversions'):
            monkeypatch.setattr(
                f'facade_manipulator.nodes.{module}.ros_time', lambda: self.time
            )
        monkeypatch.setattr(
            'facade_manipulator.nodes.compensator.monotonic', lambda: self.time
        )
        self.node = ros.add(CompensatorNode())
        self.node._goals._publish = self._record
        self._goals = 0
        self.states = {}

    def _record(self, component):
        values = component[-1]
        self.states.setdefault(values['goal stamp'], []).append(values['state'])

    def goal(self):
        """Send a new goal."""
        self._goals += 1
        pose = Pose(1e-4 * (self._goals % 100), 0.25, 0.0)
        self._message = pose_stamped('facade', self.time, pose)
        self.repeat()

    def repeat(self):
        """Send the last goal again, with the same stamp."""
        try:
            self.node._receive_goal(self._message)
        except InputError as error:
            self.node._reject_goal(self._message, error)

    def driver(self, state, since=math.inf):
        status = DriverStatus(state, 'holding', 'activate', since)
        self.node._gate.receive(self.time, self.time, status)

    def activate(self):
        """Report drives that were activated 0.1 s before this report."""
        self.driver('active', self.time - 0.1)

    def inactivate(self):
        self.driver('inactive')

    def start_activation(self):
        self.driver('activating')

    def silence(self):
        self.wait(2.1)

    def wait(self, seconds=0.06):
        self.time += seconds
        self.node._report_change()

    def wait_long(self):
        self.wait(0.6)

    def hold(self):
        """Call compensator/hold; return whether the request succeeded."""
        return self.node._answer(
            self.node._hold, Trigger.Request(), Trigger.Response()
        ).success


GOAL_EVENTS = (
    'goal repeat activate inactivate start_activation silence wait wait_long hold'
).split()


def test_goal_gets_one_answer_for_any_order_of_events(ros, monkeypatch):
    answers = GoalAnswers(ros, monkeypatch)

    @given(st.lists(st.sampled_from(GOAL_EVENTS), max_size=12))
    def check(events):
        answers.inactivate()  # ends the goal of the previous example
        answers.wait_long()
        answers.states.clear()
        for event in ('goal', *events, 'wait_long', 'wait_long'):
            answers.time += 1e-3
            getattr(answers, event)()
        for states in answers.states.values():
            first = states[0]
            assert first in ('accepted', 'rejected', 'superseded')
            if first == 'accepted':
                assert states.count('accepted') == 1
                assert 'rejected' not in states
            else:
                assert {*states} == {first}

    check()


@pytest.mark.parametrize(
    'later, answer',
    [
        (['activate'], 'accepted'),
        (['start_activation', 'activate', 'repeat'], 'accepted'),
        (['wait_long', 'activate', 'repeat'], 'rejected'),
        (['wait_long', 'repeat', 'activate'], 'rejected'),
        (['silence', 'activate', 'repeat'], 'rejected'),
        (['wait'] * 3 + ['activate'], 'rejected'),
        (['goal'], 'superseded'),
        (['hold', 'activate', 'repeat'], 'rejected'),
    ],
)
def test_goal_before_driver_status_is_answered_in_time(ros, monkeypatch, later, answer):
    answers = GoalAnswers(ros, monkeypatch)
    for event in ('inactivate', 'goal'):
        getattr(answers, event)()
    assert answers.states == {}
    for event in later:
        answers.time += 1e-3
        getattr(answers, event)()
    (stamp, states), *_ = answers.states.items()
    assert {*states} == {answer}


@pytest.mark.parametrize('during', [False, True])
def test_goal_before_or_during_driver_silence_moves_nothing(neighbours, during):
    gate = neighbours.gate
    gate.SILENCE = 0.3
    gate.PATIENCE = 0.075  # shorter than the silence, as in the node
    neighbours.publish_driver('inactive', next_step='activate')
    neighbours.send_goal()
    neighbours.until_goal_status(
        'rejected: the drives are inactive; next: activate, then send the goal with a new stamp'
    )
    assert 'goal_pose rejected: the drives are' in neighbours.until_rejected('inactive')
    since = neighbours.now()
    neighbours.publish_driver('active', since=since)
    neighbours.components.clear()
    neighbours.until_status('correction', '')
    assert not neighbours.corrected
    neighbours.publish_driver('active', since=since)
    neighbours.send_goal()
    neighbours.until_goal_status(
        'ended: the driver is silent; next: check whether the driver still runs, then send a '
        'new goal'
    )
    if during:
        neighbours.send_goal()
        neighbours.until_goal_status('rejected: the driver is silent')
        assert neighbours.rejection_count() == 2
    neighbours.statuses.clear()
    neighbours.corrected.clear()
    neighbours.publish_driver('active', since=since)
    neighbours.ros.until(lambda: gate.status is SILENT, 'another silence')
    # one message was still in the middleware
    assert len(neighbours.corrected) <= 1
    assert not neighbours.statuses
    neighbours.publish_driver('active', since=since)
    neighbours.send_goal()
    neighbours.ros.until(lambda: neighbours.corrected, 'a corrected pose')


@pytest.mark.parametrize(
    ('events', 'states'),
    [
        (['inactivate', 'goal', 'hold', 'activate'], ['rejected']),
        (['activate', 'goal', 'hold'], ['accepted', 'ended']),
    ],
)
def test_hold_wins_over_a_goal_not_yet_followed(ros, monkeypatch, events, states):
    answers = GoalAnswers(ros, monkeypatch)
    for event in events:
        answers.time += 1e-3
        assert getattr(answers, event)() is not False
    assert [*answers.states.values()] == [states]
    assert answers.node._compensator.goal is None
    assert not answers.hold()  # no goal is left


def test_hold_ends_the_goal_with_a_single_report(following):
    reply = following.call(topics.HOLD)
    assert reply.success
    assert reply.message == f'the head stays at {millimetres(GOAL)}'
    following.until_goal_status('ended: compensator/hold was called')
    following.statuses.clear()
    following.publish_driver('active', since=0.0)
    following.components.clear()
    following.until_status('correction', '')
    assert not following.statuses
    # not a repetition
    following.publish(topics.GOAL_POSE, pose_stamped('facade', 0.0, GOAL))
    following.until_goal_status('accepted')


def test_force_and_lateral_offset_reach_the_contact(ros):
    neighbours = Neighbours(ros, {'contact.enabled': True, 'lateral.enabled': True})
    contact = neighbours.compensation.contact

    def press():
        neighbours.press(-5.0 + 0.01 * math.sin(1e3 * neighbours.now()))

    neighbours.repeat(press)
    offset = PointStamped(point=Point(x=0.02))
    neighbours.repeat(
        lambda: neighbours.publish(
            topics.LATERAL_OFFSET, neighbours.stamped(offset, 'end_effector')
        )
    )
    neighbours.send_goal()
    # of the force sensor, which is discovered first
    neighbours.until_goal_status('zero')
    ros.until(lambda: contact.pressing.zero == pytest.approx(5.0, rel=0.1), 'the zero')
    ros.until(lambda: contact.present.x > 1e-3, 'the shift along the wall')
    message = neighbours.call(topics.HOLD).message
    assert message == f'the head stays 50.0 mm in front of {millimetres(GOAL)}'
    assert {'pressing', 'force on the wall [N]', 'desired force [N]'} <= {
        *status_values(neighbours.statuses[-1])
    }
