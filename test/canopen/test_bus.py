"""Frames of a python-can bus, on a virtual bus and on a socket that replaces SocketCAN."""

from contextlib import closing
import errno
import json
import socket
import struct
import time
from unittest.mock import Mock

import can
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.socketcan.constants import SO_TIMESTAMPNS
import pytest

from facade_manipulator.canopen import bus as bus_module
from facade_manipulator.canopen import cob_ids, link
from facade_manipulator.canopen.bus import BusCongestedError, CanBus, open_bus
from facade_manipulator.canopen.link import BusSettings, check_link
from facade_manipulator.errors import BusError

MEGABIT = 1_000_000
EXTENDED = 0x80000000
REMOTE = 0x40000000
ERROR = 0x20000000


class DatagramBus(SocketcanBus):
    """Python-can's SocketCAN on a datagram socket, which stamps received frames alike."""

    def __init__(self, end):
        end.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self.socket = end
        self.channel = 'can9'
        self.channel_info = 'can9'
        self._bcm_sockets = {}
        self._is_filtered = True
        can.BusABC.__init__(self, 'can9')

    _apply_filters = Mock()  # the kernel has no place for filters on this socket

    def is_accepted(self, identifier, is_extended_id):
        """Return whether a frame passes the filters that the kernel would apply."""
        message = can.Message(arbitration_id=identifier, is_extended_id=is_extended_id)
        return self._matches_filters(message)


class ScriptedBus(can.BusABC):
    """Interface of python-can that receives what a test determines, or fails."""

    def __init__(self, message=None, error=None):
        self.channel_info = 'can9'
        self.sync = Mock()  # task that sends a frame periodically
        self.periodic = []  # frames and periods of such tasks
        self._message = message
        self._error = error
        super().__init__('can9')

    def _recv_internal(self, timeout):
        if self._error is not None:
            raise self._error
        return self._message, True

    def send(self, msg, timeout=None):
        if self._error is not None:
            raise self._error

    def send_periodic(self, message, period):
        self.periodic.append((message, period))
        return self.sync

    def shutdown(self):
        super().shutdown()
        if self._error is not None:
            raise self._error


def frame(identifier, data=b''):
    """Return the bytes of struct can_frame."""
    return struct.pack('=IB3x8s', identifier, len(data), data)


@pytest.fixture
def sockets(monkeypatch):
    """Return the python-can bus on a socket, and the socket of the other end."""
    monkeypatch.setattr(bus_module, 'create_bcm_socket', Mock())
    near, far = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    for end in (near, far):
        end.bind(('127.0.0.1', 0))
    near.connect(far.getsockname())
    far.connect(near.getsockname())
    yield DatagramBus(near), far
    far.close()


@pytest.fixture
def wire(sockets):
    """Return a bus on a socket, and the socket of the other end."""
    near, far = sockets
    bus = CanBus(near)
    yield bus, far
    bus.close()


@pytest.fixture
def ends(request):
    """Return both python-can buses of a virtual channel."""
    channel = request.node.name
    ends = []
    for _ in range(2):
        end = can.Bus(interface='virtual', channel=channel, ignore_config=True)
        ends.append(end)
    ends[1].preserve_timestamps = True
    yield ends
    ends[1].shutdown()


@pytest.fixture
def pair(ends):
    """Return a virtual bus, and the python-can bus of the other end."""
    bus = CanBus(ends[0])
    yield bus, ends[1]
    bus.close()


# --- receiving and sending


@pytest.mark.parametrize(
    ('cob_id', 'data'), [(0, b'\x01\x02'), (0x7FF, bytes(8)), (0x80, b'')]
)
def test_frame_arrives_as_sent_with_its_time(wire, cob_id, data):
    bus, far = wire
    bus.send(cob_id, data)
    sent = struct.unpack('=IB3x8s', far.recv(100))
    assert sent == (cob_id, len(data), data.ljust(8, b'\0'))
    before = time.monotonic()
    stamp = time.time()
    far.send(frame(cob_id, data))
    received = bus.receive(1.0)
    assert received[:2] == (cob_id, data)
    assert before - 1e-3 <= received.time <= time.monotonic()
    assert stamp - 0.1 <= received.stamp <= time.time()
    assert bus.statistics.sent == 1
    assert bus.statistics.received == 1


@pytest.mark.parametrize(
    ('content', 'counted'),
    [
        (frame(EXTENDED | 0x181, b'abc'), 'ignored'),
        (frame(0x181, b'abc') + bytes(56), 'ignored'),  # CAN FD
        (frame(ERROR | 0x004, bytes(8)), 'error_frames'),
    ],
)
def test_frame_of_another_kind_is_counted_and_dropped(wire, content, counted):
    bus, far = wire
    far.send(content)
    assert bus.receive(1.0) is None
    assert getattr(bus.statistics, counted) == 1
    assert bus.statistics.received == 0


def test_remote_frame_is_marked_in_its_cob_id(wire):
    bus, far = wire
    far.send(frame(REMOTE | 0x702))
    received = bus.receive(1.0)
    assert received.cob_id == cob_ids.REMOTE_FRAME | 0x702
    assert not received.data


@pytest.mark.parametrize(('is_rx', 'is_local'), [(True, False), (False, True)])
def test_frame_sent_on_this_computer_is_marked(is_rx, is_local):
    message = can.Message(arbitration_id=0x80, is_extended_id=False, is_rx=is_rx)
    with closing(CanBus(ScriptedBus(message))) as bus:
        assert bus.receive(0.0).is_local is is_local


@pytest.mark.parametrize('bus', ['wire', 'pair'])
def test_receive_times_out_although_the_system_clock_is_set(request, monkeypatch, bus):
    bus, _ = request.getfixturevalue(bus)
    falling_hours = range(0, -(10**6), -3600)
    monkeypatch.setattr(can.bus, 'time', Mock(side_effect=falling_hours))
    begin = time.monotonic()
    assert bus.receive(0.05) is None
    assert bus.receive(-1.0) is None
    assert 0.05 <= time.monotonic() - begin < 0.5


@pytest.mark.parametrize(
    ('age', 'is_kept'),
    [(0.5, True), (8.0, True), (12.0, False), (3600.0, False), (-3600.0, False)],
)
def test_frame_keeps_its_age_unless_the_clock_was_set(pair, age, is_kept):
    bus, other = pair
    stamp = time.time() - age
    message = can.Message(arbitration_id=1, is_extended_id=False, timestamp=stamp)
    other.send(message)
    before = time.monotonic()
    received = bus.receive(1.0).time
    if is_kept:
        assert before - received > 0.9 * age
    else:
        assert before <= received


def test_virtual_frame_carries_the_time_of_its_content(pair):
    bus, other = pair
    bus.send(0x182, b'ab', sampled=time.monotonic() - 0.4)
    age = time.time() - other.recv(1.0).timestamp
    assert age == pytest.approx(0.4, abs=0.05)


@pytest.mark.parametrize(
    ('identifier', 'is_extended_id', 'is_accepted'),
    [
        (0x181, False, True),
        (0x701, False, True),
        (0x182, False, False),
        (0x181, True, False),
        (0x18000181, True, False),
    ],
)
def test_kernel_filters_the_frames_of_interest(
    sockets, wire, identifier, is_extended_id, is_accepted
):
    bus, _ = wire
    bus.listen_to((0x181, 0x701))
    assert sockets[0].is_accepted(identifier, is_extended_id) is is_accepted


# --- SYNC


def test_kernel_sends_sync_until_it_is_stopped():
    kernel = ScriptedBus()
    bus = CanBus(kernel)
    bus.start_sync(0.01)
    ((message, period),) = kernel.periodic
    assert message.arbitration_id == 0x080
    assert bytes(message.data) == b''
    assert period == 0.01
    assert not message.is_extended_id
    bus.stop_sync()
    bus.stop_sync()
    kernel.sync.stop.assert_called_once_with()
    bus.close()


def test_kernel_without_broadcast_manager_leaves_sync_to_the_loop(wire, monkeypatch):
    bus, far = wire
    assert bus.has_kernel_sync
    assert bus.sync_note == ''
    monkeypatch.setattr(
        bus_module,
        'create_bcm_socket',
        Mock(side_effect=OSError(errno.EPROTONOSUPPORT, 'Protocol not supported')),
    )
    bus = CanBus(DatagramBus(far))
    assert not bus.has_kernel_sync
    assert 'modprobe can-bcm' in bus.sync_note


# --- trouble


@pytest.mark.parametrize(
    ('error', 'kind', 'reason'),
    [
        (
            can.CanOperationError('Failed to transmit', errno.ENOBUFS),
            BusCongestedError,
            'no node acknowledges',
        ),
        (
            can.CanOperationError('Transmit buffer full'),
            BusCongestedError,
            'send queue is full',
        ),
        (OSError(errno.ENODEV, 'No such device'), BusError, 'No such device'),
        (ValueError('negative'), BusError, 'negative'),
    ],
)
def test_interface_error_is_raised_by_send_and_receive(error, kind, reason):
    bus = CanBus(ScriptedBus(error=error))
    for action in (lambda: bus.send(0x80), lambda: bus.receive(0.0)):
        with pytest.raises(kind, match=reason) as caught:
            action()
        assert type(caught.value) is kind
    bus.close()


def test_full_socket_is_reported_as_congestion_at_once(monkeypatch):
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    monkeypatch.setattr(bus_module, 'create_bcm_socket', lambda channel: near)
    with near, far, pytest.raises(BusCongestedError, match='send queue is full'):
        bus = CanBus(DatagramBus(near.dup()))
        for _ in range(100_000):
            bus.send(0x80, b'')


def test_bus_off_is_a_bus_error_with_its_remedy(wire):
    bus, far = wire
    far.send(frame(ERROR | 0x040, bytes(8)))
    with pytest.raises(
        BusError, match='can9: the controller is bus-off.*can9 type can restart'
    ):
        bus.receive(1.0)
    assert bus.statistics.condition == 'off'


@pytest.mark.parametrize(
    ('error_class', 'bits', 'condition', 'overflows'),
    [
        (0x004, 0x10, 'passive', 0),
        (0x004, 0x20, 'passive', 0),
        (0x004, 0x08, 'warning', 0),
        (0x004, 0x04, 'warning', 0),
        (0x004, 0x01, 'active', 1),
        (0x200, 0x11, 'active', 0),
    ],
)
def test_error_frame_reports_the_controller_until_it_recovers(
    wire, error_class, bits, condition, overflows
):
    bus, far = wire
    details = bytes([0, bits, 0, 0, 0, 0, 0, 0])
    far.send(frame(ERROR | error_class, details))
    assert bus.receive(1.0) is None
    assert bus.statistics.condition == condition
    assert bus.statistics.overflows == overflows
    is_active_again = frame(ERROR | 0x004, bytes([0, 0x40]))
    has_restarted = frame(ERROR | 0x100)
    for recovery in (is_active_again, has_restarted):
        far.send(recovery)
        bus.receive(1.0)
        assert bus.statistics.condition == 'active'


# --- the interface


@pytest.fixture
def interface(tmp_path, monkeypatch):
    """Make can0 in a replacement of /sys with its flags, and an iproute2 that runs a command."""

    def make(flags, command):
        (tmp_path / 'can0').mkdir()
        (tmp_path / 'can0/flags').write_text(f'{flags}\n')
        (tmp_path / 'ip').write_text(
            f'#!/bin/sh\n[ "$*" = "-json -details link show dev can0" ] && {command}\n'
        )
        (tmp_path / 'ip').chmod(0o755)

    monkeypatch.setattr(link, '_SYSTEM', tmp_path)
    monkeypatch.setenv('PATH', str(tmp_path))
    return make


@pytest.mark.parametrize(
    ('channel', 'flags', 'state', 'bitrate', 'message'),
    [
        ('can7', '0x1', 'ERROR-ACTIVE', MEGABIT, 'CAN interface can7 is missing'),
        (
            'can0',
            '0x0',
            'ERROR-ACTIVE',
            MEGABIT,
            'sudo ip link set can0 up type can bitrate 1000000',
        ),
        ('can0', '0x1', 'ERROR-ACTIVE', 500_000, '500000 bit/s, not at 1000000 bit/s'),
        (
            'can0',
            '0x1',
            'BUS-OFF',
            MEGABIT,
            'is bus-off.*sudo ip link set can0 type can restart',
        ),
    ],
)
def test_unusable_interface_is_rejected_with_its_reason(
    interface, channel, flags, state, bitrate, message
):
    details = {'state': state, 'bittiming': {'bitrate': bitrate}}
    interface(flags, f"echo '{json.dumps([{'linkinfo': {'info_data': details}}])}'")
    with pytest.raises(BusError, match=message):
        check_link(channel, MEGABIT)


@pytest.fixture
def interface_at(interface):
    """Return a function that makes can0 with a bit rate of its controller [bit/s]."""

    def make(bitrate):
        details = {'state': 'ERROR-ACTIVE', 'bittiming': {'bitrate': bitrate}}
        interface('0x1', f"echo '{json.dumps([{'linkinfo': {'info_data': details}}])}'")

    return make


@pytest.mark.parametrize('bitrate', [995_100, 999_999, 1_000_250, 1_002_506, 1_004_900])
def test_bit_rate_of_the_adapters_clock_is_accepted(interface_at, bitrate):
    interface_at(bitrate)
    check_link('can0', MEGABIT)


@pytest.mark.parametrize('bitrate', [920_000, 994_000, 1_006_000, 1_041_666])
def test_bit_rate_beyond_the_tolerance_names_the_clock(interface_at, bitrate):
    interface_at(bitrate)
    with pytest.raises(
        BusError, match=r'above the limit 0.5 %: the clock of its adapter.*next: use'
    ):
        check_link('can0', MEGABIT)


@pytest.mark.parametrize('command', ['exit 1', 'echo "[]"', 'echo words', None])
def test_interface_without_controller_details_is_missing_until_up(
    interface, tmp_path, command
):
    bus = BusSettings(interface='socketcan', channel='can0')
    assert bus.missing().startswith('the CAN interface can0 is missing or down')
    interface('0x80', command)
    if command is None:
        (tmp_path / 'ip').unlink()
    assert bus.missing()
    (tmp_path / 'can0/flags').write_text('0x81\n')
    assert not bus.missing()
    assert not BusSettings(interface='virtual').missing()
    check_link('can0', MEGABIT)


def test_can_configuration_of_the_user_is_ignored(tmp_path, monkeypatch):
    (tmp_path / 'can.conf').write_text('[default]\nreceive_own_messages = True\n')
    monkeypatch.setenv('HOME', str(tmp_path))
    with open_bus(BusSettings(channel=tmp_path.name)) as bus:
        bus.send(can.Message(arbitration_id=1, is_extended_id=False))
        assert bus.recv(0.0) is None


def test_unopenable_bus_is_a_bus_error():
    with pytest.raises(BusError, match='cannot be opened'):
        open_bus(BusSettings(interface='no_such_kind'))
