"""software_stop: what puts it in force and what clears it, by messages and times."""

import pytest

from facade_manipulator.errors import DriveStateError
from facade_manipulator.nodes.software_stop import SoftwareStop

FIRST, SECOND = 'software_stop', 'watchdog/stop'
WAS_SET, TIMEOUT = f'{FIRST} was set', 0.5  # s
SILENT = f'{FIRST} has been silent for more than 0.5 s'
TWO = f'{FIRST} has 2 publishers (/a, /b), bound 1'
SEND_FALSE = f'next: publish false on {FIRST} ten times a second, then clear_faults'


class Timeline:
    """The stops of two supervisors, with a time that the test advances."""

    def __init__(self):
        self.faults, self.now = {}, 100.0
        self.stop = SoftwareStop(
            (FIRST, SECOND), TIMEOUT, lambda name: self.faults.get(name, ''))

    def receive(self, *messages, name=FIRST):
        for is_set in messages:
            self.stop.receive(name, is_set, self.now)
        return self.stop.cause(self.now)

    def wait(self, seconds):
        self.now += seconds
        return self.stop.cause(self.now)


@pytest.fixture
def timeline():
    return Timeline()


def test_power_is_allowed_before_the_first_message(timeline):
    assert timeline.wait(100.0) == ''
    assert timeline.stop.clear(timeline.now) == frozenset()


def test_true_stays_in_force_until_cleared_or_restored(timeline):
    assert timeline.receive(True, False) == WAS_SET
    assert timeline.wait(0.1) == WAS_SET
    released = timeline.stop.clear(timeline.now)
    assert released == {FIRST} and timeline.stop.cause(timeline.now) == ''
    timeline.stop.restore(released)
    assert timeline.stop.cause(timeline.now) == WAS_SET


def test_silence_forbids_power_until_a_message_comes(timeline):
    timeline.receive(False)
    assert [timeline.wait(seconds) for seconds in (TIMEOUT, 0.25, 10.0)] == ['', SILENT, SILENT]
    assert timeline.receive(False) == ''


def test_each_supervisor_forbids_power_for_itself(timeline):
    timeline.receive(True)
    assert timeline.receive(False, True, name=SECOND) == f'{WAS_SET}; {SECOND} was set'
    timeline.receive(False)
    with pytest.raises(DriveStateError, match=f'{SECOND} is true'):
        timeline.stop.clear(timeline.now)
    timeline.receive(False, name=SECOND)
    assert timeline.stop.clear(timeline.now) == {FIRST, SECOND}


@pytest.mark.parametrize('messages, seconds, fault, reason', [
    ([True], 60.0, '', f'{FIRST} is true, received 60.00 s ago, required is false; {SEND_FALSE}'),
    ([True, False], 2.0, '', f'{SILENT}; {SEND_FALSE}'),
    ([True, False], 0.0, TWO, f'{TWO}; next: let one node publish {FIRST} with reliable quality '
     'of service, then clear_faults')])
def test_clear_without_fresh_false_is_rejected(timeline, messages, seconds, fault, reason):
    timeline.receive(*messages)
    timeline.now += seconds
    timeline.faults[FIRST] = fault
    with pytest.raises(DriveStateError) as rejection:
        timeline.stop.clear(timeline.now)
    assert str(rejection.value) == f'clear_faults rejected: {reason}'
    assert timeline.stop.cause(timeline.now) == WAS_SET
