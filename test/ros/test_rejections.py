"""Rejected messages: counted, logged, and the callback ends there; news: told at once."""

import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.ros import diagnostics
from facade_manipulator.ros.diagnostics import DiagnosticsPublisher, Rejections, RepeatedLog
from facade_manipulator.ros.lifecycle import ManagedNode

pytestmark = pytest.mark.quick


def test_what_is_rejected_in_a_block_is_counted_and_goes_no_further(ros):
    rejections, reached = Rejections(ros.node('node')), []
    for _ in range(2):
        with rejections:
            raise InputError('stale', 'setpoint is 0.300 s old, bound 0.2 s')
        reached.append(True)
    with rejections:
        reached.append(True)
    assert len(reached) == 3
    assert rejections.values() == {
        'rejected': 2, 'rejected: stale': 2,
        'last rejection': 'setpoint is 0.300 s old, bound 0.2 s'}


def test_news_are_published_once(ros):
    told = []
    publisher = DiagnosticsPublisher(ros.node('node'), lambda: told.append(now) or [])
    for now in ('active', 'active', 'stopped', 'stopped', 'active'):
        publisher.publish_news(now)
    assert told == ['active', 'stopped', 'active']


def test_an_error_of_another_kind_is_not_hidden(ros):
    rejections = Rejections(ros.node('node'))
    with pytest.raises(ZeroDivisionError), rejections:
        raise ZeroDivisionError
    assert rejections.total == 0


def test_a_rejected_message_and_a_rejected_request_are_both_logged(ros, capfd):
    """Of a logger rclpy takes one severity alone from one line of code."""
    node = ros.add(ManagedNode('node'))
    Rejections(node).add(InputError('stale', 'setpoint is 0.300 s old, bound 0.2 s'))
    node.report(False, 'home is not possible')
    said = capfd.readouterr().err
    assert '[WARN]' in said and '[ERROR]' in said


def test_messages_that_differ_in_numbers_alone_are_logged_once_a_minute(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(diagnostics.time, 'monotonic', lambda: now[0])
    log, logged = RepeatedLog(), []
    for second in range(120):
        now[0] = 100.0 + second
        for message in (f'q2 is {second}.5 mm away', f'q3: fault 8611h after {second} s'):
            now[0] += 0.5
            logged += [message] if log.is_due(message) else []
    assert [message[:2] for message in logged] == ['q2', 'q3'] * 2
