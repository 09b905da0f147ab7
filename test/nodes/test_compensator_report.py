"""What the compensator tells."""

import math

from diagnostic_msgs.msg import DiagnosticStatus
import pytest

from facade_manipulator.compensation.compensator import Compensator, CorrectedPose
from facade_manipulator.compensation.contact import ContactSettings
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.compensation.following import HeldBack
from facade_manipulator.kinematics import Geometry, Pose, ZERO_POSE
from facade_manipulator.messages import OutOfPlane, status_values
from facade_manipulator.nodes.compensator_report import CompensatorReport

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
POSE, WORDS = Pose(0.001, -0.02, math.radians(3.0)), 'x +1.0 mm, y -20.0 mm, theta +3.00 deg'


@pytest.fixture
def report():
    return CompensatorReport(Compensator(Geometry()), HeldBack())


def test_outcome_changes_only_with_the_mode(report):
    before = report.outcome(100.0)
    assert report.outcome(100.02) == before
    report._compensator.correction.mode = CorrectionMode.SILENT
    assert report.outcome(100.02) != before


@pytest.mark.parametrize('mode, level, held', [
    (CorrectionMode.ACTIVE, OK, WARN), (CorrectionMode.SETTLING, OK, WARN),
    (CorrectionMode.DISABLED, WARN, WARN), (CorrectionMode.NO_ESTIMATE, WARN, WARN),
    (CorrectionMode.SILENT, ERROR, ERROR)])
def test_level_follows_mode_and_held_back_axes(
        report, mode, level, held):
    report._compensator.correction.mode = mode
    status, = report.components(100.0, {})
    assert (status.level, status.message) == (level, mode.value)
    report._held_back.note(100.0, ZERO_POSE, Pose(0.0, 0.01, 0.0))
    status, = report.components(100.0, {})
    assert status.level == held and status.message.startswith(f'{mode.value}; held back in y ')


def test_correction_values_have_the_unit_of_their_key(report):
    compensator = report._compensator
    assert not {'corrected disturbance', 'left out of the estimate',
                'standard deviation of the prediction'} & status_values(
                    report.components(100.0, {})[0]).keys()
    compensator.add_estimate(100.0, 99.95, ZERO_POSE, (1e-6, 4e-6, 1e-4))
    compensator.following.lag, report.out_of_plane = 0.007, OutOfPlane(0.002, math.radians(1.5))
    report.pose_count = 7
    report.newest = CorrectedPose(0.0, *[ZERO_POSE] * 2, POSE, POSE._replace(x=0.002))
    values = status_values(report.components(100.0, {'rejected': 3})[0])
    assert [float(values[key]) for key in (
        'horizon [ms]', 'corrected poses', 'age of the estimate [ms]', 'lag of the head [ms]',
        'rejected')] == pytest.approx([60.0, 7, 50.0, 7.0, 3])
    assert values['left out of the estimate'] == 'z +2.0 mm, tilt 1.50 deg'
    assert values['corrected disturbance'] == WORDS
    assert values['saturation error'] == WORDS.replace('+1.0', '+2.0')
    deviations = compensator.correction.deviations(100.067)
    x, _, theta = values['standard deviation of the prediction'].split('; ')
    assert x == f'x {1e3 * deviations[0]:.2g} mm'
    assert theta == f'theta {math.degrees(deviations[2]):.2g} deg'


def test_contact_values_have_the_unit_of_their_key(report):
    contact = report._compensator.contact
    pressing = contact.pressing
    pressing.monitor.force, pressing.moment, pressing.desired = 12.0, 0.3, 15.0
    pressing.zero, contact._shift, pressing.y.offset = -0.5, 0.001, -0.02
    pressing.theta.offset = POSE.theta
    assert len(report.components(100.0, {})) == 1  # nothing is enabled
    pressing.settings = ContactSettings(enabled=True)
    _, status = report.components(100.0, {})
    values = status_values(status)
    assert (status.level, values['retracted last because']) == (OK, 'never')
    assert values['shift of the goal'] == WORDS
    assert [float(values[f'{key}]']) for key in (
        'force on the wall [N', 'force of the moment desired [N', 'zero of the force [N',
        'moment on the wall [N m')] == pytest.approx([12.0, 15.0, -0.5, 0.3])
    pressing.reason = 'no wall'
    _, status = report.components(100.0, {})
    assert (status.level, status.message) == (ERROR, pressing.outcome)

