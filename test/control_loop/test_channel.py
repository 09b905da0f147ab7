"""Channel between node and loop: whole messages, a bound, and no waiting."""

from concurrent.futures import ThreadPoolExecutor
import socket

import pytest

from facade_manipulator.control_loop.channel import Channel


def test_threads_sending_at_once_neither_wait_nor_mix_messages():
    ours, theirs = map(
        Channel, socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    )
    with ours._sending:
        assert ours.send('state', 1) is ours.send('reply', 2) is False

    def send(number):
        for _ in range(20):
            ours.send('reply', number, bytes([number]) * 500)

    with ThreadPoolExecutor(4) as threads:
        [*threads.map(send, range(4))]
    ours.send('reply', 0, bytes(500))  # takes along messages that wait
    assert theirs.receive(5.0) == ('reply', (2,))
    for _ in range(81):
        _, (number, data) = theirs.receive(5.0)
        assert data == bytes([number]) * 500
    ours.close()
    for end in (ours, theirs):
        with pytest.raises(ConnectionError):
            end.receive(0.0)
    theirs.close()


def test_last_messages_of_an_ended_process_are_received():
    """The kernel reports first that the process has left messages unread."""
    ours, theirs = map(
        Channel, socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    )
    ours.send('feed')
    theirs.send('reply', 1)
    theirs.send('reply', 2)
    theirs.close()
    assert [ours.receive(0.0), ours.receive(0.0)] == [('reply', (1,)), ('reply', (2,))]
    with pytest.raises(ConnectionError):
        ours.receive(0.0)
    ours.close()
