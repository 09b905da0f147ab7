"""driver/status: what the driver is doing, and which goals may move the carriages."""

from functools import partial
import math
from time import monotonic

from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from qualities import DRIVER_STATUS, LATCHED

from facade_manipulator.errors import InputError
from facade_manipulator.messages import status_level
from facade_manipulator.ros.conversions import node_time
from facade_manipulator.ros.diagnostics import (
    diagnostic_status,
    DriverStatus,
    DriverWatch,
    Rejections,
    SILENT,
)
from facade_manipulator.ros.interfaces import subscription

pytestmark = pytest.mark.quick
ACTIVE = DriverStatus('active', 'holding', '', 1795320000.123456)
IDLE = DriverStatus('inactive', 'holding', 'activate')


def watch_driver(node, on_change):
    return DriverWatch(node, Rejections(node), on_change, partial(subscription, node))


@pytest.mark.parametrize('status', [ACTIVE, IDLE])
def test_a_status_comes_back_as_it_was_sent(status):
    assert DriverStatus.from_message(status.to_message('ok', 'a message')) == status


@pytest.mark.parametrize('step', [0.0, 600.0])
def test_goals_may_move_from_the_activation_on_whatever_is_done_to_the_clock(ros, step):
    """Set back by a step: what the driver noted lies in the future."""
    node, changes = ros.node(), []
    publisher = node.create_publisher(type(IDLE.to_message('ok', '')), DRIVER_STATUS, LATCHED)
    watch = watch_driver(node, lambda: changes.append(watch.status))
    assert watch.may_move(0.0) and not watch.idle  # nothing is known of a driver
    publisher.publish(IDLE.to_message('ok', 'inactive'))
    ros.until(lambda: changes == [IDLE], 'the first status')
    assert watch.idle and not watch.may_move(math.nextafter(math.inf, 0.0))
    before, active = monotonic(), ACTIVE._replace(active_since=node_time(node) + step)
    publisher.publish(active.to_message('ok', 'active'))
    ros.until(lambda: len(changes) == 2, 'the second status')
    assert not watch.idle
    assert watch.may_move(monotonic()) and not watch.may_move(before - 0.1)
    publisher.publish(active._replace(activity='following').to_message('ok', 'active'))
    ros.until(lambda: len(changes) == 3, 'the third status')
    assert watch.may_move(monotonic()) and not watch.may_move(before - 0.1)


def test_a_driver_that_says_no_more_is_silent_until_it_speaks(ros, monkeypatch):
    monkeypatch.setattr('facade_manipulator.ros.diagnostics.SILENCE', 0.2)
    node, changes = ros.node(), []
    publisher = node.create_publisher(type(IDLE.to_message('ok', '')), DRIVER_STATUS, LATCHED)
    watch = watch_driver(node, lambda: changes.append(watch.status))
    publisher.publish(ACTIVE.to_message('ok', 'active'))
    ros.until(lambda: changes == [ACTIVE, SILENT], 'the silence')
    assert watch.idle
    publisher.publish(ACTIVE.to_message('ok', 'active'))
    ros.until(lambda: changes == [ACTIVE, SILENT, ACTIVE], 'the driver again')


@pytest.mark.parametrize('values', [
    {}, {'state': 'active'},
    *({'state': '', 'activity': '', 'next step': '', 'active since': since}
      for since in ('', '?', 'nan', '-inf'))])
def test_what_no_driver_says_is_no_status(values):
    with pytest.raises(InputError, match='not as the driver sends it'):
        DriverStatus.from_message(diagnostic_status('operation', 'ok', '', values))


def test_what_no_driver_says_is_counted_and_changes_nothing(ros):
    node, rejections = ros.node(), Rejections(ros.node('other'))
    publisher = node.create_publisher(DiagnosticStatus, DRIVER_STATUS, LATCHED)
    watch = DriverWatch(node, rejections, lambda: None, partial(subscription, node))
    publisher.publish(DiagnosticStatus())
    ros.until(lambda: rejections.total == 1, 'the rejection')
    assert watch.status is None


def test_a_level_that_is_not_defined_is_an_error():
    assert status_level(DiagnosticStatus(level=b'\x63')) == 'error'
