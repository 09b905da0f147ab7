"""driver/status: the state of the drives, and which goals may move the carriages."""

import math
from time import monotonic

from node_bench import diagnostics_of, driver_message
import pytest

from facade_manipulator import topics
from facade_manipulator.nodes.conversions import ros_time
from facade_manipulator.nodes.diagnostics import diagnostic_status
from facade_manipulator.nodes.driver_status import DriverStatus, DriverWatch, SILENT
from facade_manipulator.nodes.publisher_watch import PublisherWatch

pytestmark = pytest.mark.quick
ACTIVE = DriverStatus('active', 'holding', '', 1795320000.123456)
IDLE = DriverStatus('inactive', 'holding', 'activate')


class Bench:
    """A node that watches the driver, and the publisher of driver/status."""

    def __init__(self, ros):
        node = ros.node()
        self.changes, self.diagnostics = [], diagnostics_of(node)
        self.publisher = ros.node('driver').create_publisher(*topics.DRIVER_STATUS)
        self.watch = DriverWatch(node, PublisherWatch(node, self.diagnostics),
                                 lambda: self.changes.append(self.watch.status))

    def publish(self, status):
        self.publisher.publish(driver_message(status))


@pytest.fixture
def bench(ros, monkeypatch):
    monkeypatch.setattr('facade_manipulator.nodes.driver_status.SILENCE', 0.4)
    return Bench(ros)


@pytest.mark.parametrize('status', [ACTIVE, IDLE])
def test_status_survives_the_way_through_a_message(status):
    assert DriverStatus.from_message(driver_message(status)) == status


@pytest.mark.parametrize('step', [0.0, 600.0])
def test_goals_may_move_from_the_activation_on(ros, bench, step):
    """The system clock is set back by `step` [s]: the activation lies in the future."""
    watch, changes = bench.watch, bench.changes
    assert watch.may_move(0.0) and not watch.idle  # no driver is known
    bench.publish(IDLE)
    ros.until(lambda: changes == [IDLE], 'the first status')
    assert watch.idle and not watch.may_move(math.nextafter(math.inf, 0.0))
    before, active = monotonic(), ACTIVE._replace(active_since=ros_time() + step)
    for activity in ('holding', 'following'):
        bench.publish(active._replace(activity=activity))
        ros.until(lambda activity=activity: watch.status.activity == activity
                  and not watch.idle, activity)
        assert watch.may_move(monotonic()) and not watch.may_move(before - 0.1)


def test_driver_without_messages_is_silent_until_the_next(ros, bench):
    for _ in range(2):
        bench.publish(ACTIVE)
        ros.until(lambda: bench.watch.status == ACTIVE, 'the driver')
        ros.until(lambda: bench.watch.status is SILENT, 'the silence')
        assert bench.watch.idle


@pytest.mark.parametrize('values', [
    {}, {'state': 'active'}, *(IDLE.values() | {'active since': since}
                               for since in ('', '?', 'nan', '-inf'))])
def test_message_of_another_program_is_rejected(ros, bench, values):
    bench.publisher.publish(diagnostic_status('operation', 'ok', '', values))
    ros.until(lambda: bench.diagnostics.last_rejection, 'the rejection')
    assert 'driver/status rejected' in bench.diagnostics.last_rejection
    assert bench.watch.status is None
