"""Reports of the compensator: levels, values with units, and the progress of a goal."""

from itertools import groupby
import math
import re

from compensation.compensated_head import CompensatedHead
import pytest

from facade_manipulator.compensation.compensator import Compensator, CorrectedPose
from facade_manipulator.compensation.contact import (
    ContactSettings,
    MEASURING_ZERO,
    PressMode,
)
from facade_manipulator.compensation.correction import (
    CorrectionMode,
    CorrectionSettings,
)
from facade_manipulator.compensation.report import (
    contact_components,
    correction_component,
    correction_outcome,
    GOAL_PERIOD,
    GoalReport,
    uncorrected_reason,
)
from facade_manipulator.errors import InputError, ManipulatorError
from facade_manipulator.kinematics import Geometry, Pose, ZERO_POSE

POSE, WORDS = (
    Pose(0.001, -0.02, math.radians(3.0)),
    'x +1.0 mm, y -20.0 mm, theta +3.00 deg',
)
STEP = 0.02
GOAL, NEXT, FAR = Pose(0.05, 0.25, 0.0), Pose(-0.05, 0.25, 0.0), Pose(0.3, 0.25, 0.0)
LONG = 2.0  # s, in which a goal is reached


@pytest.fixture
def compensator():
    return Compensator(Geometry())


@pytest.mark.parametrize(
    'mode, level, held',
    [
        (CorrectionMode.ACTIVE, 'ok', 'warn'),
        (CorrectionMode.SETTLING, 'ok', 'warn'),
        (CorrectionMode.DISABLED, 'warn', 'warn'),
        (CorrectionMode.NO_ESTIMATE, 'warn', 'warn'),
        (CorrectionMode.SILENT, 'error', 'error'),
    ],
)
def test_level_follows_mode_and_held_back_axes(compensator, mode, level, held):
    compensator.correction.mode = mode
    text, step = mode.value, ''
    if mode in (CorrectionMode.NO_ESTIMATE, CorrectionMode.SILENT):
        text, step = f'{text}: the estimator is silent', '; next: check the estimator'
    assert correction_outcome(compensator, 100.0, '') == (level, text + step)
    compensator.held_back.note(100.0, ZERO_POSE, Pose(0.0, 0.01, 0.0))
    found, message = correction_outcome(compensator, 100.0, '')
    assert found == held and message.startswith(f'{text}; held back in y ')
    assert correction_outcome(compensator, 100.0, 'a fault') == (
        'error',
        f'{text}; a fault{step}',
    )


@pytest.mark.parametrize('mode', [CorrectionMode.NO_ESTIMATE, CorrectionMode.SILENT])
def test_rejected_estimates_are_reported_with_their_cause(compensator, mode):
    correction = compensator.correction
    correction.mode = mode
    correction.rejections.add(99.9, InputError('frame', "frame 'odom'; next: a"))
    cause = "each estimate is rejected: frame 'odom'; next: a"
    assert correction_outcome(compensator, 100.0, '')[1] == f'{mode.value}: {cause}'
    with pytest.raises(ManipulatorError, match=re.escape(cause)):
        correction.tare(100.0)
    compensator.add_estimate(100.0, 99.95, ZERO_POSE, (0.0, 0.0, 0.0))
    assert 'the estimator is silent' in uncorrected_reason(correction, 101.0)
    correction.rejections.add(101.0, InputError('frame', "frame 'odom'; next: a"))
    assert uncorrected_reason(correction, 101.0).endswith(cause)


def test_correction_values_have_the_unit_of_their_key(compensator):
    compensator.add_estimate(100.0, 99.95, ZERO_POSE, (1e-6, 4e-6, 1e-4))
    compensator.following.lag = 0.007
    compensator.newest = CorrectedPose(
        0.0, 0.0, *[ZERO_POSE] * 2, POSE, POSE._replace(x=0.002)
    )
    *_, values = correction_component(
        compensator, 100.0, '', (0.002, math.radians(1.5))
    )
    deviations = compensator.correction.deviations(100.067)
    assert values == {
        'horizon [ms]': pytest.approx(60.0),
        'age of the estimate [ms]': pytest.approx(50.0),
        'lag of the head [ms]': pytest.approx(7.0),
        'initialisations': 0,
        'left out of the estimate': 'z +2.0 mm, tilt 1.50 deg',
        'corrected disturbance': WORDS,
        'saturation error': WORDS.replace('+1.0', '+2.0'),
        'standard deviation of the prediction': (
            f'x {1e3 * deviations[0]:.2g} mm; y {1e3 * deviations[1]:.2g} mm; '
            f'theta {math.degrees(deviations[2]):.2g} deg'
        ),
    }


def test_contact_values_have_the_unit_of_their_key(compensator):
    contact = compensator.contact
    pressing = contact.pressing
    pressing.monitor.force, pressing.moment, pressing.desired = 12.0, 0.3, 15.0
    pressing.zero, contact._shift, pressing.y.offset = -0.5, 0.001, -0.02
    pressing.theta.offset = POSE.theta
    assert contact_components(compensator) == []  # nothing is enabled
    pressing.settings = ContactSettings(enabled=True)
    ((_, level, _, values),) = contact_components(compensator)
    expected = {
        'reason of the last retract': 'never',
        'shift of the goal': WORDS,
        'force on the wall [N]': 12.0,
        'desired force at present [N]': 15.0,
        'zero of the force [N]': -0.5,
        'moment on the wall [N m]': 0.3,
    }
    assert level == 'ok' and values | expected == values
    for reason, expected_level in ((MEASURING_ZERO, 'ok'), ('a fault', 'error')):
        pressing.reason = reason
        assert contact_components(compensator)[0][1:3] == (
            expected_level,
            pressing.outcome,
        )


class Machine:
    """A compensator whose head follows exactly, and the reports on its goals."""

    def __init__(self, motion: Pose = ZERO_POSE) -> None:
        self.sent: list[dict[str, str]] = []
        self.head = CompensatedHead(
            motion,
            head=GOAL._replace(x=0.0),
            lag=0.0,
            correction=CorrectionSettings(enabled=False),
        )
        self.warnings: list[str] = []
        self.report = GoalReport(
            lambda goal: self.sent.append(goal[3]),
            self.head.compensator,
            self.warnings.append,
        )

    def follow(self, goal: Pose, stamp: str) -> None:
        self.head.compensator.set_goal(goal)
        self.report.accept(stamp)

    def run(self, duration: float) -> list[dict[str, str]]:
        """Return the reports of a duration [s]."""
        before = len(self.sent)
        for _ in range(round(duration / STEP)):
            self.head.run(STEP)
            self.report.update(self.head.now)
        return self.sent[before:]


@pytest.fixture
def machine():
    return Machine()


def states(sent):
    return [state for state, _ in groupby(one['state'] for one in sent)]


def test_reached_goal_is_reported_in_each_of_its_states(machine):
    machine.follow(GOAL, '1.0')
    sent = machine.run(LONG)
    assert states(machine.sent) == ['accepted', 'moving', 'reached']
    assert {one['goal stamp'] for one in machine.sent} == {'1.0'}
    to_go = [one['time to go [s]'] for one in sent]
    assert (
        all(a > b for a, b in zip(to_go, to_go[1:], strict=False)) and to_go[-1] == 0.0
    )
    assert to_go[0] == pytest.approx(
        GOAL_PERIOD * (len(sent) - 1), abs=2.0 * GOAL_PERIOD
    )
    assert machine.run(1.0) == []


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
    machine.report.end('nothing was followed')
    assert machine.sent == []
    machine.follow(GOAL, '1.0')
    machine.run(duration)
    machine.sent.clear()
    machine.report.end('the drives are halted')
    machine.report.end('the driver is silent')
    (ended,) = machine.sent
    assert (ended['state'], ended['reason']) == ('ended', 'the drives are halted')
    assert machine.run(1.0) == []


def test_rejected_goal_is_reported_beside_the_followed_goal(machine):
    machine.follow(GOAL, '1.0')
    machine.report.reject('2.0', 'far')
    rejected, *later = [machine.sent[-1], *machine.run(1.0)]
    assert [
        rejected[key] for key in ('state', 'reason', 'goal stamp', 'followed x [mm]')
    ] == ['rejected', 'far', '2.0', 50.0]
    assert {(one['goal stamp'], one['rejection']) for one in later} == {('1.0', 'far')}
    machine.follow(NEXT, '3.0')
    assert 'rejection' not in machine.sent[-1]


def test_held_back_head_is_reported_with_the_axis(machine):
    machine.follow(FAR, '1.0')
    machine.run(0.1)
    machine.head.compensator.held_back.note(
        machine.head.now, *[Pose(0.0, 0.01, 0.0)] * 2
    )
    sent = machine.run(2.0)
    assert states(sent) == ['held back', 'moving'] and 'in y' in sent[0]['reason']
    assert sent[-1]['reason'] == ''
    now = machine.head.now - 50.0  # the clock is set back
    machine.report.update(now)
    before = len(machine.sent)
    machine.report.update(now + GOAL_PERIOD)
    assert len(machine.sent) == before + 1


def test_wall_beyond_the_range_is_reported_as_held_back(machine):
    machine.follow(GOAL, '1.0')
    machine.run(LONG)
    pressing = machine.head.compensator.contact.pressing
    pressing.settings = ContactSettings(enabled=True, range=0.01)
    stamp = machine.head.now

    def measure():
        nonlocal stamp
        stamp += STEP
        pressing.add_measurement(stamp, math.sin(1e3 * stamp), 0.0, is_repeated=False)

    for _ in range(round(25.0 / STEP)):
        measure()
        machine.run(STEP)
    assert pressing.mode is PressMode.SEARCHING
    last = machine.sent[-1]
    assert last['state'] == 'held back'
    assert 'no wall within 10 mm' in last['reason'] and 'next: ' in last['reason']
    assert contact_components(machine.head.compensator)[0][1] == 'warn'


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
    correction.enabled, machine.head.variances = (
        is_enabled,
        None if is_enabled else (0.0,) * 3,
    )
    sent = machine.run(2.0)
    assert states(sent) == ['held back'] and {one['reason'] for one in sent} == {reason}
    (warning,) = machine.warnings
    assert warning == f'goal held back: {sent[0]["reason"]}'
    # the place of the head on the wall is unknown without estimates
    assert {math.isnan(one['distance [mm]']) for one in sent[1:]} == {is_enabled}
    correction.enabled, machine.head.variances = True, (0.0,) * 3
    assert states(machine.run(6.0))[-1] == 'reached'
