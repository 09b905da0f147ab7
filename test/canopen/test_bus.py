import errno
import time
from types import SimpleNamespace

import can
from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.canopen import link
from facade_manipulator.canopen.bus import (
    BusCongestedError,
    can_bus,
    CanBus,
    Condition,
    condition_of,
    ERROR_FRAME,
)
from facade_manipulator.canopen.link import BusSettings, check_link, open_bus
from facade_manipulator.errors import BusError

MEGABIT = 1_000_000


class FailingBus(can.BusABC):
    """A bus whose every call fails in the same way."""

    def __init__(self, error: Exception) -> None:
        super().__init__('failing')
        self.channel_info = 'can9'
        self.error = error

    def _recv_internal(self, timeout):
        raise self.error

    def send(self, msg, timeout=None):
        raise self.error

    def shutdown(self):
        super().shutdown()
        raise self.error


@pytest.fixture
def pair(request):
    ends = [can.Bus(interface='virtual', channel=request.node.name, ignore_config=True)
            for _ in range(2)]
    bus = CanBus(ends[0])
    yield bus, ends[1]
    bus.close()
    ends[1].shutdown()


# --- receiving and sending

@pytest.mark.parametrize('details', [
    {'is_extended_id': True}, {'is_remote_frame': True, 'is_extended_id': False},
    {'is_fd': True, 'is_extended_id': False}])
def test_frames_of_another_kind_are_counted_and_dropped(pair, details):
    bus, other = pair
    other.send(can.Message(arbitration_id=0x181, **details))
    assert bus.receive(1.0) is None
    assert bus.statistics.ignored == 1
    assert bus.statistics.received == 0


def test_a_sent_frame_is_a_standard_data_frame(pair):
    bus, other = pair
    bus.send(0x77F, b'\x05')
    message = other.recv(1.0)
    assert (message.arbitration_id, bytes(message.data)) == (0x77F, b'\x05')
    assert not (message.is_extended_id or message.is_remote_frame)
    assert bus.statistics.sent == 1


def test_what_a_simulated_drive_sends_is_as_old_as_it_says_an_error_frame_included(request):
    with (can.Bus(interface='virtual', channel=request.node.name, ignore_config=True) as one,
          can.Bus(interface='virtual', channel=request.node.name, ignore_config=True) as other):
        sender, receiver, then = can_bus(one), can_bus(other), time.monotonic() - 0.4
        sender.send(0x182, b'ab', sampled=then)
        assert receiver.receive(1.0).time == pytest.approx(then, abs=0.05)
        sender.send(ERROR_FRAME | 0x200, b'ab')
        assert receiver.receive(1.0) is None and receiver.statistics.error_frames == 1


def test_sync_is_a_frame_of_the_kernels_until_it_is_stopped():
    asked, stopped = [], []
    bus = CanBus(SimpleNamespace(
        channel_info='can9', shutdown=lambda: None, send_periodic=lambda message, period: (
            asked.append((message, period)), SimpleNamespace(stop=lambda: stopped.append(1)))[1]))
    bus.start_sync(0.01)
    (message, period), = asked
    assert (message.arbitration_id, bytes(message.data), period) == (0x080, b'', 0.01)
    assert not message.is_extended_id and not stopped
    for _ in range(2):
        bus.stop_sync()
    bus.close()
    assert len(stopped) == 1


def test_a_time_stamp_of_a_clock_that_was_set_does_not_move_the_frame(pair):
    bus, other = pair
    for stamp in (time.time() + 3600.0, time.time() - 3600.0):
        other.preserve_timestamps = True
        other.send(can.Message(arbitration_id=1, is_extended_id=False, timestamp=stamp))
        before = time.monotonic()
        assert before <= bus.receive(1.0).time <= time.monotonic()


@pytest.mark.parametrize(('age', 'is_kept'), [(0.5, True), (8.0, True), (12.0, False)])
def test_a_frame_that_waited_keeps_its_age_unless_no_frame_waits_so_long(pair, age, is_kept):
    bus, other = pair
    other.preserve_timestamps = True
    other.send(can.Message(arbitration_id=1, is_extended_id=False, timestamp=time.time() - age))
    assert (time.monotonic() - bus.receive(1.0).time > 0.9 * age) == is_kept


def test_a_system_clock_that_is_set_back_makes_no_wait_longer(monkeypatch):
    waits = []

    class SilentBus(FailingBus):
        def _recv_internal(self, timeout):
            waits.append(timeout)
            assert len(waits) == 1, 'waited again'
            return None, True

    bus = CanBus(SilentBus(OSError()))
    monkeypatch.setattr(can.bus, 'time', lambda: -3600.0 * len(waits))
    assert bus.receive(0.05) is None and waits == [0.05]
    bus.close()


# --- trouble

@pytest.mark.parametrize('error', [
    can.CanOperationError('Failed to transmit', errno.ENOBUFS),
    can.CanOperationError('Transmit buffer full'),
    BlockingIOError(errno.EAGAIN, 'Resource temporarily unavailable')])
def test_a_full_queue_is_told_from_a_lost_bus(error):
    with pytest.raises(BusCongestedError, match='no node acknowledges'):
        CanBus(FailingBus(error)).send(0x80)


@pytest.mark.parametrize('error', [
    can.CanOperationError('down', errno.ENETDOWN), OSError(errno.ENODEV, 'No such device'),
    ValueError('file descriptor cannot be a negative integer (-1)')])
def test_a_lost_interface_is_a_bus_error_on_both_ways(error):
    bus = CanBus(FailingBus(error))
    with pytest.raises(BusError, match='can9') as caught:
        bus.send(0x80)
    assert not isinstance(caught.value, BusCongestedError)
    with pytest.raises(BusError, match='can9'):
        bus.receive(0.0)
    bus.close()


def test_a_closed_bus_is_a_bus_error_and_closing_twice_is_harmless(pair):
    bus, _ = pair
    bus.close()
    bus.close()
    with pytest.raises(BusError):
        bus.send(0x80)
    with pytest.raises(BusError):
        bus.receive(0.0)


def error_frame(error_class: int, data: bytes = bytes(8)) -> can.Message:
    return can.Message(
        arbitration_id=error_class, data=data, is_error_frame=True, is_extended_id=False)


def test_an_error_frame_that_says_bus_off_is_a_bus_error(pair):
    bus, other = pair
    other.send(error_frame(0x040))
    with pytest.raises(BusError, match='bus-off'):
        bus.receive(1.0)
    assert bus.statistics.condition is Condition.OFF


@pytest.mark.parametrize(('bits', 'condition'), [
    (0x10, Condition.PASSIVE), (0x20, Condition.PASSIVE), (0x08, Condition.WARNING),
    (0x04, Condition.WARNING), (0x40, Condition.ACTIVE)])
def test_error_frames_tell_the_condition_of_the_controller(pair, bits, condition):
    bus, other = pair
    other.send(error_frame(0x004, bytes([0, bits, 0, 0, 0, 0, 0, 0])))
    assert bus.receive(1.0) is None
    assert bus.statistics.condition is condition
    assert bus.statistics.error_frames == 1


@pytest.mark.parametrize(('error_class', 'data', 'count'), [
    (0x004, bytes([0, 0x01, 0, 0, 0, 0, 0, 0]), 1), (0x004, b'', 0), (0x200, bytes([0, 0x01]), 0)])
def test_an_overflow_is_counted(pair, error_class, data, count):
    bus, other = pair
    other.send(error_frame(error_class, data))
    bus.receive(1.0)
    assert bus.statistics.overflows == count


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8))
def test_any_error_frame_has_a_meaning_or_none(cob_id, data):
    condition = condition_of(cob_id, data)
    assert condition is None or isinstance(condition, Condition)
    assert (condition is Condition.OFF) == bool(cob_id & 0x040)


# --- the interface

GOOD = {'state': 'ERROR-ACTIVE', 'bittiming': {'bitrate': MEGABIT}}


@pytest.fixture
def interface(tmp_path, monkeypatch):
    """Make can0 of /sys with its flags and what iproute2 says about it."""
    def make(flags, details):
        (tmp_path / 'can0').mkdir()
        (tmp_path / 'can0/flags').write_text(f'{flags}\n')
        monkeypatch.setattr(link, '_details', lambda channel: details)
    monkeypatch.setattr(link, '_SYSTEM', tmp_path)
    return make


@pytest.mark.parametrize(('tool', 'found'), [
    ('echo \'[{"linkinfo": {"info_data": {"state": "STOPPED"}}}]\'', {'state': 'STOPPED'}),
    ('echo \'[{"linkinfo": {"info_data": {"state": "STOPPED"}}}]\'; exit 1', {}),
    ('echo "[{}]"', {}), ('echo "[]"', {}), ('echo words', {}), (None, {})])
def test_of_the_controller_it_is_known_what_iproute2_says(tmp_path, monkeypatch, tool, found):
    if tool is not None:
        (tmp_path / 'ip').write_text(
            f'#!/bin/sh\n[ "$*" = "-json -details link show dev can7" ] || exit 1\n{tool}\n')
        (tmp_path / 'ip').chmod(0o755)
    monkeypatch.setenv('PATH', str(tmp_path))
    assert link._details('can7') == found


@pytest.mark.parametrize('details', [GOOD, {}], ids=['our bit rate', 'no bit rate'])
def test_an_interface_that_is_up_is_accepted(interface, details):
    interface('0x1', details)
    check_link('can0', MEGABIT)


@pytest.mark.parametrize(('channel', 'flags', 'change', 'message'), [
    ('can7', '0x1', {}, 'no CAN interface can7'),
    ('can0', '0x0', {}, 'sudo ip link set can0 up type can bitrate 1000000'),
    ('can0', '0x1', {'bittiming': {'bitrate': 500_000}}, '500000 bit/s, not at 1000000 bit/s'),
    ('can0', '0x1', {'state': 'BUS-OFF'}, 'BUS-OFF.*sudo ip link set can0 type can restart'),
    ('can0', '0x1', {'state': 'STOPPED'}, 'can0 down && sudo ip link set can0 up')])
def test_an_interface_that_will_not_do_is_named_with_the_reason(
        interface, channel, flags, change, message):
    interface(flags, GOOD | change)
    with pytest.raises(BusError, match=message):
        check_link(channel, MEGABIT)
    assert not link.is_up('can7')


def test_an_interface_that_others_bring_up_is_missing_until_then(interface, tmp_path):
    bus = BusSettings(interface='socketcan', channel='can0')
    assert bus.missing() == 'the CAN interface can0 is not there or down'
    interface('0x80', {})
    assert bus.missing()
    (tmp_path / 'can0/flags').write_text('0x81\n')
    assert not bus.missing() and not BusSettings(interface='virtual').missing()
    assert str(bus) == 'socketcan can0' and 'no drive outside' in str(BusSettings())


def test_can_configuration_of_the_user_is_ignored(tmp_path, monkeypatch):
    (tmp_path / 'can.conf').write_text('[default]\nreceive_own_messages = True\n')
    monkeypatch.setenv('HOME', str(tmp_path))
    with open_bus(BusSettings(channel=tmp_path.name)) as bus:
        bus.send(can.Message(arbitration_id=1, is_extended_id=False))
        assert bus.recv(0.0) is None


def test_a_bus_that_cannot_be_opened_is_a_bus_error():
    with pytest.raises(BusError, match='no CAN interface nowhere0'):
        open_bus(BusSettings(interface='socketcan', channel='nowhere0'))
    with pytest.raises(BusError, match='cannot be opened'):
        open_bus(BusSettings(interface='no_such_kind'))
