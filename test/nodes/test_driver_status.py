"""Driver/status: the state of the drives, and the goals that may move the carriages."""

import math
from time import monotonic

from nodes.bench import diagnostics_of, driver_message
import pytest

from facade_manipulator import topics
from facade_manipulator.errors import InputError
from facade_manipulator.nodes.conversions import ros_time
from facade_manipulator.nodes.driver_status import DriverStatus, DriverWatch
from facade_manipulator.nodes.publisher_watch import PublisherWatch

ACTIVE = DriverStatus('active', 'holding', '', 1795320000.123456)
IDLE = DriverStatus('inactive', 'holding', 'activate')


@pytest.mark.parametrize('step', [0.0, 600.0])
def test_only_goals_after_the_activation_may_move(ros, step):
    """The system clock is set back by `step` [s], so the activation is in the future."""
    node, publisher = (
        ros.node(),
        ros.node('driver').create_publisher(*topics.DRIVER_STATUS),
    )
    watch = DriverWatch(node, PublisherWatch(node, diagnostics_of(node)), lambda: None)

    def receive(status):
        publisher.publish(driver_message(status))
        ros.until(lambda: watch.status == status, f'{status}')

    assert watch.may_move(0.0) and not watch.idle  # no driver is known
    receive(IDLE)
    assert watch.idle and not watch.may_move(math.nextafter(math.inf, 0.0))
    before, active = monotonic(), ACTIVE._replace(active_since=ros_time() + step)
    for activity in ('holding', 'following'):
        receive(active._replace(activity=activity))
        assert (
            not watch.idle
            and watch.may_move(monotonic())
            and not watch.may_move(before - 0.1)
        )


@pytest.mark.parametrize('since', ['', '?', 'nan', '-inf'])
def test_message_of_another_program_is_rejected(since):
    with pytest.raises(InputError, match='driver/status rejected'):
        DriverStatus.from_message(driver_message(IDLE._replace(active_since=since)))
