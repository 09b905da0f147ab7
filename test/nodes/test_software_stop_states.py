"""
software_stop in each life-cycle state: the table of docs/operation.md.

Each state meets each event; only clear_faults, with a fresh false of one publisher, ends a true.
"""

from __future__ import annotations

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from loop_bench import LoopThread
import pytest
from rclpy.parameter import Parameter
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.topics import RELIABLE

CLEARED = 'software_stop is cleared'
# what brings the driver into a state, the state after a stop, and the reply of clear_faults
STATES = {
    'unconfigured': ((), 'unconfigured', f'{CLEARED}; next: configure, home, activate'),
    'inactive': (('configure', 'home'), 'inactive', f'{CLEARED}; There is no fault to clear'),
    'active': (('configure', 'home', 'activate'), 'inactive', 'The faults are cleared'),
    'halted': (('configure', 'home', 'activate', 'halt'), 'inactive', 'The faults are cleared'),
}
TRANSITIONS = ('configure', 'activate', 'cleanup')
SIMULATED = (
    Parameter('simulate_drives', value=True),
    # a busy computer must not be another cause of a stop
    Parameter('controller.heartbeat_timeout', value=1.0),
    Parameter('controller.max_missed_cycles', value=10),
)


class Supervisor:
    """A publisher of software_stop that repeats its level."""

    def __init__(self, bench, name='supervisor'):
        self.node = bench.ros.node(name)
        self.level = False
        self.publisher = self.node.create_publisher(Bool, 'software_stop', RELIABLE)
        bench.ros.until(lambda: self.publisher.get_subscription_count() == 1, 'the driver')
        self.timer = self.node.create_timer(0.05, lambda: self.say(self.level))

    def say(self, level):
        self.publisher.publish(Bool(data=level))

    def leave(self):
        self.node.destroy_timer(self.timer)
        self.node.destroy_publisher(self.publisher)


class Bench:
    """A driver with simulated drives, an operator, and one supervisor that allows power."""

    def __init__(self, ros):
        self.ros = ros
        self.node = ros.add(DriverNode(LoopThread, parameter_overrides=[*SIMULATED]))
        self.operator = ros.node('operator')
        self.stop = self.node._software_stop
        self.supervisor = Supervisor(self)
        self.until_false()

    def ask(self, name):
        """Return whether a request succeeds, and the driver's message."""
        if name in TRANSITIONS:
            request = ChangeState.Request(transition=Transition(label=name))
            reply = self.ros.call(self.operator, ChangeState, 'driver/change_state', request)
            return reply.success, self.node.last_failure
        reply = self.ros.call(self.operator, Trigger, f'driver/{name}')
        return reply.success, reply.message

    def require(self, *names):
        for name in names:
            succeeded, message = self.ask(name)
            assert succeeded, message

    def rejection(self, name):
        succeeded, message = self.ask(name)
        assert not succeeded
        return message

    def until_cause(self, text):
        self.ros.until(lambda: self.stop.cause == text if not text else text in self.stop.cause,
                       f'{text}, not {self.stop.cause}')

    def until_false(self):
        self.ros.until(lambda: self.stop._topics['software_stop'].newest is False, 'false')

    def assert_no_power(self, state):
        self.ros.until(lambda: self.node.state_label == state, state)
        if state == 'inactive':
            self.ros.until(
                lambda: self.node._loop.snapshot().power == 'confirmed off', 'the power off')
            assert self.rejection('home') and self.rejection('activate')


@pytest.fixture
def bench(ros):
    return Bench(ros)


@pytest.mark.parametrize('state', STATES)
def test_true_stays_in_force_until_clear_faults(bench, state):
    requests, after, reply = STATES[state]
    bench.require(*requests)
    bench.supervisor.say(True)
    bench.until_cause('software_stop was set')
    bench.until_false()
    bench.assert_no_power(after)
    succeeded, message = bench.ask('clear_faults')
    assert succeeded and reply in message
    assert 'let software_stop be false' not in message
    bench.require(*(('configure', 'home') if state == 'unconfigured' else ()), 'activate')


@pytest.mark.parametrize('state', STATES)
def test_single_true_whose_publisher_left_needs_a_fresh_false(bench, state):
    requests, after, reply = STATES[state]
    bench.require(*requests)
    bench.supervisor.say(True)
    bench.supervisor.leave()
    bench.until_cause('software_stop was set')
    bench.assert_no_power(after)
    assert 'clear_faults rejected: software_stop is true, received' in (
        bench.rejection('clear_faults'))
    bench.supervisor = Supervisor(bench)
    bench.until_false()
    bench.until_cause('software_stop was set')
    succeeded, message = bench.ask('clear_faults')
    assert succeeded and reply in message


@pytest.mark.parametrize('state', STATES)
def test_silence_and_second_publisher_forbid_power_while_they_last(bench, state):
    requests, after, _ = STATES[state]
    bench.require(*requests)
    bench.supervisor.leave()
    bench.until_cause('software_stop has been silent for')
    bench.assert_no_power(after)
    assert 'clear_faults rejected: software_stop has been silent' in (
        bench.rejection('clear_faults'))
    bench.supervisor, second = Supervisor(bench), Supervisor(bench, 'second')
    bench.until_cause('software_stop has 2 publishers (/second, /supervisor), bound 1')
    bench.assert_no_power(after)
    assert 'software_stop has 2 publishers' in bench.rejection('clear_faults')
    second.leave()
    bench.until_cause('')


def test_cleanup_and_configure_do_not_clear_a_true(bench):
    bench.require('configure', 'home')
    bench.supervisor.say(True)
    bench.until_cause('software_stop was set')
    bench.require('cleanup', 'configure')
    assert 'software_stop was set' in bench.rejection('home')


def test_clear_faults_that_the_drives_reject_leaves_the_stop_in_force(bench):
    bench.require('configure', 'home', 'activate')
    bench.node._loop.disturb(1, 'open_safe_torque_off')
    bench.supervisor.say(True)
    bench.until_cause('software_stop was set')
    bench.until_false()
    bench.assert_no_power('inactive')
    assert bench.rejection('clear_faults')
    assert bench.stop.cause == 'software_stop was set'
