"""Rejected messages: counted, logged, and the callback ends there."""

import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.ros.diagnostics import Rejections
from facade_manipulator.ros.lifecycle import ManagedNode


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
