"""Channel between node and loop: whole messages, a bound, and no waiting."""

import time

from control_loop.loop_rig import channel_pair, waiting_messages
import pytest


def test_last_messages_of_an_ended_process_are_received():
    """The kernel reports first that the process has left messages unread."""
    ours, theirs = channel_pair()
    ours.send('feed')
    theirs.send('reply', 1)
    theirs.send('reply', 2)
    theirs.close()
    messages = waiting_messages(ours)
    assert next(messages) == ('reply', (1,))
    assert next(messages) == ('reply', (2,))
    with pytest.raises(ConnectionError):
        next(messages)
    ours.close()


def test_flood_of_the_stream_hides_no_command():
    ours, theirs = channel_pair()
    number = 0
    while ours.send('setpoint', number):
        number += 1
    assert number > 100
    assert ours.send('stop', 'enough')
    assert [*theirs.commands()] == [('stop', ('enough',))]
    newest = [content for _, content in theirs.stream(2)]
    assert newest == [(number - 2,), (number - 1,)]
    assert theirs.stream(2) == []


def test_stream_is_read_while_the_condition_holds():
    ours, theirs = channel_pair()
    for number in range(5):
        ours.send('state', number)
    allowed = iter([True, True, False])
    read = theirs.stream(9, lambda: next(allowed))
    assert [content for _, content in read] == [(0,), (1,)]
    assert len(theirs.stream(9)) == 3


@pytest.mark.realtime
def test_wait_without_a_command_ends_at_its_timeout():
    ours, _theirs = channel_pair()
    begin = time.monotonic()
    ours.wait(0.05)
    assert 0.05 <= time.monotonic() - begin < 5.0
