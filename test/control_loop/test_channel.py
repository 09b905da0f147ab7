"""Channel between node and loop: whole messages, a bound, and no waiting."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from facade_manipulator.control_loop import channel
from facade_manipulator.control_loop.channel import Channel, ChannelClosedError


@pytest.fixture
def ends():
    sockets = channel.socket_pair()
    yield tuple(map(Channel, sockets))
    for end in sockets:
        end.close()


def test_closed_end_is_an_error_of_receive(ends):
    ends[0].close()
    with pytest.raises(ChannelClosedError):
        ends[1].receive(1.0)


def test_threads_sending_at_once_neither_wait_nor_mix_messages(ends):
    with ends[0]._sending:
        assert ends[0].send('state', 1) is ends[0].send('reply', 2) is False

    def send(number):
        for _ in range(20):
            ends[0].send('reply', number, bytes([number]) * 500)

    with ThreadPoolExecutor(4) as threads:
        [*threads.map(send, range(4))]
    ends[0].send('reply', 0, bytes(500))  # takes along messages that wait
    assert ends[1].receive(5.0) == ('reply', (2,))
    for _ in range(81):
        _, (number, data) = ends[1].receive(5.0)
        assert data == bytes([number]) * 500
