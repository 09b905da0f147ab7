"""SDO client with a drive whose answers are a script, in simulated time."""

from collections.abc import Callable
import itertools

import pytest
from steps import result_of

from facade_manipulator.canopen.bus import Frame
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.sdo import SdoAbortError, SdoChannel
from facade_manipulator.errors import DriveTimeoutError

NODE = 2
REQUEST, ANSWER = 0x602, 0x582
ABORT = 0x80
VALUE = bytes.fromhex('4365600080430000')  # 6065h:00 = 17280
WRITTEN = bytes.fromhex('6065600000000000')
ABSENT = bytes.fromhex('8065600000000206')
OTHER = bytes.fromhex('4300100092010200')


class ScriptedDrive(Clock):
    """Bus with one drive, and a clock that passes the time of a missing answer at once."""

    def __init__(self, answer: Callable[[bytes], tuple[bytes, ...]]) -> None:
        self.answer, self.requests = answer, []
        self.channel = SdoChannel(self, NODE, 'q2', None, self)
        self._now = 0.0

    def monotonic(self) -> float:
        self._now += 0.001
        return self._now

    def _time_out(self) -> None:
        self._now += 0.5

    def wait(self, event, timeout) -> bool:
        return event.is_set()

    def send(self, cob_id: int, data: bytes) -> None:
        assert cob_id == REQUEST
        if data[0] != ABORT:
            self.requests.append(data)
            self.feed(*self.answer(data))

    def feed(self, *frames: bytes) -> None:
        for data in frames:
            self.channel.receive(Frame(ANSWER, data, 0.0, 0.0))

    def read(self) -> int:
        return self.finish(self.channel.read_number(0x6065))

    def write(self, data: bytes) -> None:
        self.finish(self.channel.write(0x6065, 0, data))

    def finish(self, steps):
        return result_of(steps, self._time_out)


def test_object_is_read_and_written_by_expedited_transfers():
    drive = ScriptedDrive(lambda data: (VALUE if data[0] == 0x40 else WRITTEN,))
    assert drive.read() == 17280
    drive.write((5).to_bytes(4, 'little'))
    assert drive.requests == [
        bytes.fromhex('4065600000000000'),
        bytes.fromhex('2365600005000000'),
    ]
    assert drive.channel.size(0x6065, 0) is None  # there is no EDS


def test_abort_is_raised_with_its_code_at_once():
    drive = ScriptedDrive(lambda data: (ABSENT,))
    with pytest.raises(
        SdoAbortError,
        match=r'q2 \(node 2\) rejects object 6065h:00: object does '
        r'not exist \(abort 0602 0000h\)',
    ) as caught:
        drive.read()
    assert caught.value.is_absent and len(drive.requests) == 1


@pytest.mark.parametrize(
    'frames',
    [(), (OTHER,), (OTHER, VALUE), (b'', VALUE), (b'\x43', VALUE), (VALUE[:7], VALUE)],
)
def test_wrong_answer_is_ignored_or_repeats_the_request(frames):
    script = iter([frames, (VALUE,)])
    drive = ScriptedDrive(lambda data: next(script))
    assert drive.read() == 17280
    assert len(drive.requests) == (1 if VALUE in frames else 2)


@pytest.mark.parametrize(
    ('answer', 'size', 'value'),
    [
        ('4365600080430000', 4, 17280),
        ('4F65600005', 4, 5),  # one byte, the others are omitted
        ('4B6560000500', 4, 5),
        ('426560000500', 2, 5),  # without a size
        ('5365600080430000', 4, 17280),  # with a reserved bit
    ],
)
def test_short_answer_with_its_value_is_used(answer, size, value):
    drive = ScriptedDrive(lambda data: (bytes.fromhex(answer),))
    drive.channel.size = lambda *_: size
    assert drive.read() == value


@pytest.mark.parametrize('answer', ['60656000', '6065600000', '6F656000ABABABAB'])
def test_short_confirmation_of_a_write_is_used(answer):
    drive = ScriptedDrive(lambda data: (bytes.fromhex(answer),))
    drive.write(bytes(4))
    assert len(drive.requests) == 1


def test_short_segments_are_used():
    answers = iter(['4165600009000000', '00' + '61' * 7, '1B6263'])
    drive = ScriptedDrive(lambda data: (bytes.fromhex(next(answers)),))
    assert drive.finish(drive.channel.read(0x6065, 0)) == b'a' * 7 + b'bc'


@pytest.mark.parametrize('answer', ['43', '4365', '43656000804300', '80656000'])
def test_answer_without_its_value_is_reported_as_short(answer):
    data = bytes.fromhex(answer)
    drive = ScriptedDrive(lambda _: (data,))
    with pytest.raises(
        DriveTimeoutError, match=f'object 6065h:00 with {len(data)} bytes, which is too'
    ):
        drive.read()


def test_silent_drive_times_out_with_a_next_step():
    drive = ScriptedDrive(lambda data: ())
    with pytest.raises(
        DriveTimeoutError, match='does not answer for object 6065h:00 within 3 ×'
    ):
        drive.read()
    assert len(drive.requests) == 3


def test_unexpected_answers_do_not_accumulate():
    drive = ScriptedDrive(lambda data: (VALUE,) * 200)
    drive.feed(*[VALUE] * 200)
    assert drive.read() == 17280
    if hasattr(drive.channel, 'responses'):
        assert drive.channel.responses.qsize() <= 1


def test_endless_segments_time_out():
    segments = itertools.chain(
        [bytes.fromhex('4065600000000000')],
        itertools.cycle((bytes(8), b'\x10' + bytes(7))),
    )
    drive = ScriptedDrive(lambda data: (next(segments),))
    drive.channel.deadline = 0.2
    with pytest.raises(
        DriveTimeoutError, match='busy with object 6065h:00 .*without an end'
    ):
        drive.read()
    assert len(drive.requests) > 10
