"""Frames past and through python-can's messages; a datagram socket stands for a CAN socket."""

import errno
import socket
import struct
import time
from types import SimpleNamespace

import can
from can.interfaces.socketcan.constants import SO_TIMESTAMPNS
from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.canopen import bus as bus_module
from facade_manipulator.canopen.bus import (
    BusCongestedError,
    can_bus,
    CanBus,
    Condition,
    SocketCanBus,
)
from facade_manipulator.errors import BusError

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


def socket_bus(end):
    return SocketCanBus(SimpleNamespace(
        socket=end, channel='can9', channel_info='can9', shutdown=end.close))


@pytest.fixture(params=['messages', 'socket'], scope='module')
def buses(request):
    if request.param == 'socket':
        ends = tuple(map(socket_bus, datagram_sockets()))
    else:
        ends = tuple(
            can_bus(can.Bus(interface='virtual', channel='test_socket', ignore_config=True))
            for _ in range(2))
    yield ends
    for end in ends:
        end.close()


@pytest.fixture
def wire():
    """A bus and the socket of whoever sends to it."""
    near, far = datagram_sockets()
    with near, far:
        yield socket_bus(near), far


def frame(identifier, data=b''):
    """Lay out struct can_frame."""
    return struct.pack('=IB3x8s', identifier, len(data), data)


@given(cob_id=COB_IDS, data=DATA)
def test_what_one_end_sends_the_other_receives_with_its_time(buses, cob_id, data):
    here, there = buses
    before, counted = (time.monotonic(), time.time()), there.statistics.received
    here.send(cob_id, data)
    received = there.receive(PATIENCE)
    assert (received.cob_id, received.data) == (cob_id, data)
    assert before[0] - 1e-3 <= received.time <= time.monotonic()
    assert before[1] - 0.1 <= received.stamp <= time.time() + 0.1
    assert there.statistics.received == counted + 1


def test_silence_is_none_after_the_time_out(buses):
    assert buses[0].receive(0.0) is None
    assert buses[0].receive(-1.0) is None


@given(cob_id=COB_IDS, data=DATA)
def test_a_frame_is_laid_out_as_the_kernel_wants_it(cob_id, data):
    near, far = datagram_sockets()
    with near, far:
        socket_bus(near).send(cob_id, data)
        assert far.recv(100) == frame(cob_id, data)


@pytest.mark.parametrize(('content', 'counted'), [
    (frame(EXTENDED | 0x181, b'abc'), 'ignored'),
    (frame(REMOTE | 0x181), 'ignored'),
    (frame(0x181, b'abc') + bytes(56), 'ignored'),  # CAN FD
    (frame(ERROR | 0x004, bytes(8)), 'error_frames'),
])
def test_frames_of_another_kind_are_told_by_flags_and_length(wire, content, counted):
    bus, sender = wire
    sender.send(content)
    assert bus.receive(PATIENCE) is None
    assert (getattr(bus.statistics, counted), bus.statistics.received) == (1, 0)


@pytest.mark.parametrize(('cob_id', 'is_extended', 'passes'), [
    (0x181, False, True), (0x701, False, True), (0x182, False, False), (0x181, True, False),
    (0x18000181, True, False)])
def test_the_kernel_is_asked_for_the_standard_frames_that_somebody_listens_to(
        cob_id, is_extended, passes):
    with can.Bus(
            interface='virtual', channel='test_filters', ignore_config=True) as like_the_kernel:
        SocketCanBus(like_the_kernel).listen_to((0x181, 0x701))
        message = can.Message(arbitration_id=cob_id, is_extended_id=is_extended)
        assert like_the_kernel._matches_filters(message) is passes


def test_a_controller_that_is_bus_off_is_an_error(wire):
    bus, sender = wire
    sender.send(frame(ERROR | 0x040, bytes(8)))
    with pytest.raises(BusError, match='can9: the controller is bus-off.*can9 type can restart'):
        bus.receive(PATIENCE)
    assert bus.statistics.condition is Condition.OFF


def test_a_socket_that_takes_no_more_raises_at_once():
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    bus = socket_bus(near)
    with near, far, pytest.raises(BusCongestedError, match='send queue is full'):
        for _ in range(100_000):
            bus.send(0x80, b'')


def test_a_socket_that_was_closed_raises_on_both_ways(wire):
    bus, _ = wire
    bus.close()
    with pytest.raises(BusError, match='negative'):
        bus.receive(0.0)
    with pytest.raises(BusError, match='the CAN socket is closed'):
        bus.send(0x80, b'')


@pytest.mark.parametrize('has_manager', [True, False])
def test_kernel_without_broadcast_manager_leaves_sync_to_the_loop(monkeypatch, has_manager):
    opened = []

    def open_socket(*kind):
        opened.append(kind)
        if not has_manager:
            raise OSError(errno.EPROTONOSUPPORT, 'Protocol not supported')
        return SimpleNamespace(close=opened.clear)

    monkeypatch.setattr(bus_module.socket, 'socket', open_socket)
    bus = SocketCanBus(SimpleNamespace(channel_info='can9'))
    assert bus.has_kernel_sync is has_manager
    if has_manager:
        assert bus.sync_note == '' and not opened  # it is closed again
    else:
        assert opened == [(socket.PF_CAN, socket.SOCK_DGRAM, socket.CAN_BCM)]
        assert 'the control loop sends SYNC' in bus.sync_note


def test_an_interface_without_a_can_socket_is_gone_through_by_messages():
    with can.Bus(interface='virtual', channel='test_can_bus', ignore_config=True) as bus:
        assert type(can_bus(bus)) is CanBus
