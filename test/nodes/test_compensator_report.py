"""What the compensator tells, and when it looks whether there is news."""

import pytest

from facade_manipulator.compensation.compensator import Compensator
from facade_manipulator.kinematics import Geometry
from facade_manipulator.nodes.compensator_report import CompensatorReport, LOOK_PERIOD


@pytest.fixture
def report():
    """Return a report that has told all there is, at 100 s."""
    report = CompensatorReport(Compensator(Geometry()))
    assert report.changed(100.0)
    report.components(100.0, {})
    return report


def test_while_nothing_changes_there_is_no_news(report):
    assert not any(report.changed(100.0 + 0.002 * k) for k in range(100))


@pytest.mark.parametrize('later', [LOOK_PERIOD, 1.0, -50.0])  # the clock may be set back
def test_a_change_is_news_within_the_period(report, later):
    report._compensator.correction.mode = type(report._compensator.correction.mode).SILENT
    assert report.changed(100.0 + later)
