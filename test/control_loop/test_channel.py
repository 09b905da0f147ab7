"""The channel between node and loop: whole messages, a bound, and never a wait."""

from __future__ import annotations

from threading import Thread

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.control_loop.channel import (
    Channel,
    ChannelClosedError,
    MAX_BACKLOG,
    MAX_MESSAGE,
    socket_pair,
)

CONTENT = st.tuples(st.integers(), st.floats(allow_nan=False), st.text(max_size=50), st.binary())


@pytest.fixture
def sockets():
    made = socket_pair()
    yield made
    for end in made:
        end.close()


@pytest.fixture
def ends(sockets):
    return tuple(map(Channel, sockets))


def fill(channel):
    """Send until there is no room any more; return how many messages there was room for."""
    sent = 0
    while channel.send('state', bytes(1000)):
        sent += 1
    return sent


@given(st.lists(CONTENT, max_size=5))
def test_messages_arrive_whole_and_in_order(contents):
    ends = tuple(map(Channel, socket_pair()))
    for content in contents:
        assert ends[0].send('state', *content)
    for content in contents:
        message = ends[1].receive(1.0)
        assert (message.kind, message.content) == ('state', content)
    for end in ends:
        end.close()


def test_sending_does_not_wait_for_another_thread(ends):
    with ends[0]._sending:
        assert ends[0].send('state', 1) is ends[0].send('reply', 2, must_arrive=True) is False
    assert ends[0].send('state', 3)
    assert [ends[1].receive(0.0).content for _ in range(2)] == [(2,), (3,)]


def test_messages_that_must_arrive_are_not_lost(ends):
    sent = fill(ends[0])
    for number in range(MAX_BACKLOG):
        ends[0].send('reply', number, must_arrive=True)
    with pytest.raises(ChannelClosedError, match='reads nothing any more'):
        ends[0].send('reply', MAX_BACKLOG, must_arrive=True)
    for _ in range(sent):
        ends[1].receive(1.0)
    for number in range(MAX_BACKLOG):
        ends[0].send('state')
        while (message := ends[1].receive(0.0)) and message.kind == 'state':
            pass
        assert message.content == (number,)


def test_message_that_is_too_long_is_skipped(sockets):
    receiver = Channel(sockets[1])
    sockets[0].send(bytes(MAX_MESSAGE + 1))
    sockets[0].send(b'state\0garbage')
    assert receiver.receive(1.0) is None
    assert receiver.receive(1.0).kind == 'state'


def test_closed_end_is_an_error_both_ways(ends):
    ends[0].close()
    with pytest.raises(ChannelClosedError):
        ends[1].receive(1.0)
    with pytest.raises(ChannelClosedError):
        ends[1].send('state')


def test_threads_sending_at_once_mix_no_messages(ends):
    def send(number):
        for _ in range(20):
            ends[0].send('state', number, bytes([number]) * 500, must_arrive=True)

    threads = [Thread(target=send, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    ends[0].send('reply', 0, bytes(500), must_arrive=True)  # takes along what still waits
    for _ in range(81):
        number, data = ends[1].receive(5.0).content
        assert data == bytes([number]) * 500
