"""
Software_stop in each lifecycle state: the table of docs/operation.md.

Each state is tested with each event. Only clear_faults ends a true, and requires a fresh false of
a single publisher.
"""

from drive_faults import without_safe_torque
from nodes.node_rig import DriverBench
import pytest
from std_msgs.msg import Bool

from facade_manipulator import topics
from facade_manipulator.nodes.planar_messages import status_values

CLEARED = 'software_stop is cleared'
TWO = 'software_stop has 2 publishers (/second, /supervisor), above the limit 1'
# requests from one state to the next, the state after a stop, and the reply of clear_faults
STATES = (
    ((), 'unconfigured', f'{CLEARED}; next: configure, home, activate'),
    (('configure', 'home'), 'inactive', f'{CLEARED}; There is no fault to clear'),
    (('activate',), 'inactive', 'The faults are cleared'),
    (('activate', 'halt'), 'inactive', 'The faults are cleared'),
)


class Bench(DriverBench):
    """Driver, operator, and a supervisor that repeats false."""

    def __init__(self, ros):
        super().__init__(ros, {'controller.rate': 50, 'limits.speed': 0.4})
        self.stop = ros.node('supervisor').create_publisher(*topics.SOFTWARE_STOP)

        def publish_false():
            self.stop.publish(Bool(data=False))

        self.timer = self.node.create_timer(0.05, publish_false)
        topic = self.tested._software_stop._topics['software_stop']
        ros.until(lambda: topic.newest is False, 'false')

    def values(self):
        return status_values(self.operation())

    def rejection(self, name):
        succeeded, message = self.ask(name)
        assert not succeeded
        return message

    def cause(self):
        """Return why the control loop may give no drive power."""
        return self.loop._forbidden[0]

    def until_cause(self, text):
        def has_cause():
            cause = self.cause()
            return text in cause and bool(text) == bool(cause)

        self.ros.until(has_cause, f'the cause {text!r}')

    def set(self):
        """Publish a true, followed by a false."""
        self.stop.publish(Bool(data=True))
        self.until_cause('software_stop was set')

    def until_cleared(self):
        """Request clear_faults until a false has followed the true; return the message."""

        def message_if_cleared():
            is_cleared, message = self.ask('clear_faults')
            return is_cleared and message

        return self.ros.until(message_if_cleared, 'clear_faults')

    def until_next_step(self, text):
        """Wait for a next step that no longer asks for a false."""

        def has_next_step():
            step = self.loop.snapshot().next_step
            return text in step and 'publish false' not in step

        self.ros.until(has_next_step, f'the next step {text!r}')

    def assert_no_power(self, state):
        self.until_state(state)
        if state == 'inactive':
            self.ros.until(
                lambda: self.loop.snapshot().power == 'confirmed off',
                'the power off',
            )
            assert self.rejection('home')
            assert self.rejection('activate')


@pytest.fixture
def bench(ros):
    return Bench(ros)


def test_true_stays_in_force_until_clear_faults(bench):
    for requests, after, reply in STATES:
        bench.require(*requests)
        bench.set()
        bench.assert_no_power(after)
        bench.until_next_step('clear_faults, ')
        assert reply in bench.until_cleared()
    bench.require('activate')


def test_silence_or_second_publisher_forbid_power_while_they_last(bench, ros):
    other = ros.node('second')
    for requests, after, _ in STATES:
        bench.require(*requests)
        bench.timer.cancel()
        bench.until_cause('software_stop has been silent for')
        bench.assert_no_power(after)
        assert 'has been silent' in bench.rejection('clear_faults')
        second = other.create_publisher(*topics.SOFTWARE_STOP)
        bench.timer.reset()
        bench.until_cause(TWO)
        bench.assert_no_power(after)
        assert (
            f'clear_faults rejected: {TWO}; next: let one node publish software_stop with '
            'reliable quality of service, or wait 20 s if a node has crashed, then'
        ) in bench.rejection('clear_faults')
        other.destroy_publisher(second)
        bench.until_cause('')
        bench.ask('clear_faults')


@pytest.mark.parametrize('is_configured', [False, True])
def test_silence_without_power_needs_only_false(bench, is_configured):
    requests = 'configure, home, activate'
    if is_configured:
        bench.require('configure', 'home')
        requests = 'activate'
    bench.timer.cancel()
    bench.ros.until(
        lambda: (
            bench.message().partition('; next: ')[2]
            == f'publish false on software_stop ten times a second, then {requests}'
        ),
        'the next step',
    )
    bench.timer.reset()
    bench.ros.until(
        lambda: bench.values()['next step'] == requests, 'the last next step'
    )
    bench.require(*requests.split(', '))


def test_true_by_hand_after_silence_is_the_cause(bench):
    bench.bring_up()
    bench.timer.cancel()
    bench.ros.until(lambda: 'silent' in bench.values()['cause'], 'the silence')
    bench.set()
    bench.ros.until(
        lambda: bench.values()['cause'] == 'software_stop was set', 'the cause'
    )
    assert bench.values()['further causes'] == ''


def test_true_between_two_turns_is_not_missed(bench):
    for is_set in (True, False, False):
        bench.stop.publish(Bool(data=is_set))
    bench.until_cause('software_stop was set')
    bench.require('configure')
    assert 'software_stop was set' in bench.rejection('home')


def test_true_message_acts_before_the_next_driver_turn(bench):
    timers = list(bench.tested.timers)
    for timer in timers:
        timer.cancel()
    bench.set()
    for timer in timers:
        timer.reset()


def test_rejected_clear_faults_leaves_the_stop_in_force(bench):
    bench.bring_up()
    bench.disturb(1, without_safe_torque)
    bench.set()
    bench.assert_no_power('inactive')
    bench.ros.until(
        lambda: 'safe torque off' in bench.rejection('clear_faults'), 'the reason'
    )
    assert bench.cause() == 'software_stop was set'
