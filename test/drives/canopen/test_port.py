"""Both ways through an interface; a datagram socket stands for a CAN socket."""

import socket
import struct
import time

import can
from can.interfaces.socketcan.constants import SO_TIMESTAMPNS
from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.canopen.port import Kind, MessagePort, port_of, SocketPort

PATIENCE = 5.0
EXTENDED, REMOTE, ERROR = 0x80000000, 0x40000000, 0x20000000
COB_IDS, DATA = st.integers(0, 0x7FF), st.binary(max_size=8)


def datagram_sockets():
    """Two sockets that hear each other and stamp what they receive, as python-can sets them."""
    ends = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    for end in ends:
        end.bind(('127.0.0.1', 0))
        end.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    for end, other in (ends, ends[::-1]):
        end.connect(other.getsockname())
    return ends


@pytest.fixture(params=['messages', 'socket'], scope='module')
def ports(request):
    if request.param == 'socket':
        ends = datagram_sockets()
        yield tuple(map(SocketPort, ends))
        for end in ends:
            end.close()
        return
    buses = [can.Bus(interface='virtual', channel='test_port') for _ in range(2)]
    yield tuple(map(port_of, buses))
    for bus in buses:
        bus.shutdown()


@pytest.fixture
def wire():
    """A port and the socket of whoever sends to it."""
    near, far = datagram_sockets()
    with near, far:
        yield SocketPort(near), far


def frame(identifier, data=b''):
    """Lay out struct can_frame."""
    return struct.pack('=IB3x8s', identifier, len(data), data)


def test_a_clock_that_is_set_back_does_not_make_a_receiver_wait(monkeypatch):
    clock = iter([1000.0])
    monkeypatch.setattr(can.bus, 'time', lambda: next(clock, 900.0))
    with can.Bus(interface='virtual', channel='set back') as bus:
        begin = time.monotonic()
        assert MessagePort(bus).receive(0.05) is None
        assert time.monotonic() - begin < PATIENCE


@given(cob_id=COB_IDS, data=DATA)
def test_what_one_end_sends_the_other_receives_with_its_time(ports, cob_id, data):
    here, there = ports
    before = time.time()
    here.send(cob_id, data)
    received = there.receive(PATIENCE)
    assert received[:3] == (Kind.DATA, cob_id, data)
    assert before - 0.1 <= received[3] <= time.time() + 0.1


def test_silence_is_none_after_the_time_out(ports):
    assert ports[0].receive(0.0) is None


@given(cob_id=COB_IDS, data=DATA)
def test_a_frame_is_laid_out_as_the_kernel_wants_it(cob_id, data):
    near, far = datagram_sockets()
    with near, far:
        SocketPort(near).send(cob_id, data)
        assert far.recv(100) == frame(cob_id, data)


@pytest.mark.parametrize(('content', 'kind'), [
    (frame(0x181, b'abc'), Kind.DATA),
    (frame(EXTENDED | 0x181, b'abc'), Kind.OTHER),
    (frame(REMOTE | 0x181), Kind.OTHER),
    (frame(ERROR | 0x040, bytes(8)), Kind.ERROR),
    (frame(0x181, b'abc') + bytes(56), Kind.OTHER),  # CAN FD
])
def test_frames_of_another_kind_are_told_by_flags_and_length(wire, content, kind):
    port, sender = wire
    sender.send(content)
    assert port.receive(PATIENCE)[0] is kind


def test_a_socket_that_takes_no_more_raises_at_once():
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    port = SocketPort(near)
    with near, far, pytest.raises(BlockingIOError):
        for _ in range(100_000):
            port.send(0x80, b'')


def test_a_socket_that_was_closed_raises_on_both_ways(wire):
    port, _ = wire
    port._socket.close()
    with pytest.raises(ValueError, match='negative'):
        port.receive(0.0)
    with pytest.raises(OSError, match='Bad file descriptor'):
        port.send(0x80, b'')


def test_an_interface_without_a_can_socket_is_gone_through_by_messages():
    with can.Bus(interface='virtual', channel='test_port_of') as bus:
        assert isinstance(port_of(bus), MessagePort)
