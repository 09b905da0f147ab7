"""software_stop: what puts it in force, what clears it, and its publishers in the graph."""

from __future__ import annotations

import pytest
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Bool

from facade_manipulator.errors import DriveStateError
from facade_manipulator.nodes.diagnostics import Rejections
from facade_manipulator.nodes.publisher_watch import PublisherWatch
from facade_manipulator.nodes.software_stop import SoftwareStop, subscribe_software_stops

pytestmark = pytest.mark.quick
FIRST, SECOND = 'software_stop', 'watchdog/stop'
TIMEOUT = 0.5  # s


class Timeline:
    """The stops of two supervisors, with a time that the test advances."""

    def __init__(self):
        self.stop, self.now = SoftwareStop((FIRST, SECOND)), 100.0

    def hear(self, name, data, after=0.0):
        self.wait(after)
        self.stop.receive(name, data, self.now)
        return self.stop.cause

    def wait(self, seconds):
        self.now += seconds
        self.stop.watch(self.now, TIMEOUT)
        return self.stop.cause

    def clear(self):
        return self.stop.clear(self.now, TIMEOUT)

    def rejection(self):
        with pytest.raises(DriveStateError) as caught:
            self.clear()
        return str(caught.value)


@pytest.fixture
def timeline():
    return Timeline()


def test_without_a_message_power_is_allowed(timeline):
    assert timeline.wait(100.0) == ''
    assert timeline.clear() == frozenset()


def test_true_stays_in_force_after_false_until_cleared(timeline):
    assert timeline.hear(FIRST, data=True) == 'software_stop was set'
    assert timeline.hear(FIRST, data=False, after=0.1) == 'software_stop was set'
    assert timeline.clear() == {FIRST}
    assert timeline.stop.cause == ''


def test_clear_is_rejected_while_the_newest_message_is_true(timeline):
    timeline.hear(FIRST, data=True)
    timeline.wait(0.2)
    assert timeline.rejection() == (
        'clear_faults rejected: software_stop is true, received 0.20 s ago, required is false; '
        'next: publish false on software_stop ten times a second, then clear_faults')
    assert timeline.stop.cause == 'software_stop was set'


def test_single_true_of_a_publisher_that_left_is_not_cleared(timeline):
    timeline.hear(FIRST, data=True)
    timeline.wait(60.0)
    assert 'software_stop is true, received 60.00 s ago' in timeline.rejection()
    timeline.hear(FIRST, data=False)
    assert timeline.clear() == {FIRST}


def test_silence_forbids_power_until_a_message_comes(timeline):
    timeline.hear(FIRST, data=False)
    assert timeline.wait(TIMEOUT) == ''
    silent = 'software_stop has been silent for 0.75 s, bound 0.5 s'
    assert timeline.wait(0.25) == silent
    assert timeline.wait(10.0) == silent  # one text: it is not news each time
    assert timeline.rejection().startswith(
        'clear_faults rejected: software_stop has been silent for 10.75 s, bound 0.5 s; next: ')
    assert timeline.hear(FIRST, data=False) == ''


def test_silence_is_found_by_clear_itself(timeline):
    timeline.hear(FIRST, data=True)
    timeline.hear(FIRST, data=False)
    timeline.now += 2.0
    assert 'silent for 2.00 s' in timeline.rejection()


def test_second_publisher_forbids_power_and_clear(timeline):
    timeline.hear(FIRST, data=True)
    timeline.hear(FIRST, data=False)
    fault = 'software_stop has 2 publishers (/a, /b), bound 1'
    timeline.stop.note_publishers(FIRST, fault)
    assert fault in timeline.rejection()
    timeline.stop.note_publishers(FIRST, '')
    assert timeline.clear() == {FIRST}
    timeline.stop.note_publishers(FIRST, fault)
    assert timeline.stop.cause == fault


def test_each_supervisor_forbids_power_for_itself(timeline):
    timeline.hear(FIRST, data=True)
    assert timeline.hear(SECOND, data=False) == 'software_stop was set'
    assert timeline.hear(SECOND, data=True) == 'software_stop was set; watchdog/stop was set'
    timeline.hear(FIRST, data=False)
    assert 'watchdog/stop is true' in timeline.rejection()
    timeline.hear(SECOND, data=False)
    assert timeline.clear() == {FIRST, SECOND}


def test_true_during_a_rejected_clear_stays_in_force(timeline):
    timeline.hear(FIRST, data=True)
    timeline.hear(FIRST, data=False)
    timeline.stop.restore(timeline.clear())
    assert timeline.stop.cause == 'software_stop was set'


# --- in the graph

class Graph:
    """A node that subscribes to the stops, and a supervisor that publishes."""

    def __init__(self, ros, arguments=()):
        self.ros = ros
        self.node = ros.node('driver', cli_args=arguments)
        self.stop, self.causes = SoftwareStop(), []
        publishers = PublisherWatch(self.node, Rejections(self.node), self.note)
        self.publishers = publishers
        subscribe_software_stops(self.node, self.stop, publishers, self.note)

    def note(self):
        self.stop.note_publishers(FIRST, self.publishers.fault_of(FIRST))
        self.causes.append(self.stop.cause)


def test_short_true_within_one_turn_is_not_missed(ros):
    graph, supervisor = Graph(ros), ros.node('supervisor')
    publisher = supervisor.create_publisher(Bool, FIRST, 10)
    ros.until(lambda: publisher.get_subscription_count() == 1, 'the subscription')
    for data in (True, False, False):
        publisher.publish(Bool(data=data))
    ros.until(lambda: len(graph.causes) >= 3, 'three messages')
    assert graph.causes[-1] == 'software_stop was set'


@pytest.mark.parametrize('topic', [FIRST, '/site/stop'])
def test_second_publisher_is_found_also_behind_a_remapping(ros, topic):
    arguments = ['--ros-args', '-r', f'{FIRST}:={topic}'] if topic != FIRST else []
    graph, supervisor = Graph(ros, arguments), ros.node('supervisor')
    made = [supervisor.create_publisher(Bool, topic, 10)]
    ros.until(lambda: made[0].get_subscription_count() == 1, 'the subscription')
    assert graph.stop.cause == ''
    made.append(ros.node('another').create_publisher(Bool, topic, 10))
    ros.until(lambda: graph.stop.cause, 'the second publisher')
    ros.until(lambda: graph.stop.cause == (
        'software_stop has 2 publishers (/another, /supervisor), bound 1'), 'its name')
    supervisor.destroy_publisher(made[0])
    ros.until(lambda: graph.stop.cause == '', 'one publisher again')


def test_publisher_that_cannot_be_received_forbids_power_until_a_message(ros):
    graph = Graph(ros)
    ros.node('supervisor').create_publisher(Bool, FIRST, qos_profile_sensor_data)
    ros.until(lambda: graph.stop.cause, 'the cause')
    assert graph.stop.cause == ('software_stop has an incompatible publisher: its quality of '
                                'service is not reliable')
    with pytest.raises(DriveStateError, match='next: publish software_stop with reliable'):
        graph.stop.clear(0.0, TIMEOUT)
    graph.stop.receive(FIRST, is_set=False, now=0.0)
    assert graph.stop.cause == ''
