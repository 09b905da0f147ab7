"""Goal of the head: repetitions, arrival, and the report of each state."""

from itertools import groupby
import math
from types import SimpleNamespace

from compensation.compensated_head import CompensatedHead
import pytest

from facade_manipulator.compensation.compensation_diagnostics import contact_components
from facade_manipulator.compensation.contact_phases import ContactSettings, PressMode
from facade_manipulator.compensation.correction import CorrectionSettings
from facade_manipulator.compensation.goal import ArrivalSettings, Goal, GoalTracker
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Pose, ZERO_POSE

STEP = 0.02
GOAL = Pose(0.05, 0.25, 0.0)
NEXT = Pose(-0.05, 0.25, 0.0)
FAR = Pose(0.3, 0.25, 0.0)
LONG = 2.0  # s, in which a goal is reached
PERIOD = 0.01
SETTINGS = ArrivalSettings(distance=0.005, angle=0.01, dwell=0.2)
NEAR = Pose(0.003, 0.003, 0.005)  # errors
AWAY = Pose(0.006, 0.0, 0.0)


class Arrival:
    """Followed goal of a compensator that consists of the facts about arrival."""

    def __init__(self):
        self.now = 0.0
        self.error = None
        self.duration = 0.0
        self.pressing = SimpleNamespace(
            settings=ContactSettings(),
            is_hindered=False,
            is_force_reached=True,
            outcome='',
        )
        compensator = SimpleNamespace(
            goal=None,
            set_goal=lambda pose: None,
            goal_error=lambda now: self.error,
            path_time=lambda now: self.duration,
        )
        compensator.contact = SimpleNamespace(pressing=self.pressing)
        compensator.held_back = SimpleNamespace(message=lambda now: '')
        self.goals = GoalTracker(compensator, lambda component: None, print)
        self.goals.settings = SETTINGS
        goal = Goal(GOAL, '1.0', 0.0)
        self.goals.receive(goal)
        self.goals.follow(goal)

    def hold(self, is_hindered=False, is_pressed=True):
        self.pressing.is_hindered = is_hindered
        self.pressing.is_force_reached = is_pressed

    def run(self, duration):
        for _ in range(round(duration / PERIOD)):
            self.now += PERIOD
            self.goals.update(self.now)


# seconds, error, time to the path's end; whether the head is held back and pressed
@pytest.mark.parametrize(
    ('steps', 'expected'),
    [
        ([(0.15, NEAR, 0.0), (0.1, NEAR, 0.0)], ['moving', 'reached']),
        ([(0.15, NEAR, 0.0), (0.02, AWAY, 0.0), (0.15, NEAR, 0.0)], ['moving'] * 3),
        ([(1.0, NEAR, 0.5)], ['moving']),
        ([(1.0, None, 0.0)], ['moving']),
        ([(1.0, NEAR, 0.0, False, False), (1.0, NEAR, 0.0)], ['moving', 'reached']),
        (
            [(1.0, NEAR, 0.0, True, False), (1.0, NEAR, 0.0, True)],
            ['held back', 'reached'],
        ),
        ([(1.0, Pose(0.0, 0.0, 0.02), 0.0)], ['moving']),
        (
            [
                (0.3, NEAR, 0.0),
                (0.3, Pose(0.009, 0.0, 0.0), 0.0),
                (0.1, Pose(0.011, 0.0, 0.0), 0.0),
            ],
            ['reached', 'reached', 'moving'],
        ),
    ],
)
def test_goal_near_for_the_dwell_time_is_reached(steps, expected):
    progress = Arrival()
    found = []
    for duration, error, path_time, *limits in steps:
        progress.error = error
        progress.duration = path_time
        progress.hold(*limits)
        progress.run(duration)
        found.append(progress.goals.state.value)
    assert found == expected


class Machine:
    """Compensator whose head follows exactly, and the reports on its goals."""

    def __init__(self, motion: Pose = ZERO_POSE, lag: float | None = 0.0) -> None:
        self.sent: list[dict[str, str]] = []
        uncorrected = CorrectionSettings(enabled=False)
        self.head = CompensatedHead(
            motion, head=GOAL._replace(x=0.0), lag=lag, correction=uncorrected
        )
        self.warnings: list[str] = []

        def send(component):
            self.sent.append(component[3])

        compensator = self.head.compensator
        self.goals = GoalTracker(compensator, send, self.warnings.append)
        self.sent.clear()  # the report before the first goal

    def follow(self, pose: Pose, stamp: str) -> None:
        goal = Goal(pose, stamp, self.head.now)
        self.goals.receive(goal)
        self.goals.follow(goal)

    def run(self, duration: float) -> list[dict[str, str]]:
        """Return the reports of a duration [s]."""
        before = len(self.sent)
        for _ in range(round(duration / STEP)):
            self.head.run(STEP)
            self.goals.update(self.head.now)
        return self.sent[before:]


@pytest.fixture
def machine():
    return Machine()


def states(sent):
    """Return the states in their order, each repetition once."""
    names = [one['state'] for one in sent]
    return [state for state, _ in groupby(names)]


def test_reached_goal_is_reported_in_each_of_its_states(machine):
    machine.follow(GOAL, '1.0')
    sent = machine.run(LONG)
    assert states(machine.sent) == ['accepted', 'moving', 'reached']
    assert {one['goal stamp'] for one in machine.sent} == {'1.0'}
    to_go = [one['time to go [s]'] for one in sent]
    assert to_go == sorted(set(to_go), reverse=True)
    assert to_go[-1] == 0.0
    period = GoalTracker.GOAL_PERIOD
    duration = period * (len(sent) - 1)
    assert to_go[0] == pytest.approx(duration, abs=2.0 * period)
    assert machine.run(1.0) == []


def test_waiting_goal_has_no_report_before_its_answer(machine):
    machine.goals.receive(Goal(GOAL, '1.0', 0.0))
    assert machine.run(1.0) == []
    machine.goals.receive(Goal(NEXT, '2.0', 0.0))
    machine.goals.refuse('the drives are inactive')
    found = [(one['goal stamp'], one['state']) for one in machine.sent]
    assert found == [('1.0', 'superseded'), ('2.0', 'rejected')]


def test_repetition_of_a_goal_in_force_changes_nothing(machine):
    goal = Goal(GOAL, '1.0', 0.0)
    machine.goals.receive(goal)
    later = goal._replace(received=1.0)
    unstamped = goal._replace(stamp='1.5')
    for _ in range(2):
        assert machine.goals.answer_repetition(later, has_stamp=True)
        assert machine.goals.answer_repetition(unstamped, has_stamp=False)
        machine.goals.reject('1.0', 'goal_pose has 2 publishers')
        assert machine.sent == []
        machine.goals.follow(goal)
        machine.sent.clear()


@pytest.mark.parametrize(
    'goal, has_stamp',
    [
        (Goal(NEXT, '1.0', 0.0), True),
        (Goal(GOAL, '2.0', 0.0), True),
        (Goal(NEXT, '2.0', 0.0), False),
    ],
)
def test_goal_with_another_pose_or_stamp_is_new(machine, goal, has_stamp):
    machine.follow(GOAL, '1.0')
    assert not machine.goals.answer_repetition(goal, has_stamp)


@pytest.mark.parametrize('answer', ['rejected', 'refused', 'ended'])
def test_repetition_of_an_answered_goal_publishes_the_answer(machine, answer):
    goal = Goal(GOAL, '1.0', 0.0)
    if answer == 'rejected':
        machine.goals.reject('1.0', 'far')
    else:
        machine.goals.receive(goal)
    if answer == 'refused':
        machine.goals.refuse('inactive')
    elif answer == 'ended':
        machine.goals.follow(goal)
        machine.goals.end('halted')
    published = repr(machine.sent[-1])  # nan differs from nan
    machine.sent.clear()
    assert machine.goals.answer_repetition(goal, has_stamp=True)
    assert [repr(one) for one in machine.sent] == [published]
    assert not machine.goals.answer_repetition(
        goal._replace(stamp='9.0'), has_stamp=False
    )


@pytest.mark.parametrize('duration, before', [(0.2, ['superseded']), (LONG, [])])
def test_newer_goal_supersedes_an_unreached_goal(machine, duration, before):
    machine.follow(GOAL, '1.0')
    machine.run(duration)
    machine.sent.clear()
    for _ in range(2):  # it is sent again
        machine.follow(NEXT, '2.0')
        assert states(machine.sent) == [*before, 'accepted']
    assert states(machine.run(LONG)) == ['moving', 'reached']


@pytest.mark.parametrize('duration', [0.0, 0.2, LONG])
def test_end_of_a_goal_is_reported_once(machine, duration):
    machine.goals.end('nothing was followed')
    assert machine.sent == []
    machine.follow(GOAL, '1.0')
    machine.run(duration)
    machine.sent.clear()
    machine.goals.end('the drives are halted')
    machine.goals.end('the driver is silent')
    (ended,) = machine.sent
    assert ended['state'] == 'ended'
    assert ended['reason'] == 'the drives are halted'
    assert machine.run(1.0) == []


def test_rejected_goal_is_reported_beside_the_followed_goal(machine):
    machine.follow(GOAL, '1.0')
    machine.goals.reject('2.0', 'far')
    rejected = machine.sent[-1]
    assert rejected['state'] == 'rejected'
    assert rejected['reason'] == 'far'
    assert rejected['goal stamp'] == '2.0'
    assert rejected['followed x [mm]'] == 50.0
    later = machine.run(1.0)
    assert later
    for one in later:
        assert one['goal stamp'] == '1.0'
        assert one['rejection'] == 'far'
    machine.follow(NEXT, '3.0')
    assert 'rejection' not in machine.sent[-1]


@pytest.mark.parametrize('duration, state', [(0.2, 'moving'), (LONG, 'reached')])
def test_last_report_after_rejection_is_of_the_followed_goal(machine, duration, state):
    machine.follow(GOAL, '1.0')
    machine.run(duration)
    machine.goals.reject('2.0', 'far')
    first, *_ = machine.run(0.1)
    keys = ('goal stamp', 'state', 'rejected goal stamp', 'rejection')
    assert [first[key] for key in keys] == ['1.0', state, '2.0', 'far']
    if state == 'reached':
        assert machine.run(1.0) == []


def test_held_back_head_is_reported_with_the_axis(machine):
    machine.follow(FAR, '1.0')
    machine.run(0.1)
    error = Pose(0.0, 0.01, 0.0)
    machine.head.compensator.held_back.note(machine.head.now, error, error)
    sent = machine.run(2.0)
    assert states(sent) == ['held back', 'moving']
    assert 'in y' in sent[0]['reason']
    assert sent[-1]['reason'] == ''
    now = machine.head.now - 50.0  # the clock is set back
    machine.goals.update(now)
    before = len(machine.sent)
    machine.goals.update(now + GoalTracker.GOAL_PERIOD)
    assert len(machine.sent) == before + 1


def test_wall_beyond_the_range_is_reported_as_held_back(machine):
    machine.follow(GOAL, '1.0')
    machine.run(LONG)
    pressing = machine.head.compensator.contact.pressing
    pressing.settings = ContactSettings(enabled=True, range=0.01)
    machine.follow(GOAL, '2.0')
    stamp = machine.head.now

    def measure():
        nonlocal stamp
        stamp += STEP
        pressing.add_measurement(stamp, math.sin(1e3 * stamp), 0.0, is_repeated=False)

    for _ in range(round(25.0 / STEP)):
        measure()
        machine.run(STEP)
    assert pressing.mode is PressMode.RETRACTED
    last = machine.sent[-1]
    assert last['state'] == 'held back'
    assert 'no wall within 10 mm' in last['reason']
    assert 'next: ' in last['reason']
    assert contact_components(machine.head.compensator)[0][1] == 'error'


def test_goal_is_not_reached_while_a_lateral_shift_ends(machine):
    """The regulator was disabled with a shift of 0.1 m; the path of 0.02 m takes 0.6 s."""
    machine.follow(GOAL, '1.0')
    machine.run(LONG)
    machine.head.compensator.contact.regulator.shift = 0.1
    machine.follow(GOAL._replace(x=GOAL.x + 0.02), '2.0')
    sent = machine.run(1.9)
    assert states(sent) == ['moving']
    assert float(sent[0]['time to go [s]']) > 1.5
    assert states(machine.run(1.0)) == ['moving', 'reached']


def test_goal_of_an_unmeasured_head_is_held_back(machine):
    """With two publishers of joint_states the ik_service publishes no pose of the head."""
    machine.follow(GOAL, '1.0')
    machine.run(0.2)
    machine.head.compensator.following.add_head = lambda *_: None
    sent = machine.run(6.0)
    assert states(sent) == ['moving', 'held back']
    assert sent[-1]['reason'] == (
        'end_effector_pose is silent for more than 0.5 s; next: check the ik_service and '
        'the publishers of joint_states'
    )


def test_rejected_head_is_reported_with_its_cause(machine):
    machine.follow(GOAL, '1.0')
    machine.run(0.2)
    following = machine.head.compensator.following
    fault = 'end_effector_pose has 2 publishers; next: end one'

    def reject(*_: object) -> None:
        error = InputError('publishers', fault)
        following.rejections.add(machine.head.now, error)

    following.add_head = reject
    sent = machine.run(6.0)
    assert sent[-1]['state'] == 'held back'
    assert sent[-1]['reason'] == f'each end_effector_pose is rejected: {fault}'


def test_goal_of_a_head_at_rest_is_held_back():
    """With two publishers of joint_setpoints the driver rejects all setpoints."""
    machine = Machine(lag=None)
    machine.follow(GOAL, '1.0')
    sent = machine.run(6.0)
    assert states(sent) == ['moving', 'held back']
    assert sent[-1]['reason'] == (
        'the head does not follow its path; next: check /diagnostics'
    )


def test_head_away_from_its_path_end_is_held_back():
    """The head follows within 20 mm, but ends outside the tolerance of 5 mm."""
    machine = Machine(lag=None)
    machine.head.compensator.correction.enabled = True
    machine.head.head = machine.head.head._replace(x=GOAL.x + 0.01)
    machine.follow(GOAL, '1.0')
    sent = machine.run(6.0)
    assert states(sent) == ['moving', 'held back']
    assert sent[-1]['reason'] == (
        'the head is not at its goal 1 s after the end of its path; '
        'next: check /diagnostics'
    )
    assert machine.warnings == []


@pytest.mark.parametrize(
    'motion, is_enabled, reason',
    [
        (
            ZERO_POSE,
            True,
            'no valid estimate for more than 0.5 s, and the correction fades out after '
            '1.05 s: the estimator is silent; next: check the estimator',
        ),
        (
            Pose(0.02, 0.0, 0.0),
            False,
            'the correction is disabled; next: call compensator/enable with true',
        ),
    ],
)
def test_uncorrected_goal_is_held_back_with_the_cause(motion, is_enabled, reason):
    machine = Machine(motion)
    correction = machine.head.compensator.correction
    correction.enabled = True
    machine.follow(GOAL, '1.0')
    assert states(machine.run(6.0))[-1] == 'reached'
    correction.enabled = is_enabled
    machine.head.variances = None if is_enabled else (0.0,) * 3
    sent = machine.run(2.0)
    assert states(sent) == ['held back']
    assert {one['reason'] for one in sent} == {reason}
    (warning,) = machine.warnings
    assert warning == f'goal held back: {sent[0]["reason"]}'
    # the place of the head on the wall is unknown without estimates
    assert {math.isnan(one['distance [mm]']) for one in sent[1:]} == {is_enabled}
    correction.enabled = True
    machine.head.variances = (0.0,) * 3
    assert states(machine.run(6.0))[-1] == 'reached'
