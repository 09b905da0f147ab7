"""Software_stop: messages that set or clear it, and times that forbid power."""

import pytest

from facade_manipulator.errors import DriveStateError
from facade_manipulator.nodes.software_stop import SoftwareStop

FIRST, SECOND = 'software_stop', 'watchdog/stop'
WAS_SET, TIMEOUT = f'{FIRST} was set', 0.5  # s
SILENT = f'{FIRST} has been silent for more than 0.5 s'
TWO = f'{FIRST} has 2 publishers (/a, /b), bound 1'
SEND_FALSE = f'next: publish false on {FIRST} ten times a second, then clear_faults'


def stop_with(fault=''):
    """Return the stop of two supervisors, with a fault of the first supervisor's publishers."""
    return SoftwareStop((FIRST, SECOND), TIMEOUT, lambda name: fault * (name == FIRST))


def test_each_supervisor_forbids_power_independently():
    stop = stop_with()
    for name, is_set in ((FIRST, True), (SECOND, True), (FIRST, False)):
        stop.receive(name, is_set, 100.0)
    assert stop.cause(100.0) == f'{WAS_SET}; {SECOND} was set'
    with pytest.raises(DriveStateError, match=f'{SECOND} is true'):
        stop.clear(100.0)
    stop.receive(SECOND, False, 100.0)
    assert stop.clear(100.0) == {FIRST, SECOND}


@pytest.mark.parametrize('messages, seconds, fault, reason', [
    ([True], 60.0, '', f'{FIRST} is true, received 60.00 s ago, required is false; {SEND_FALSE}'),
    ([True, False], 2.0, '', f'{SILENT}; {SEND_FALSE}'),
    ([True, False], 0.0, TWO, f'{TWO}; next: let one node publish {FIRST} with reliable quality '
     'of service, then clear_faults')])
def test_clear_without_fresh_false_is_rejected(messages, seconds, fault, reason):
    stop = stop_with(fault)
    for is_set in messages:
        stop.receive(FIRST, is_set, 100.0)
    with pytest.raises(DriveStateError) as rejection:
        stop.clear(100.0 + seconds)
    assert str(rejection.value) == f'clear_faults rejected: {reason}'
    assert stop.cause(100.0 + seconds) == WAS_SET
