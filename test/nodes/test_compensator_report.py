"""What the compensator tells, and whether there is news."""

import pytest

from facade_manipulator.compensation import Compensator, HeldBack
from facade_manipulator.kinematics import Geometry
from facade_manipulator.nodes.compensator_report import CompensatorReport


@pytest.fixture
def report():
    """Return a report that has told all there is, at 100 s."""
    report = CompensatorReport(Compensator(Geometry()), HeldBack())
    assert report.changed(100.0)
    report.components(100.0, {})
    return report


def test_while_nothing_changes_there_is_no_news(report):
    assert not report.changed(100.02)


def test_a_change_is_news(report):
    report._compensator.correction.mode = type(report._compensator.correction.mode).SILENT
    assert report.changed(100.02)
