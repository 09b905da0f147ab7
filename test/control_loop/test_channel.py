"""Channel between node and loop: whole messages, a bound, and no waiting."""

from control_loop.loop_bench import channel_pair, waiting_messages
import pytest


def test_last_messages_of_an_ended_process_are_received():
    """The kernel reports first that the process has left messages unread."""
    ours, theirs = channel_pair()
    ours.send('feed')
    theirs.send('reply', 1)
    theirs.send('reply', 2)
    theirs.close()
    messages = waiting_messages(ours)
    assert [next(messages), next(messages)] == [('reply', (1,)), ('reply', (2,))]
    with pytest.raises(ConnectionError):
        next(messages)
    ours.close()
