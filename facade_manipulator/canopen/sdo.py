"""
SDO on a `CanBus`: `canopen` implements the protocol, `CanBus` transfers the frames.

A worker thread reads and writes objects and waits for the answers. The control thread passes the
answers to it. An SDO call in the control thread would therefore never receive its answer.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from pathlib import Path
import struct
from threading import Event
from typing import Any

import canopen

from facade_manipulator.canopen.bus import CanBus, Frame
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.eds import read_dictionary
from facade_manipulator.canopen.pdo import SDO_REQUEST, SDO_RESPONSE
from facade_manipulator.errors import DriveObjectError, DriveTimeoutError

SDO_FRAME_LENGTH = 8
ATTEMPTS = 3
NO_SUCH_OBJECT = frozenset({0x06020000, 0x06090011})


def expedited_download(index: int, subindex: int, data: bytes) -> bytes:
    """Return the frame that writes an object of at most four bytes (CiA 301, SDO download)."""
    specifier = (
        0x23 | (4 - len(data)) << 2
    )  # bits 2 and 3: how many of four bytes are unused
    return struct.pack('<BHB4s', specifier, index, subindex, data)


# server command specifiers, bits 7 to 5 of the first byte of an answer (CiA 301)
_UPLOADED_SEGMENT, _DOWNLOADED_SEGMENT, _UPLOAD, _DOWNLOAD, _ABORT = range(5)
# the bits of the first byte that are not reserved
_USED_BITS = {
    _UPLOADED_SEGMENT: 0xFF,
    _DOWNLOADED_SEGMENT: 0xF0,
    _UPLOAD: 0xEF,
    _DOWNLOAD: 0xE0,
    _ABORT: 0xE0,
}
_EXPEDITED, _HAS_SIZE = 0x02, 0x01  # bits of the answer that begins an upload


def complete_answer(data: bytes, size: int = 4) -> bytes | None:
    """
    Return an answer with eight bytes and without reserved bits.

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
    first &= _USED_BITS.get(specifier, 0xFF)
    return (bytes([first]) + data[1:]).ljust(SDO_FRAME_LENGTH, b'\0')


class SdoAbortError(DriveObjectError):
    """A drive has aborted the transfer of an object; the message has the SDO abort code."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        #: whether the drive does not have the object
        self.is_absent = code in NO_SUCH_OBJECT


class SdoChannel(canopen.sdo.SdoClient):
    """
    Objects of one drive, with its name for the operator, such as ``'q2'``.

    The EDS is the object dictionary of the drive type, which contains the sizes.
    """

    def __init__(
        self, bus: CanBus, node_id: int, name: str, eds: Path | None, clock: Clock
    ) -> None:
        self._bus, self._clock = bus, clock
        self._answered, self._asked = Event(), b''
        self._size = 4  # of the object [bytes]
        self._short_answer: int | None = None  # length of an answer that is too short
        self.name = name
        self.node_id = node_id
        #: time [s] on the monotonic clock after which no request is sent, because segments may
        # never end
        self.deadline = math.inf
        dictionary = (
            read_dictionary(eds, node_id) if eds else canopen.ObjectDictionary()
        )
        super().__init__(SDO_REQUEST + node_id, SDO_RESPONSE + node_id, dictionary)

    def read(self, index: int, subindex: int) -> bytes:
        """
        Return the bytes of an object after waiting for the answer.

        Raises an SdoAbortError if the drive rejects the request, a DriveTimeoutError if it does
        not answer, a BusError if the bus is lost.
        """
        return self._repeat(index, subindex, lambda: self.upload(index, subindex))

    def read_number(self, index: int, subindex: int = 0, signed: bool = False) -> int:
        """Return a number read from an object; raises the errors of `read`."""
        return int.from_bytes(self.read(index, subindex), 'little', signed=signed)

    def write(self, index: int, subindex: int, data: bytes) -> None:
        """Write an object and wait for the confirmation; raises the errors of `read`."""
        self._repeat(index, subindex, lambda: self.download(index, subindex, data))

    def size(self, index: int, subindex: int) -> int | None:
        """Return the size of an object [bytes], None if the EDS does not define a size."""
        variable = self.od.get_variable(index, subindex)
        return (
            len(variable) // 8 if variable is not None and variable.fixed_size else None
        )

    def _repeat(self, index: int, subindex: int, transfer: Callable[[], Any]) -> Any:
        """Retry a transfer after a lost or foreign answer; an abort counts as an answer."""
        drive = f'{self.name} (node {self.node_id})'
        self._size = self.size(index, subindex) or 4
        self._short_answer = None
        target = self._target = f'object {index:04X}h:{subindex:02X}'
        for _ in range(ATTEMPTS):
            try:
                return transfer()
            except canopen.SdoAbortedError as error:
                meaning = error.CODES.get(error.code, 'no further reason')
                raise SdoAbortError(
                    f'{drive} rejects {target}: {meaning[:1].lower()}{meaning[1:]} (abort '
                    f'{error.code >> 16:04X} {error.code & 0xFFFF:04X}h)',
                    error.code,
                ) from error
            except canopen.SdoCommunicationError:
                continue
        if self._short_answer is not None:
            raise DriveTimeoutError(
                f'{drive} answers for {target} with {self._short_answer} bytes, which is too '
                'short for the value; next: ask its maker for another firmware'
            )
        raise DriveTimeoutError(
            f'{drive} does not answer for {target} within {ATTEMPTS} × '
            f'{self.RESPONSE_TIMEOUT:g} s: check its power, its node id and the bit rate'
        )

    def send_request(self, request: bytes) -> None:
        """Send a request of a transfer, unless its time is over."""
        if self._clock.monotonic() > self.deadline:
            raise DriveTimeoutError(
                f'{self.name} (node {self.node_id}) was still busy with {self._target} when the '
                'time for this request was over: it answers too slowly, or without an end'
            )
        is_first = request[0] & 0xE0 in (
            0x20,
            0x40,
        )  # of a transfer: its answer has the object
        self._asked = bytes(request[1:4]) if is_first else b''
        self._answered.clear()
        self._bus.send(self.rx_cobid, bytes(request))

    def read_response(self) -> bytes:
        """Return the answer to a request; raises the errors of the library's method."""
        if not self._clock.wait(self._answered, self.RESPONSE_TIMEOUT):
            raise canopen.SdoCommunicationError('no answer was received')
        return super().read_response()

    def receive(self, frame: Frame) -> None:
        """
        Store only the first answer to a request, because a faulty drive may send many.

        Answers for another object belong to requests of the control thread, which calls this
        method.
        """
        answer = complete_answer(frame.data, self._size)
        if answer is None:
            if self._asked.startswith(frame.data[1:4]):
                self._short_answer = len(frame.data)
        elif answer[1:4].startswith(self._asked) and not self._answered.is_set():
            self.responses.put(answer)
            self._answered.set()
