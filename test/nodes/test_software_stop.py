"""Software_stop: messages that set or clear it, and times that forbid power."""

import re

import pytest

from facade_manipulator.errors import DriveStateError
from facade_manipulator.nodes.software_stop import SoftwareStop

FIRST = 'software_stop'
SECOND = 'watchdog/stop'


def test_each_supervisor_forbids_power_until_its_fresh_false():
    stop = SoftwareStop((FIRST, SECOND), 0.5, lambda name: '')
    for name, is_set in ((FIRST, True), (SECOND, True), (FIRST, False)):
        stop.receive(name, is_set, 100.0)
    for now, name, reason in (
        (
            100.4,
            SECOND,
            r'is true \(received 0\.40 s ago\) and must be '
            'false',
        ),
        (102.0, FIRST, r'has been silent for more than 0\.5 s'),
    ):
        with pytest.raises(DriveStateError) as rejection:
            stop.clear(now)
        assert re.fullmatch(
            f'clear_faults rejected: {name} {reason}; next: publish false on {name} ten times a '
            'second, then clear_faults',
            str(rejection.value),
        )
        assert stop.cause(now) == f'{FIRST} was set; {SECOND} was set'
        assert f'publish false on {name} ten times a second' in stop.next_step(now)
    stop.receive(SECOND, False, 100.0)
    # only clear_faults is missing
    assert stop.next_step(100.0) == ''
    assert stop.cause(100.0)
    assert stop.clear(100.0) == {FIRST, SECOND}


def test_second_publisher_is_named_with_the_crash_wait():
    """The publisher of a killed supervisor stays in the graph for 20 s."""
    stop = SoftwareStop((FIRST,), 0.5, lambda name: f'{name} has 2 publishers')
    stop.receive(FIRST, False, 100.0)
    with pytest.raises(
        DriveStateError, match='or wait 20 s if a node has crashed, then'
    ):
        stop.clear(100.0)
    assert 'or wait 20 s if a node has crashed' in stop.next_step(100.0)


def test_each_topic_without_a_message_has_a_note():
    stop = SoftwareStop((FIRST, SECOND), 0.5, lambda name: '')
    never = ' was never received: no supervisor can stop the drives with it'
    assert stop.notes == (FIRST + never, SECOND + never)
    stop.receive(SECOND, True, 100.0)
    assert stop.notes == (FIRST + never,)
    stop.receive(FIRST, False, 100.0)
    assert stop.notes == ()


def test_empty_list_of_topics_has_a_note():
    stop = SoftwareStop((), 0.5, lambda name: '')
    assert stop.notes == (
        'no topic of software_stop is configured: no supervisor can stop the drives',
    )
