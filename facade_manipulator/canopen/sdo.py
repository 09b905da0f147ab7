"""
SDO client (CiA 301) on a `CanBus` as generator steps: the client never waits by itself.

`SdoChannel.read` and `SdoChannel.write` are generators. Each sends a request and yields until
`SdoChannel.receive` has the answer, or until the answer times out. The owner of the bus passes on
the answers. The owner resumes the generator after each answer, and often enough to detect
time-outs.

References
----------
CiA 301: service data objects; upload, download and abort, expedited and segmented.

"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from functools import lru_cache, partial
import math
from pathlib import Path
import struct
from typing import NamedTuple, TypeVar

from canopen import ObjectDictionary, SdoAbortedError

from facade_manipulator.canopen import cob_ids
from facade_manipulator.canopen.bus import CanBus, Frame
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.eds import read_dictionary
from facade_manipulator.errors import DriveObjectError, DriveTimeoutError
from facade_manipulator.timeouts import ATTEMPTS, RESPONSE_TIMEOUT

SDO_FRAME_LENGTH = 8
ALL_BITS = 0xFFFFFFFF

Result = TypeVar('Result')
#: generator that yields while it must wait, and returns its result
Steps = Generator[None, None, Result]

# first bytes of the requests of a client
_UPLOAD_REQUEST = 0x40
_UPLOAD_SEGMENT_REQUEST = 0x60
_SEGMENTED_DOWNLOAD_REQUEST = 0x21  # with the size of the object
_ABORT_REQUEST = 0x80
# command specifiers, bits 7 to 5: download, block download
_WRITE_REQUESTS = frozenset({1, 6})
# bits of the first byte of a segment
_TOGGLE = 0x10
_IS_LAST = 0x01
_SEGMENT_LENGTH = 7  # bytes of data in a segment
# abort codes of this client
_TOGGLE_ERROR = 0x05030000
_TIMED_OUT = 0x05040000
_UNKNOWN_COMMAND = 0x05040001


class Write(NamedTuple):
    """Write of one object, with a mask of the bits that must be read back."""

    index: int  # type: ignore[assignment]  # hides tuple.index
    subindex: int
    value: int
    #: bytes; None for the size in the drive's object dictionary
    size: int | None = None
    required: bool = True  #: whether a drive without the object is rejected
    #: mask of the bits that must be read back as written; 0: the object is not read back
    read_back: int = ALL_BITS

    def __str__(self) -> str:
        return f'{self.index:04X}h:{self.subindex:02X}'


def expedited_download(index: int, subindex: int, data: bytes) -> bytes:
    """Return the frame that writes an object of at most four bytes (CiA 301, SDO download)."""
    # bits 2 and 3: how many of four bytes are unused
    specifier = 0x23 | (4 - len(data)) << 2
    return struct.pack('<BHB4s', specifier, index, subindex, data)


def upload_request(index: int, subindex: int) -> bytes:
    """Return the frame that reads an object (CiA 301, SDO upload)."""
    return struct.pack('<BHB4x', _UPLOAD_REQUEST, index, subindex)


def is_write(request: bytes) -> bool:
    """Return whether a request begins a write, either expedited, segmented or in blocks."""
    # servers ignore a request without a command
    return bool(request) and request[0] >> 5 in _WRITE_REQUESTS


# server command specifiers, bits 7 to 5 of the first byte of an answer (CiA 301)
_UPLOADED_SEGMENT, _DOWNLOADED_SEGMENT, _UPLOAD, _DOWNLOAD, _ABORT = range(5)
# the bits of the first byte that are not reserved
_USED_COMMAND_BITS = {
    _UPLOADED_SEGMENT: 0xFF,
    _DOWNLOADED_SEGMENT: 0xF0,
    _UPLOAD: 0xEF,
    _DOWNLOAD: 0xE0,
    _ABORT: 0xE0,
}
# bits of the answer that begins an upload
_EXPEDITED = 0x02
_HAS_SIZE = 0x01


def complete_answer(data: bytes, size: int = 4) -> bytes | None:
    """
    Return an answer padded to eight bytes, with its reserved bits cleared.

    CiA 301 gives an SDO frame eight bytes, but some drives omit the bytes that are not used.
    `size` is the size of the object in an upload without a size [bytes]. Return None if the
    answer lacks used bytes.
    """
    if not data:
        return None
    first = data[0]
    specifier = first >> 5
    used = {
        _UPLOADED_SEGMENT: 8 - (first >> 1 & 7),
        _DOWNLOADED_SEGMENT: 1,
        _DOWNLOAD: 4,
    }.get(specifier, SDO_FRAME_LENGTH)
    if specifier == _UPLOAD and first & _EXPEDITED:
        unused = first >> 2 & 3
        used = 4 + (4 - unused if first & _HAS_SIZE else size)
    elif specifier == _UPLOAD and not first & _HAS_SIZE:
        used = 4
    if len(data) < min(used, SDO_FRAME_LENGTH):
        return None
    first &= _USED_COMMAND_BITS.get(specifier, 0xFF)
    return (bytes([first]) + data[1:]).ljust(SDO_FRAME_LENGTH, b'\0')


def expedited_number(answer: bytes) -> int | None:
    """Return the number in an expedited answer; None for any other answer."""
    first = answer[0]
    if first >> 5 != _UPLOAD or not first & _EXPEDITED:
        return None
    return int.from_bytes(answer[4:], 'little')


class SdoAbortError(DriveObjectError):
    """A drive aborted the transfer of an object; the message contains the SDO abort code."""

    next_step = 'switch the drive off and on, and compare its profile with its manual'
    NO_SUCH_OBJECT = frozenset({0x06020000, 0x06090011})

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        #: whether the drive lacks the object
        self.is_absent = code in self.NO_SUCH_OBJECT


class _AttemptError(Exception):
    """The answer to a request is missing or has an unexpected command; retry the transfer."""


@dataclass
class _Transfer:
    """Transfer of one object, with the answer to the present request."""

    index: int
    subindex: int
    size: int | None  #: of the object in the EDS [bytes]
    #: index and subindex of the awaited answer; the answer to a segment has none
    expected: bytes = b''
    answer: bytes | None = None
    short_length: int | None = None  #: of an answer that lacks its value [bytes]
    wrong: str = ''  #: description of an answer that does not fit to its request

    def __str__(self) -> str:
        return f'object {self.index:04X}h:{self.subindex:02X}'

    def download_request(self, size: int) -> bytes:
        """Return the request that begins a segmented download of `size` bytes."""
        return struct.pack(
            '<BHBL', _SEGMENTED_DOWNLOAD_REQUEST, self.index, self.subindex, size
        )

    def receive(self, data: bytes) -> None:
        """Store the first answer to a request; ignore the many that a faulty drive may send."""
        answer = complete_answer(data, self.size or 4)
        if answer is None:
            if self.expected.startswith(data[1:4]):
                self.short_length = len(data)
        elif answer[1:4].startswith(self.expected) and self.answer is None:
            self.answer = answer


@lru_cache(maxsize=16)
def _dictionary(eds: Path, node_id: int) -> ObjectDictionary:
    """Return the objects of an EDS; cache them, because reading takes 40 ms."""
    return read_dictionary(eds, node_id)


class SdoChannel:
    """
    Access to the objects of one drive; its name, such as ``'q2'``, is shown to the operator.

    The EDS is the object dictionary of the drive type, with the size of each object. One transfer
    runs at a time. A transfer may be closed before its end, because the next transfer ignores
    answers for other objects.
    """

    def __init__(
        self, bus: CanBus, node_id: int, name: str, eds: Path | None, clock: Clock
    ) -> None:
        self.name = name
        self.node_id = node_id
        self.response_timeout = RESPONSE_TIMEOUT  #: longest time to an answer [s]
        #: time [s] on the monotonic clock after which no request is sent, because segments may
        #: never end
        self.deadline = math.inf
        self._bus = bus
        self._now = clock.monotonic
        self._dictionary = _dictionary(eds, node_id) if eds else ObjectDictionary()
        self._transfer: _Transfer | None = None

    def limit_time(self, deadline: float) -> None:
        """Forbid requests after a time on the monotonic clock [s]."""
        self.deadline = deadline

    def receive(self, frame: Frame) -> None:
        """
        Receive an answer of the drive.

        Answers for another object are ignored: they are late, or answers to other requests.
        """
        if self._transfer is not None:
            self._transfer.receive(frame.data)

    def read(self, index: int, subindex: int) -> Steps[bytes]:
        """
        Return the bytes of an object.

        Raises an SdoAbortError if the drive rejects the request, a DriveTimeoutError if it does
        not answer, a BusError if the bus is lost.
        """
        transfer = _Transfer(index, subindex, self.size(index, subindex))
        return (yield from self._repeat(transfer, partial(self._upload, transfer)))

    def read_number(
        self, index: int, subindex: int = 0, signed: bool = False
    ) -> Steps[int]:
        """Read an object and return its value as a number; raises as `read`."""
        data = yield from self.read(index, subindex)
        return int.from_bytes(data, 'little', signed=signed)

    def read_optional(
        self, index: int, subindex: int, signed: bool = False
    ) -> Steps[int | None]:
        """Read an object and return its value as a number; None if the drive lacks the object."""
        try:
            return (yield from self.read_number(index, subindex, signed))
        except SdoAbortError as error:
            if not error.is_absent:
                raise
        return None

    def read_informative(self, index: int, subindex: int) -> Steps[int | None]:
        """Read an object and return its value as a number; None if the drive rejects it."""
        try:
            return (yield from self.read_number(index, subindex))
        except SdoAbortError:
            return None

    def write(self, index: int, subindex: int, data: bytes) -> Steps[None]:
        """Write an object and wait until the drive confirms the write; raises as `read`."""
        transfer = _Transfer(index, subindex, self.size(index, subindex))
        yield from self._repeat(transfer, partial(self._download, transfer, data))

    def size(self, index: int, subindex: int) -> int | None:
        """Return the size of an object [bytes]; None if the EDS defines no size."""
        variable = self._dictionary.get_variable(index, subindex)
        if variable is None or not variable.fixed_size:
            return None
        return len(variable) // 8

    @property
    def title(self) -> str:
        """Return name and node id for the operator."""
        return f'{self.name} (node {self.node_id})'

    def _repeat(
        self, transfer: _Transfer, attempt: Callable[[], Steps[Result]]
    ) -> Steps[Result]:
        """Retry a transfer after a missing or foreign answer; an abort counts as an answer."""
        self._transfer = transfer
        for _ in range(ATTEMPTS):
            try:
                return (yield from attempt())
            except _AttemptError:
                continue
        if transfer.short_length is not None:
            raise DriveTimeoutError(
                f'{self.title} answers for {transfer} with {transfer.short_length} bytes, which '
                'is too short for the value; next: ask its maker for another firmware'
            )
        if transfer.wrong:
            raise DriveTimeoutError(
                f'{self.title} answers for {transfer} with {transfer.wrong}; next: check that no '
                'other drive has this node id, and that no other program uses the bus'
            )
        raise DriveTimeoutError(
            f'{self.title} does not answer for {transfer} within {ATTEMPTS} × '
            f'{self.response_timeout:g} s; next: check its power, its node id and the bit rate'
        )

    # --- transfers

    def _upload(self, transfer: _Transfer) -> Steps[bytes]:
        """Return the bytes of an object, at most as many as the EDS defines."""
        request = upload_request(transfer.index, transfer.subindex)
        answer = yield from self._ask(transfer, request, _UPLOAD)
        first = answer[0]
        size: int | None = None  # without a size in the answer
        if first & _EXPEDITED:
            if first & _HAS_SIZE:
                size = 4 - (first >> 2 & 3)
            data = answer[4:] if size is None else answer[4 : 4 + size]
        else:
            if first & _HAS_SIZE:
                size = int.from_bytes(answer[4:], 'little')
            data = yield from self._upload_segments(transfer)
        # some drives send four bytes of a smaller object
        if transfer.size is not None and (size is None or transfer.size < size):
            return data[: transfer.size]
        return data

    def _upload_segments(self, transfer: _Transfer) -> Steps[bytes]:
        """Request the segments of an upload in order; return the joined data."""
        data = b''
        toggle = 0
        while True:
            request = bytes([_UPLOAD_SEGMENT_REQUEST | toggle])
            answer = yield from self._ask(transfer, request, _UPLOADED_SEGMENT)
            first = answer[0]
            if first & _TOGGLE != toggle:
                transfer.wrong = f'a wrong toggle bit ({first:02X}h)'
                raise self._abort(transfer, _TOGGLE_ERROR)
            unused = first >> 1 & 7
            data += answer[1 : SDO_FRAME_LENGTH - unused]
            if first & _IS_LAST:
                return data
            toggle ^= _TOGGLE

    def _download(self, transfer: _Transfer, data: bytes) -> Steps[None]:
        """Write data: up to 4 bytes within the request, more bytes in subsequent segments."""
        if 1 <= len(data) <= 4:
            request = expedited_download(transfer.index, transfer.subindex, data)
            yield from self._ask(transfer, request, _DOWNLOAD)
            return
        request = transfer.download_request(len(data))
        yield from self._ask(transfer, request, _DOWNLOAD)

        toggle = 0
        for begin in range(0, max(len(data), 1), _SEGMENT_LENGTH):
            segment = data[begin : begin + _SEGMENT_LENGTH]
            first = toggle | (_SEGMENT_LENGTH - len(segment)) << 1
            if begin + _SEGMENT_LENGTH >= len(data):
                first |= _IS_LAST
            # the toggle bit of the confirmation is not required: the value is read back
            yield from self._ask(
                transfer, bytes([first]) + segment, _DOWNLOADED_SEGMENT
            )
            toggle ^= _TOGGLE

    # --- requests of a transfer

    def _ask(self, transfer: _Transfer, request: bytes, specifier: int) -> Steps[bytes]:
        """Send a request; return its eight-byte answer if the command specifier is correct."""
        begins = specifier in (_UPLOAD, _DOWNLOAD)
        transfer.expected = request[1:4] if begins else b''
        transfer.answer = None
        self._send(transfer, request)
        end = self._now() + self.response_timeout
        while transfer.answer is None:
            if self._now() >= end:
                raise self._abort(transfer, _TIMED_OUT)
            yield

        answer = transfer.answer
        found = answer[0] >> 5
        if found == _ABORT:
            raise self._rejection(transfer, int.from_bytes(answer[4:], 'little'))
        if found != specifier:
            transfer.wrong = f'an unexpected command ({answer[0]:02X}h)'
            raise self._abort(transfer, _UNKNOWN_COMMAND)
        return answer

    def _send(self, transfer: _Transfer, request: bytes) -> None:
        """Send a request of a transfer, unless the deadline has passed."""
        if self._now() > self.deadline:
            raise DriveTimeoutError(
                f'{self.title} was still busy with {transfer} at the deadline of this request: it '
                'answers too slowly, or the transfer does not end; next: switch the drive off '
                'and on, and check the bit rate'
            )
        cob_id = cob_ids.SDO_REQUEST + self.node_id
        self._bus.send(cob_id, request.ljust(SDO_FRAME_LENGTH, b'\0'))

    def _abort(self, transfer: _Transfer, code: int) -> _AttemptError:
        """Abort a transfer with an abort code; return the error of this attempt."""
        self._send(transfer, struct.pack('<B3xL', _ABORT_REQUEST, code))
        return _AttemptError(f'abort {code:08X}h')

    def _rejection(self, transfer: _Transfer, code: int) -> SdoAbortError:
        """Return the error for an abort code received from a drive."""
        meaning = SdoAbortedError.CODES.get(code, 'no further reason')
        return SdoAbortError(
            f'{self.title} rejects {transfer}: {meaning[:1].lower()}{meaning[1:]} (abort '
            f'{code >> 16:04X} {code & 0xFFFF:04X}h)',
            code,
        )
