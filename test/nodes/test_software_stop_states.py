"""
software_stop in each life-cycle state: the table of docs/operation.md.

Each state meets each event; only clear_faults, with a fresh false of one publisher, ends a true.
"""

from __future__ import annotations

import time

from node_bench import DriverBench
import pytest
from std_msgs.msg import Bool

from facade_manipulator import topics

CLEARED = 'software_stop is cleared'
TRANSITIONS = ('configure', 'activate', 'cleanup')
# requests from one state to the next, the state after a stop, and the reply of clear_faults
STATES = (
    ((), 'unconfigured', f'{CLEARED}; next: configure, home, activate'),
    (('configure', 'home'), 'inactive', f'{CLEARED}; There is no fault to clear'),
    (('activate',), 'inactive', 'The faults are cleared'),
    (('activate', 'halt'), 'inactive', 'The faults are cleared'),
)


class Supervisor:
    """A publisher of software_stop that repeats false."""

    def __init__(self, bench, name='supervisor'):
        self.node = bench.ros.node(name)
        self.publisher = self.node.create_publisher(*topics.SOFTWARE_STOP)
        bench.ros.until(self.publisher.get_subscription_count, 'the driver')
        self.timer = self.node.create_timer(0.05, lambda: self.publish(False))

    def publish(self, is_set):
        self.publisher.publish(Bool(data=is_set))

    def leave(self):
        self.node.destroy_timer(self.timer)
        self.node.destroy_publisher(self.publisher)


class Bench(DriverBench):
    """A driver, an operator, and one supervisor that allows power."""

    def __init__(self, ros):
        super().__init__(ros, {'controller.rate': 50, 'limits.speed': 0.4})
        self.stop = self.tested._software_stop
        self.supervisor = Supervisor(self)
        self.until_false()

    def ask(self, name):
        """Return whether a request succeeds, and the driver's message."""
        if name in TRANSITIONS:
            return self.change(name), self.tested.last_failure
        reply = self.call(topics.HOME._replace(name=f'driver/{name}'))
        return reply.success, reply.message

    def require(self, *names):
        for name in names:
            succeeded, message = self.ask(name)
            assert succeeded, message

    def rejection(self, name):
        succeeded, message = self.ask(name)
        assert not succeeded
        return message

    def cause(self):
        return self.stop.cause(time.monotonic())

    def until_cause(self, text):
        self.ros.until(lambda: text in self.cause() and bool(text) == bool(self.cause()),
                       f'the cause {text!r}')

    def until_false(self):
        self.ros.until(lambda: self.stop._topics['software_stop'].newest is False, 'false')

    def set(self):
        self.supervisor.publish(True)
        self.until_cause('software_stop was set')

    def assert_no_power(self, state):
        self.until_state(state)
        if state == 'inactive':
            self.ros.until(
                lambda: self.tested._loop.snapshot().power == 'confirmed off', 'the power off')
            assert self.rejection('home') and self.rejection('activate')


@pytest.fixture
def bench(ros):
    return Bench(ros)


def test_true_stays_in_force_until_clear_faults(bench):
    for requests, after, reply in STATES:
        bench.require(*requests)
        bench.set()
        bench.until_false()
        bench.assert_no_power(after)
        succeeded, message = bench.ask('clear_faults')
        assert succeeded and reply in message
    bench.require('activate')


def test_silence_and_second_publisher_forbid_power_while_they_last(bench):
    for requests, after, _ in STATES:
        bench.require(*requests)
        bench.supervisor.leave()
        bench.until_cause('software_stop has been silent for')
        bench.assert_no_power(after)
        assert 'has been silent' in bench.rejection('clear_faults')
        bench.supervisor, second = Supervisor(bench), Supervisor(bench, 'second')
        bench.until_cause('software_stop has 2 publishers (/second, /supervisor), bound 1')
        bench.assert_no_power(after)
        assert 'software_stop has 2 publishers' in bench.rejection('clear_faults')
        second.leave()
        bench.until_cause('')
        bench.ask('clear_faults')


def test_true_of_departed_publisher_needs_a_fresh_false(bench):
    bench.require('configure', 'home', 'activate')
    bench.supervisor.publish(True)
    bench.supervisor.leave()  # before it repeats false
    bench.until_cause('software_stop was set')
    bench.assert_no_power('inactive')
    assert 'software_stop is true, received' in bench.rejection('clear_faults')
    Supervisor(bench)
    bench.until_false()
    bench.require('cleanup', 'configure')
    assert 'software_stop was set' in bench.rejection('home')
    bench.require('clear_faults')


def test_short_true_within_one_turn_is_not_missed(bench):
    for is_set in (True, False, False):
        bench.supervisor.publish(is_set)
    bench.until_cause('software_stop was set')


def test_rejected_clear_faults_leaves_the_stop_in_force(bench):
    bench.require('configure', 'home', 'activate')
    bench.disturb(1, 'open_safe_torque_off')
    bench.set()
    bench.until_false()
    bench.assert_no_power('inactive')
    assert bench.rejection('clear_faults')
    assert bench.cause() == 'software_stop was set'
