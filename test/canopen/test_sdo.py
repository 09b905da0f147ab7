"""SDO client with a drive whose answers are a script, in simulated time."""

from collections.abc import Callable
import itertools
import re
from typing import Any

import pytest
from steps import result_of

from facade_manipulator.canopen.bus import Frame
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.sdo import (
    expedited_number,
    is_write,
    SdoAbortError,
    SdoChannel,
    Steps,
)
from facade_manipulator.errors import DriveTimeoutError

NODE = 2
REQUEST = 0x602
ANSWER = 0x582
ABORT = 0x80
VALUE = bytes.fromhex('4365600080430000')  # 6065h:00 = 17280
WRITTEN = bytes.fromhex('6065600000000000')
ABSENT = bytes.fromhex('8065600000000206')
OTHER = bytes.fromhex('4300100092010200')


class ScriptedDrive(Clock):
    """Bus with one drive, and a clock that passes the time of a missing answer at once."""

    def __init__(self, answer: Callable[[bytes], tuple[bytes, ...]]) -> None:
        self.answer = answer
        self.requests: list[bytes] = []  #: without aborts
        self.waits = 0  #: number of times that the client has waited
        self.channel = SdoChannel(self, NODE, 'q2', None, self)
        self._now = 0.0

    def monotonic(self) -> float:
        self._now += 0.001
        return self._now

    def send(self, cob_id: int, data: bytes) -> None:
        assert cob_id == REQUEST
        assert len(data) == 8
        if data[0] != ABORT:
            self.requests.append(data)
            self.feed(*self.answer(data))

    def feed(self, *frames: bytes) -> None:
        for data in frames:
            self.channel.receive(Frame(ANSWER, data, 0.0, 0.0))

    def _time_out(self) -> None:
        self.waits += 1
        self._now += 0.5

    def read(self) -> int:
        return self.finish(self.channel.read_number(0x6065))

    def write(self, data: bytes) -> None:
        self.finish(self.channel.write(0x6065, 0, data))

    def finish(self, steps: Steps[Any]) -> Any:
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
    assert caught.value.is_absent
    assert len(drive.requests) == 1


@pytest.mark.parametrize(
    ('code', 'is_absent'),
    [
        (0x06020000, True),  # CiA 301: the object does not exist
        (0x06090011, True),  # CiA 301: the subindex does not exist
        (0x06010000, False),  # CiA 301: unsupported access
    ],
)
def test_abort_code_tells_whether_the_object_is_absent(code, is_absent):
    abort = ABSENT[:4] + code.to_bytes(4, 'little')
    drive = ScriptedDrive(lambda data: (abort,))
    with pytest.raises(SdoAbortError) as caught:
        drive.read()
    assert caught.value.is_absent is is_absent


@pytest.mark.parametrize(
    ('first', 'begins_write'),
    [
        (0x23, True),  # expedited download
        (0x21, True),  # segmented download
        (0xC6, True),  # block download
        (0x40, False),  # upload
        (0x60, False),  # segment of an upload
        (0x80, False),  # abort
        (0xA4, False),  # block upload
    ],
)
def test_download_request_of_cia_301_begins_a_write(first, begins_write):
    assert is_write(bytes([first, 0x65, 0x60, 0, 0, 0, 0, 0])) is begins_write


def test_request_without_data_begins_no_write():
    assert not is_write(b'')


@pytest.mark.parametrize(
    'frames',
    [(), (OTHER,), (OTHER, VALUE), (b'', VALUE), (b'\x43', VALUE), (VALUE[:7], VALUE)],
)
def test_wrong_answer_is_ignored_or_request_is_repeated(frames):
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


def test_answer_with_a_size_contains_no_number():
    """The serial number follows in segments; 4 is its size."""
    assert expedited_number(bytes.fromhex('4118100404000000')) is None


@pytest.mark.parametrize('answer', ['60656000', '6065600000', '6F656000ABABABAB'])
def test_short_confirmation_of_a_write_is_used(answer):
    drive = ScriptedDrive(lambda data: (bytes.fromhex(answer),))
    drive.write(bytes(4))
    assert len(drive.requests) == 1


@pytest.mark.parametrize('answer', ['43', '4365', '43656000804300', '80656000'])
def test_answer_without_its_value_is_reported_as_short(answer):
    data = bytes.fromhex(answer)
    drive = ScriptedDrive(lambda _: (data,))
    with pytest.raises(
        DriveTimeoutError, match=f'object 6065h:00 with {len(data)} bytes, which is too'
    ):
        drive.read()


def test_unexpected_answers_do_not_accumulate():
    drive = ScriptedDrive(lambda data: (VALUE,) * 200)
    drive.feed(*[VALUE] * 200)
    assert drive.read() == 17280
    assert drive.waits == 0
    assert len(drive.requests) == 1


def test_endless_segments_time_out():
    begin = bytes.fromhex('4065600000000000')
    without_end = itertools.cycle((bytes(8), b'\x10' + bytes(7)))
    segments = itertools.chain([begin], without_end)
    drive = ScriptedDrive(lambda data: (next(segments),))
    drive.channel.deadline = 0.2
    with pytest.raises(
        DriveTimeoutError,
        match='busy with object 6065h:00 .*the transfer does not end; next: ',
    ):
        drive.read()
    assert len(drive.requests) > 10


# --- transcripts: requests and answers byte by byte


class Transcript(ScriptedDrive):
    """
    Drive that expects the requests of a transcript, and gives its answers.

    Lines begin with ``>`` for a request and ``<`` for an answer, in hexadecimal. Aborts of the
    client are requests. The clock passes the time of an answer that is missing.
    """

    def __init__(self, text: str) -> None:
        self._lines = []
        for line in text.strip().splitlines():
            frame = line.strip()
            self._lines.append((frame[0], bytes.fromhex(frame[1:])))
        super().__init__(lambda _: ())

    def send(self, cob_id: int, data: bytes) -> None:
        assert cob_id == REQUEST
        assert self._lines, f'not expected: {data.hex(" ")}'
        direction, expected = self._lines.pop(0)
        assert direction == '>'
        assert data.hex(' ') == expected.hex(' ')
        while self._lines and self._lines[0][0] == '<':
            self.feed(self._lines.pop(0)[1])

    @property
    def is_complete(self) -> bool:
        """Return whether each line of the transcript has happened."""
        return not self._lines


UPLOADS = {
    'expedited': (
        """
        > 40 65 60 00 00 00 00 00
        < 43 65 60 00 80 43 00 00
        """,
        '80 43 00 00',
    ),
    'expedited, two bytes': (
        """
        > 40 65 60 00 00 00 00 00
        < 4B 65 60 00 80 43 FF FF
        """,
        '80 43',
    ),
    'without a size': (
        """
        > 40 65 60 00 00 00 00 00
        < 42 65 60 00 80 43 00 00
        """,
        '80 43 00 00',
    ),
    'short answer': (
        """
        > 40 65 60 00 00 00 00 00
        < 4B 65 60 00 80 43
        """,
        '80 43',
    ),
    'segmented': (
        """
        > 40 65 60 00 00 00 00 00
        < 41 65 60 00 10 00 00 00
        > 60 00 00 00 00 00 00 00
        < 00 61 61 61 61 61 61 61
        > 70 00 00 00 00 00 00 00
        < 10 62 62 62 62 62 62 62
        > 60 00 00 00 00 00 00 00
        < 0B 63 63 00 00 00 00 00
        """,
        '61 61 61 61 61 61 61 62 62 62 62 62 62 62 63 63',
    ),
    'segmented, last segment short': (
        """
        > 40 65 60 00 00 00 00 00
        < 41 65 60 00 09 00 00 00
        > 60 00 00 00 00 00 00 00
        < 00 61 61 61 61 61 61 61
        > 70 00 00 00 00 00 00 00
        < 1B 62 63
        """,
        '61 61 61 61 61 61 61 62 63',
    ),
    'segmented, only segment short': (
        """
        > 40 65 60 00 00 00 00 00
        < 41 65 60 00 02 00 00 00
        > 60 00 00 00 00 00 00 00
        < 0B 62 63
        """,
        '62 63',
    ),
    'segmented without a size, last segment short': (
        """
        > 40 65 60 00 00 00 00 00
        < 40 65 60 00
        > 60 00 00 00 00 00 00 00
        < 00 61 61 61 61 61 61 61
        > 70 00 00 00 00 00 00 00
        < 1D 62
        """,
        '61 61 61 61 61 61 61 62',
    ),
    'segmented with an empty segment': (
        """
        > 40 65 60 00 00 00 00 00
        < 41 65 60 00 01 00 00 00
        > 60 00 00 00 00 00 00 00
        < 0E 00 00 00 00 00 00 00
        > 70 00 00 00 00 00 00 00
        < 1D 62 00 00 00 00 00 00
        """,
        '62',
    ),
    'wrong toggle bit': (
        """
        > 40 65 60 00 00 00 00 00
        < 41 65 60 00 01 00 00 00
        > 60 00 00 00 00 00 00 00
        < 1D 61 00 00 00 00 00 00
        > 80 00 00 00 00 00 03 05
        > 40 65 60 00 00 00 00 00
        < 43 65 60 00 80 43 00 00
        """,
        '80 43 00 00',
    ),
    'silence at first': (
        """
        > 40 65 60 00 00 00 00 00
        > 80 00 00 00 00 00 04 05
        > 40 65 60 00 00 00 00 00
        < 43 65 60 00 80 43 00 00
        """,
        '80 43 00 00',
    ),
    'late answer for another object': (
        """
        > 40 65 60 00 00 00 00 00
        < 43 00 10 00 92 01 02 00
        < 43 65 60 00 80 43 00 00
        """,
        '80 43 00 00',
    ),
    'late abort for another object': (
        """
        > 40 65 60 00 00 00 00 00
        < 80 00 10 00 00 00 02 06
        < 43 65 60 00 80 43 00 00
        """,
        '80 43 00 00',
    ),
    'late confirmation of a write to this object': (
        """
        > 40 65 60 00 00 00 00 00
        < 60 65 60 00 00 00 00 00
        > 80 00 00 00 01 00 04 05
        > 40 65 60 00 00 00 00 00
        < 43 65 60 00 80 43 00 00
        """,
        '80 43 00 00',
    ),
}


@pytest.mark.parametrize('name', UPLOADS)
def test_upload_follows_its_transcript(name):
    text, value = UPLOADS[name]
    drive = Transcript(text)
    found = drive.finish(drive.channel.read(0x6065, 0))
    assert found == bytes.fromhex(value)
    assert drive.is_complete


DOWNLOADS = {
    'expedited': (
        """
        > 23 65 60 00 80 43 00 00
        < 60 65 60 00 00 00 00 00
        """,
        '80 43 00 00',
    ),
    'expedited, one byte': (
        """
        > 2F 65 60 00 05 00 00 00
        < 60 65 60 00
        """,
        '05',
    ),
    'segmented': (
        """
        > 21 65 60 00 09 00 00 00
        < 60 65 60 00 00 00 00 00
        > 00 61 61 61 61 61 61 61
        < 20 00 00 00 00 00 00 00
        > 1B 62 62 00 00 00 00 00
        < 30 00 00 00 00 00 00 00
        """,
        '61 61 61 61 61 61 61 62 62',
    ),
    'segmented, whole segments': (
        """
        > 21 65 60 00 07 00 00 00
        < 60 65 60 00 00 00 00 00
        > 01 61 61 61 61 61 61 61
        < 20
        """,
        '61 61 61 61 61 61 61',
    ),
    'empty': (
        """
        > 21 65 60 00 00 00 00 00
        < 60 65 60 00 00 00 00 00
        > 0F 00 00 00 00 00 00 00
        < 20 00 00 00 00 00 00 00
        """,
        '',
    ),
    'foreign confirmation of a segment': (
        """
        > 21 65 60 00 05 00 00 00
        < 60 65 60 00 00 00 00 00
        > 05 61 61 61 61 61 00 00
        < 43 00 10 00 92 01 02 00
        > 80 00 00 00 01 00 04 05
        > 21 65 60 00 05 00 00 00
        < 60 65 60 00 00 00 00 00
        > 05 61 61 61 61 61 00 00
        < 20 00 00 00 00 00 00 00
        """,
        '61 61 61 61 61',
    ),
}


@pytest.mark.parametrize('name', DOWNLOADS)
def test_download_follows_its_transcript(name):
    text, value = DOWNLOADS[name]
    drive = Transcript(text)
    drive.finish(drive.channel.write(0x6065, 0, bytes.fromhex(value)))
    assert drive.is_complete


def test_abort_within_segments_ends_the_transfer():
    drive = Transcript(
        """
        > 40 65 60 00 00 00 00 00
        < 41 65 60 00 09 00 00 00
        > 60 00 00 00 00 00 00 00
        < 80 65 60 00 00 00 00 08
        """
    )
    with pytest.raises(SdoAbortError, match=r'general error \(abort 0800 0000h\)'):
        drive.finish(drive.channel.read(0x6065, 0))
    assert drive.is_complete


def test_silence_is_aborted_after_each_of_three_attempts():
    attempt = '> 40 65 60 00 00 00 00 00\n> 80 00 00 00 00 00 04 05\n'
    drive = Transcript(3 * attempt)
    message = (
        r'does not answer for object 6065h:00 within 3 × 0\.3 s; next: check its '
        'power, its node id and the bit rate'
    )
    with pytest.raises(DriveTimeoutError, match=message):
        drive.finish(drive.channel.read(0x6065, 0))
    assert drive.is_complete


@pytest.mark.parametrize(
    ('answers', 'wrong'),
    [
        (('60 65 60 00 05 00 00 00',), 'an unexpected command (60h)'),
        (
            ('41 65 60 00 04 00 00 00', '11 05 00 00 00 00 00 00'),
            'a wrong toggle bit (11h)',
        ),
    ],
)
def test_wrong_answer_in_each_attempt_names_its_cause(answers, wrong):
    script = itertools.cycle([bytes.fromhex(one) for one in answers])
    drive = ScriptedDrive(lambda _: (next(script),))
    message = (
        f'q2 (node 2) answers for object 6065h:00 with {wrong}; next: check that no other '
        'drive has this node id, and that no other program uses the bus'
    )
    with pytest.raises(DriveTimeoutError, match=re.escape(message)):
        drive.read()
    assert drive.waits == 0


@pytest.mark.parametrize(
    ('answer', 'value'),
    [
        ('43 65 60 00 05 00 00 00', '05 00'),  # four bytes of an object of two
        ('4F 65 60 00 05 00 00 00', '05'),
        ('42 65 60 00 05 00 00 00', '05 00'),  # without a size
    ],
)
def test_value_is_truncated_to_the_size_in_the_eds(answer, value):
    drive = ScriptedDrive(lambda _: (bytes.fromhex(answer),))
    drive.channel.size = lambda *_: 2
    found = drive.finish(drive.channel.read(0x6065, 0))
    assert found == bytes.fromhex(value)


def test_answer_of_a_closed_transfer_is_not_used():
    drive = ScriptedDrive(lambda _: ())
    closed = drive.channel.read(0x1000, 0)
    next(closed)
    closed.close()
    steps = drive.channel.read(0x6065, 0)
    next(steps)
    drive.feed(OTHER)
    next(steps)
    drive.feed(VALUE)
    assert result_of(steps) == VALUE[4:]


def test_client_waits_without_an_answer_until_its_timeout():
    drive = ScriptedDrive(lambda _: ())
    steps = drive.channel.read(0x6065, 0)
    for _ in range(100):  # the clock passes 1 ms at each look
        next(steps)
    assert len(drive.requests) == 1
    for _ in range(300):
        next(steps)
    assert len(drive.requests) == 2
