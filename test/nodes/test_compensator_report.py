"""Diagnostics of the compensator: level and message of its mode, values with their units."""

import math

import pytest

from facade_manipulator.compensation.compensator import Compensator, CorrectedPose
from facade_manipulator.compensation.contact import ContactSettings
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.kinematics import Geometry, Pose, ZERO_POSE
from facade_manipulator.nodes.compensator_report import (
    contact_statuses,
    correction_outcome,
    correction_status,
)
from facade_manipulator.nodes.messages import OutOfPlane, status_level, status_values

POSE, WORDS = Pose(0.001, -0.02, math.radians(3.0)), 'x +1.0 mm, y -20.0 mm, theta +3.00 deg'


@pytest.fixture
def compensator():
    return Compensator(Geometry())


@pytest.mark.parametrize('mode, level, held', [
    (CorrectionMode.ACTIVE, 'ok', 'warn'), (CorrectionMode.SETTLING, 'ok', 'warn'),
    (CorrectionMode.DISABLED, 'warn', 'warn'), (CorrectionMode.NO_ESTIMATE, 'warn', 'warn'),
    (CorrectionMode.SILENT, 'error', 'error')])
def test_level_follows_mode_and_held_back_axes(compensator, mode, level, held):
    compensator.correction.mode = mode
    assert correction_outcome(compensator, 100.0, '') == (level, mode.value)
    compensator.held_back.note(100.0, ZERO_POSE, Pose(0.0, 0.01, 0.0))
    status = correction_status(compensator, 100.0, '', OutOfPlane(0.0, 0.0))
    assert status_level(status) == held
    assert status.message.startswith(f'{mode.value}; held back in y ')
    assert correction_outcome(compensator, 100.0, 'a fault') == ('error', f'{mode.value}; a fault')


def test_correction_values_have_the_unit_of_their_key(compensator):
    compensator.add_estimate(100.0, 99.95, ZERO_POSE, (1e-6, 4e-6, 1e-4))
    compensator.following.lag = 0.007
    compensator.newest = CorrectedPose(0.0, *[ZERO_POSE] * 2, POSE, POSE._replace(x=0.002))
    values = status_values(correction_status(
        compensator, 100.0, '', OutOfPlane(0.002, math.radians(1.5))))
    deviations = compensator.correction.deviations(100.067)
    assert values == {
        'horizon [ms]': '60', 'age of the estimate [ms]': '50', 'lag of the head [ms]': '7',
        'initialisations': '0', 'left out of the estimate': 'z +2.0 mm, tilt 1.50 deg',
        'corrected disturbance': WORDS, 'saturation error': WORDS.replace('+1.0', '+2.0'),
        'standard deviation of the prediction': (
            f'x {1e3 * deviations[0]:.2g} mm; y {1e3 * deviations[1]:.2g} mm; '
            f'theta {math.degrees(deviations[2]):.2g} deg')}


def test_contact_values_have_the_unit_of_their_key(compensator):
    contact = compensator.contact
    pressing = contact.pressing
    pressing.monitor.force, pressing.moment, pressing.desired = 12.0, 0.3, 15.0
    pressing.zero, contact._shift, pressing.y.offset = -0.5, 0.001, -0.02
    pressing.theta.offset = POSE.theta
    assert contact_statuses(compensator) == []  # nothing is enabled
    pressing.settings = ContactSettings(enabled=True)
    status, = contact_statuses(compensator)
    expected = {
        'retracted last because': 'never', 'shift of the goal': WORDS,
        'force on the wall [N]': '12', 'force of the moment desired [N]': '15',
        'zero of the force [N]': '-0.5', 'moment on the wall [N m]': '0.3'}
    values = status_values(status)
    assert status_level(status) == 'ok'
    assert {key: values[key] for key in expected} == expected
    pressing.reason = 'no wall'
    status, = contact_statuses(compensator)
    assert (status_level(status), status.message) == ('error', pressing.outcome)
