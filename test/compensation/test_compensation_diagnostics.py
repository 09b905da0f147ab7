"""Components of the compensator for /diagnostics: levels, and values with units."""

import math
import re

from compensation.compensated_head import CompensatedHead
import pytest

from facade_manipulator.compensation.compensation_diagnostics import (
    contact_components,
    correction_component,
    correction_outcome,
)
from facade_manipulator.compensation.contact_phases import (
    ContactSettings,
    MEASURING_ZERO,
)
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.compensation.goal import uncorrected_reason
from facade_manipulator.compensation.pose_compensator import (
    Compensator,
    CompensatorSettings,
    CorrectedPose,
)
from facade_manipulator.errors import InputError, ManipulatorError
from facade_manipulator.kinematics import Geometry, Pose, ZERO_POSE
from facade_manipulator.kinematics.planar import millimetres

POSE = Pose(0.001, -0.02, math.radians(3.0))
UNMEASURED = 'x is not measured or too uncertain; next: check the sensor'
WORDS = 'x +1.0 mm, y -20.0 mm, theta +3.00 deg'


@pytest.fixture
def compensator():
    return Compensator(Geometry(), CompensatorSettings())


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
    text = mode.value
    step = ''
    if mode in (CorrectionMode.NO_ESTIMATE, CorrectionMode.SILENT):
        text = f'{text}: the estimator is silent'
        step = '; next: check the estimator'
    assert correction_outcome(compensator, 100.0, '') == (level, text + step)
    compensator.held_back.note(100.0, ZERO_POSE, Pose(0.0, 0.01, 0.0))
    found, message = correction_outcome(compensator, 100.0, '')
    assert found == held
    assert message.startswith(f'{text}; held back in y ')
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


def test_second_publisher_of_the_estimates_is_reported_once(compensator):
    fault = 'disturbance has 2 publishers (a, b), above the limit 1; next: end one'
    correction = compensator.correction
    correction.mode = CorrectionMode.SILENT
    correction.rejections.add(99.9, InputError('publishers', fault))
    level, message = correction_outcome(compensator, 100.0, fault)
    assert level == 'error'
    assert message == f'{correction.mode.value}: each estimate is rejected: {fault}'
    other = f'goal_pose has 2 publishers (c, d), above the limit 1; {fault}'
    _, message = correction_outcome(compensator, 100.0, other)
    assert message.count('disturbance has 2 publishers') == 1
    assert message.count('goal_pose has 2 publishers') == 1


def test_correction_values_have_the_unit_of_their_key(compensator):
    compensator.add_estimate(100.0, 99.95, ZERO_POSE, (1e-6, 4e-6, 1e-4))
    compensator.following.lag = 0.007
    saturation_error = POSE._replace(x=0.002)
    compensator.newest = CorrectedPose(
        0.0, 0.0, ZERO_POSE, ZERO_POSE, POSE, saturation_error
    )
    *_, values = correction_component(
        compensator, 100.0, '', (0.002, math.radians(1.5))
    )
    deviations = compensator.correction.deviations(100.067)
    deviation_words = (
        f'x {1e3 * deviations[0]:.2g} mm; y {1e3 * deviations[1]:.2g} mm; '
        f'theta {math.degrees(deviations[2]):.2g} deg'
    )
    assert values.pop('horizon [ms]') == pytest.approx(45.0)
    assert values.pop('age of the estimate [ms]') == pytest.approx(50.0)
    assert values.pop('lag of the head [ms]') == pytest.approx(7.0)
    assert values == {
        'initialisations': 0,
        'left out of the estimate': 'z +2.0 mm, tilt 1.50 deg',
        'corrected disturbance': WORDS,
        'saturation error': WORDS.replace('+1.0', '+2.0'),
        'standard deviation of the prediction': deviation_words,
    }


@pytest.mark.parametrize('goal', [None, Pose(0.0, 0.25, 0.0)])
def test_unmeasured_axis_is_a_warning_without_a_deviation(goal):
    head = CompensatedHead(goal=goal).run(1.0)
    head.variances = (1e9, 1e-6, 1e-6)
    head.run(1.0)
    component = correction_component(head.compensator, head.now, '', (0.0, 0.0))
    _, level, message, values = component
    assert level == 'warn'
    held = 'held back in x by an uncertain estimate; next: check the sensor'
    assert message == 'compensating; ' + (held if goal else UNMEASURED)
    deviations = values['standard deviation of the prediction'].split('; ')
    assert deviations[0] == 'x inf mm'
    assert not any('inf' in text for text in deviations[1:])


@pytest.mark.parametrize(('x', 'y'), [(0.1, 0.0), (0.0, -0.05)])
def test_disabled_contact_is_shown_while_it_shifts(compensator, x, y):
    contact = compensator.contact
    assert contact_components(compensator) == []
    contact.regulator.shift = x
    contact.pressing.normal.law.offset = y
    ((_, level, message, values),) = contact_components(compensator)
    assert (level, message) == ('ok', 'not pressing')
    assert values['shift of the goal'] == millimetres(Pose(x, y, 0.0))


def test_contact_values_have_the_unit_of_their_key(compensator):
    contact = compensator.contact
    pressing = contact.pressing
    pressing.monitor.force = 12.0
    pressing.moment = 0.3
    pressing.ramp.desired = 15.0
    pressing.sensor_zero.force = -0.5
    contact.regulator.shift = 0.001
    pressing.normal.law.offset = -0.02
    pressing.theta.offset = POSE.theta
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
    assert level == 'ok'
    assert values | expected == values
    for reason, expected_level in ((MEASURING_ZERO, 'ok'), ('a fault', 'error')):
        pressing.reason = reason
        assert contact_components(compensator)[0][1:3] == (
            expected_level,
            pressing.outcome,
        )
