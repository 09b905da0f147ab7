"""Driver/status: the state of the drives, and the goals that may move the carriages."""

import math
from time import monotonic

from nodes.bench import diagnostics_of, driver_message
import pytest

from facade_manipulator import topics
from facade_manipulator.nodes.conversions import ros_time
from facade_manipulator.nodes.driver_status import DriverStatus, DriverWatch, SILENT
from facade_manipulator.nodes.publisher_watch import PublisherWatch

ACTIVE = DriverStatus('active', 'holding', '', 1795320000.123456)
IDLE = DriverStatus('inactive', 'holding', 'activate')


class Bench:
    """Node that watches the driver, and the publisher of driver/status."""

    def __init__(self, ros):
        node, publisher = ros.node(), ros.node('driver').create_publisher(*topics.DRIVER_STATUS)
        self.until, self.diagnostics = ros.until, diagnostics_of(node)
        self.watch = DriverWatch(node, PublisherWatch(node, self.diagnostics), lambda: None)
        self.publish = lambda status: publisher.publish(driver_message(status))

    def until_status(self, status):
        self.publish(status)
        self.until(lambda: self.watch.status == status, f'{status}')


@pytest.fixture
def bench(ros, monkeypatch):
    monkeypatch.setattr('facade_manipulator.nodes.driver_status.SILENCE', 0.4)
    return Bench(ros)


@pytest.mark.parametrize('step', [0.0, 600.0])
def test_goals_may_move_after_the_activation(bench, step):
    """The system clock is set back by `step` [s], so the activation is in the future."""
    watch = bench.watch
    assert watch.may_move(0.0) and not watch.idle  # no driver is known
    bench.until_status(IDLE)
    assert watch.idle and not watch.may_move(math.nextafter(math.inf, 0.0))
    before, active = monotonic(), ACTIVE._replace(active_since=ros_time() + step)
    for activity in ('holding', 'following'):
        bench.until_status(active._replace(activity=activity))
        assert not watch.idle and watch.may_move(monotonic()) and not watch.may_move(before - 0.1)


def test_driver_without_messages_counts_as_silent(bench):
    for _ in range(2):
        bench.until_status(ACTIVE)
        bench.until(lambda: bench.watch.status is SILENT and bench.watch.idle, 'the silence')


@pytest.mark.parametrize('since', ['', '?', 'nan', '-inf'])
def test_message_of_another_program_is_rejected(bench, since):
    bench.publish(IDLE._replace(active_since=since))
    bench.until(lambda: bench.diagnostics.last_rejection, 'the rejection')
    assert 'driver/status rejected' in bench.diagnostics.last_rejection
    assert bench.watch.status is None
