"""software_stop: a level, a silence and a second publisher each forbid power, with their cause."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Bool

from facade_manipulator.ros import software_stop

pytestmark = pytest.mark.quick
FIRST, SECOND = 'software_stop', 'watchdog/stop'


@pytest.fixture
def stops(ros, monkeypatch):
    """Return two supervisors' stops with a clock of their own, and what is forbidden."""
    clock, said = [100.0], []
    monkeypatch.setattr(software_stop, 'time', SimpleNamespace(monotonic=lambda: clock[0]))
    stops = software_stop.SoftwareStop(ros.node(), said.append, (FIRST, SECOND))

    def hear(topic, data, after=0.0):
        clock[0] += after
        stops._receive(topic, Bool(data=data))
        return said[-1]

    def watch(timeout, after=0.0):
        clock[0] += after
        count = len(said)
        stops.watch(timeout)
        return said[count:]

    return hear, watch


def test_who_has_set_it_and_who_is_silent_is_said_once_until_it_speaks(stops):
    hear, watch = stops
    assert not watch(0.5, 100.0)  # nobody has spoken yet
    assert hear(FIRST, data=False) == ''
    assert hear(FIRST, data=True) == 'software_stop was set'
    assert hear(SECOND, data=False) == 'software_stop was set'
    assert not watch(0.5, 0.5)
    silent = 'watchdog/stop has been silent for 0.75 s, bound 0.5 s'
    assert watch(0.5, 0.25) == [f'software_stop was set; {silent}']
    assert not watch(0.5, 10.0)
    assert hear(FIRST, data=False) == silent
    assert hear(SECOND, data=False) == ''
    assert hear(SECOND, data=True) == 'watchdog/stop was set'


def test_a_second_publisher_of_a_stop_forbids_power(ros, stops):
    hear, _ = stops
    node = ros.node('supervisor')
    made = [node.create_publisher(Bool, FIRST, 1)]
    ros.until(lambda: node.count_publishers(FIRST) == 1, 'one publisher')
    assert hear(FIRST, data=False) == ''
    made.append(node.create_publisher(Bool, FIRST, 1))
    ros.until(lambda: node.count_publishers(FIRST) == 2, 'two publishers')
    assert hear(FIRST, data=False).startswith('software_stop has 2 publishers, bound 1')


def test_a_publisher_of_which_nothing_comes_forbids_power_until_a_message_does(ros):
    said = []
    stops = software_stop.SoftwareStop(ros.node(), said.append)
    ros.node('supervisor').create_publisher(Bool, FIRST, qos_profile_sensor_data)
    ros.until(lambda: said, 'the cause')
    assert said == ['software_stop has an incompatible publisher: its quality of service '
                    'is not reliable']
    stops._receive(FIRST, Bool(data=False))
    assert said[-1] == ''
