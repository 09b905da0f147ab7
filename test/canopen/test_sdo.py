from concurrent.futures import ThreadPoolExecutor
import threading
import time

import can
import pytest

from facade_manipulator.canopen.bus import CanBus
from facade_manipulator.canopen.sdo import PumpedNetwork, SdoAbortError, SdoChannel
from facade_manipulator.errors import BusError, DriveTimeoutError
from facade_manipulator.resources import config_path

NODE = 2
REQUEST, ANSWER = 0x602, 0x582
VALUE = bytes.fromhex('4365600080430000')  # 6065h:00 = 17280
WRITTEN = bytes.fromhex('6065600000000000')
ABSENT = bytes.fromhex('8065600000000206')
OTHER = bytes.fromhex('430010009201 0200'.replace(' ', ''))


class Pump:
    """A control thread in small: receives and feeds; the test is the drive."""

    def __init__(self, channel: str) -> None:
        self.drive = can.Bus(interface='virtual', channel=channel, ignore_config=True)
        self.bus = CanBus(can.Bus(interface='virtual', channel=channel, ignore_config=True))
        self.network = PumpedNetwork(self.bus)
        self.channel = SdoChannel(self.network, NODE, 'q2')
        self.worker = ThreadPoolExecutor(1)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                frame = self.bus.receive(0.02)
            except BusError:
                return
            if frame is not None:
                self.network.feed(frame)

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self.worker.shutdown()
        self.bus.close()
        self.drive.shutdown()

    def expect(self) -> bytes:
        """Return the next SDO request that the drive gets."""
        while (message := self.drive.recv(5.0)) is not None:
            if message.arbitration_id == REQUEST:
                return bytes(message.data)
        raise AssertionError('no request')

    def answer(self, *frames: bytes) -> None:
        for data in frames:
            self.drive.send(can.Message(arbitration_id=ANSWER, data=data, is_extended_id=False))


@pytest.fixture
def pump(request):
    made = Pump(request.node.name)
    yield made
    made.close()


def test_worker_reads_an_object_while_another_thread_receives(pump):
    job = pump.worker.submit(pump.channel.read, 0x6065, 0)
    assert pump.expect()[:4] == bytes.fromhex('40656000')
    pump.answer(VALUE)
    assert int.from_bytes(job.result(5.0), 'little') == 17280


def test_worker_writes_an_object(pump):
    job = pump.worker.submit(pump.channel.write, 0x6065, 0, (5).to_bytes(4, 'little'))
    assert pump.expect() == bytes.fromhex('2365600005000000')
    pump.answer(WRITTEN)
    assert job.result(5.0) is None


def test_abort_is_raised_with_its_code_at_once(pump):
    job = pump.worker.submit(pump.channel.read, 0x6065, 0)
    pump.expect()
    pump.answer(ABSENT)
    with pytest.raises(SdoAbortError, match=r'q2 \(node 2\) rejects object 6065h:00: object does '
                                            r'not exist \(abort 0602 0000h\)') as caught:
        job.result(5.0)
    assert caught.value.is_absent


@pytest.mark.parametrize('frames', [
    (), (OTHER,), (b'', VALUE), (b'\x43', VALUE), (VALUE[:7], VALUE)])
def test_wrong_answer_is_ignored_or_repeats_the_request(pump, frames):
    job = pump.worker.submit(pump.channel.read, 0x6065, 0)
    pump.expect()
    pump.answer(*frames)
    if VALUE not in frames:
        while pump.expect()[:1] != b'\x40':  # the client aborts before it asks again
            continue
        pump.answer(VALUE)
    assert int.from_bytes(job.result(5.0), 'little') == 17280


def test_silent_drive_times_out_with_a_next_step(pump):
    job = pump.worker.submit(pump.channel.read, 0x6065, 0)
    with pytest.raises(DriveTimeoutError, match='does not answer for object 6065h:00 within 3 ×'):
        job.result(5.0)


def test_unexpected_answers_do_not_pile_up(pump):
    for _ in range(200):
        pump.answer(VALUE)
    job = pump.worker.submit(pump.channel.read, 0x6065, 0)
    pump.expect()
    pump.answer(VALUE)
    job.result(5.0)
    assert pump.channel.responses.qsize() <= 1


def test_lost_bus_ends_the_wait(pump):
    pump.bus.close()
    with pytest.raises(BusError):
        pump.worker.submit(pump.channel.read, 0x6065, 0).result(5.0)


def test_eds_has_the_size_of_an_object():
    channel = SdoChannel(PumpedNetwork(None), NODE, 'q2', config_path('drives/cia402.eds'))
    assert channel.size(0x6040, 0) == 2
    assert channel.size(0x6098, 0) == 1
    assert channel.size(0x5FFF, 0) is None


def test_endless_segments_time_out(pump):
    pump.channel.deadline = time.monotonic() + 0.2
    job = pump.worker.submit(pump.channel.read, 0x6065, 0)
    pump.expect()
    pump.answer(bytes.fromhex('4065600000000000'))  # segments follow, how many is not said
    begun, toggle = time.monotonic(), 0
    while not job.done() and time.monotonic() < begun + 5.0:
        if (request := pump.drive.recv(0.05)) is not None and request.data[0] in (0x60, 0x70):
            time.sleep(0.0005)  # that the frames need
            pump.answer(bytes([toggle]) + bytes(7))
            toggle ^= 0x10
    with pytest.raises(DriveTimeoutError, match='busy with object 6065h:00 .*without an end'):
        job.result(0.0)
