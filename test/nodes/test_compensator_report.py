"""Diagnostics of the compensator: level and message of its mode, values with their units."""

import math

import pytest

from facade_manipulator.compensation.compensator import Compensator, CorrectedPose
from facade_manipulator.compensation.contact import ContactSettings
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.compensation.following import HeldBack
from facade_manipulator.kinematics import Geometry, Pose, ZERO_POSE
from facade_manipulator.messages import OutOfPlane, status_level, status_values
from facade_manipulator.nodes.compensator_report import CompensatorReport

POSE, WORDS = Pose(0.001, -0.02, math.radians(3.0)), 'x +1.0 mm, y -20.0 mm, theta +3.00 deg'


@pytest.fixture
def report():
    return CompensatorReport(Compensator(Geometry()), HeldBack())


@pytest.mark.parametrize('mode, level, held', [
    (CorrectionMode.ACTIVE, 'ok', 'warn'), (CorrectionMode.SETTLING, 'ok', 'warn'),
    (CorrectionMode.DISABLED, 'warn', 'warn'), (CorrectionMode.NO_ESTIMATE, 'warn', 'warn'),
    (CorrectionMode.SILENT, 'error', 'error')])
def test_level_follows_mode_and_held_back_axes(report, mode, level, held):
    report._compensator.correction.mode = mode
    assert report.outcome(100.0) == report.outcome(100.02) == (level, mode.value)
    report._held_back.note(100.0, ZERO_POSE, Pose(0.0, 0.01, 0.0))
    status, = report.components(100.0)
    assert status_level(status) == held
    assert status.message.startswith(f'{mode.value}; held back in y ')
    assert report.outcome(100.0, 'a fault') == ('error', f'{mode.value}; a fault')


def test_correction_values_have_the_unit_of_their_key(report):
    compensator = report._compensator
    compensator.add_estimate(100.0, 99.95, ZERO_POSE, (1e-6, 4e-6, 1e-4))
    compensator.following.lag, report.out_of_plane = 0.007, OutOfPlane(0.002, math.radians(1.5))
    report.add(CorrectedPose(0.0, *[ZERO_POSE] * 2, POSE, POSE._replace(x=0.002)))
    values = status_values(report.components(100.0)[0])
    deviations = compensator.correction.deviations(100.067)
    expected = {
        'horizon [ms]': '60', 'corrected poses': '1', 'age of the estimate [ms]': '50',
        'lag of the head [ms]': '7',
        'left out of the estimate': 'z +2.0 mm, tilt 1.50 deg', 'corrected disturbance': WORDS,
        'saturation error': WORDS.replace('+1.0', '+2.0'),
        'standard deviation of the prediction': (
            f'x {1e3 * deviations[0]:.2g} mm; y {1e3 * deviations[1]:.2g} mm; '
            f'theta {math.degrees(deviations[2]):.2g} deg')}
    assert {key: values[key] for key in expected} == expected


def test_contact_values_have_the_unit_of_their_key(report):
    contact = report._compensator.contact
    pressing = contact.pressing
    pressing.monitor.force, pressing.moment, pressing.desired = 12.0, 0.3, 15.0
    pressing.zero, contact._shift, pressing.y.offset = -0.5, 0.001, -0.02
    pressing.theta.offset = POSE.theta
    assert len(report.components(100.0)) == 1  # nothing is enabled
    pressing.settings = ContactSettings(enabled=True)
    _, status = report.components(100.0)
    expected = {
        'retracted last because': 'never', 'shift of the goal': WORDS,
        'force on the wall [N]': '12', 'force of the moment desired [N]': '15',
        'zero of the force [N]': '-0.5', 'moment on the wall [N m]': '0.3'}
    values = status_values(status)
    assert status_level(status) == 'ok'
    assert {key: values[key] for key in expected} == expected
    pressing.reason = 'no wall'
    _, status = report.components(100.0)
    assert (status_level(status), status.message) == ('error', pressing.outcome)
