"""Rejections are counted and logged; components are published on change."""

from nodes.node_rig import diagnostics_of
import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.nodes import diagnostics
from facade_manipulator.nodes.diagnostics import diagnostic_status, Diagnostics

STALE = InputError('stale', 'setpoint is 0.300 s old, above the limit 0.2 s')


def two_log_periods(monkeypatch):
    """Yield twenty numbers, while the clock advances by two periods of the log."""
    for step in range(20):
        now = 100.0 + step * diagnostics.LOG_PERIOD / 10.0
        monkeypatch.setattr(diagnostics.time, 'monotonic', lambda now=now: now)
        yield step


def test_rejections_are_counted_and_logged_by_reason(ros, monkeypatch, capfd):
    counters = diagnostics_of(ros.node())
    for _ in two_log_periods(monkeypatch):
        counters.reject(
            InputError('frame', "in frame 'map', expected 'facade'"), 'goal_pose'
        )
        with counters.counted():
            raise STALE
    log = capfd.readouterr().err
    assert log.count('limit 0.2 s') == log.count("goal_pose: in frame 'map'") == 2
    with pytest.raises(ZeroDivisionError), counters.counted():
        raise ZeroDivisionError
    assert counters.rejections() == {
        'rejected': 40,
        'rejected: frame': 20,
        'rejected: stale': 20,
        'last rejection': str(STALE),
    }


def test_repeated_warning_is_logged_once_per_period(ros, monkeypatch, capfd):
    counters = diagnostics_of(ros.node())
    for step in two_log_periods(monkeypatch):
        counters.warn('goal', f'goal held back {step}')
    log = capfd.readouterr().err
    assert log.count('goal held back') == 2
    assert counters.rejections()['rejected'] == 0


def test_changed_outcome_is_published_once(ros):
    published = []
    component = diagnostic_status('goal', 'ok', '', {})
    made = Diagnostics(ros.node(), lambda: published.append(outcome) or [component])
    for outcome in ('active', 'active', 'stopped', 'stopped', 'active'):
        made.publish_change(outcome)
    assert published == ['active', 'stopped', 'active']
