"""Rejections are counted and logged; components are published on change."""

import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.nodes import diagnostics
from facade_manipulator.nodes.diagnostics import (
    diagnostic_status,
    DiagnosticsPublisher,
    Rejections,
)

pytestmark = pytest.mark.quick
STALE = InputError('stale', 'setpoint is 0.300 s old, bound 0.2 s')


def test_rejection_in_a_block_is_counted_by_reason(ros):
    rejections = Rejections(ros.node())
    for _ in range(2):
        with rejections.counted():
            raise STALE
    assert rejections.values() == {
        'rejected': '2', 'rejected: stale': '2',
        'last rejection': 'setpoint is 0.300 s old, bound 0.2 s'}
    with pytest.raises(ZeroDivisionError), rejections.counted():
        raise ZeroDivisionError
    assert rejections.total == 2


def test_each_reason_is_logged_once_in_its_period(ros, monkeypatch, capfd):
    now = [100.0]
    monkeypatch.setattr(diagnostics.time, 'monotonic', lambda: now[0])
    rejections = Rejections(ros.node())
    for step in range(20):
        now[0] = 100.0 + step * diagnostics.LOG_PERIOD / 10.0
        rejections.add(STALE)
        rejections.add(InputError('frame', "goal_pose is in frame 'map', expected 'facade'"))
    log = capfd.readouterr().err
    assert log.count('bound 0.2 s') == log.count("expected 'facade'") == 2


def test_change_of_the_outcome_is_published_once(ros):
    published = []
    node, component = ros.node(), diagnostic_status('goal', 'ok', '', {})
    publisher = DiagnosticsPublisher(
        node, Rejections(node), lambda: published.append(outcome) or [component])
    for outcome in ('active', 'active', 'stopped', 'stopped', 'active'):
        publisher.publish_change(outcome)
    assert published == ['active', 'stopped', 'active']


def test_status_has_its_values_as_text():
    status = diagnostic_status('bus', 'warn', 'late', {'load': 0.123456789, 'cycles': 3})
    assert status.level == b'\x01'
    assert [(item.key, item.value) for item in status.values] == [
        ('load', '0.123457'), ('cycles', '3')]
