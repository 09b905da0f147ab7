"""
CAN frames as they come, as they are kept, and as messages can_msgs/Frame, which readers know.

They come through a socket of their own: the driver knows nothing of it. They are kept in batches
of what the kernel gives: a stamp and a frame each, 32 bytes.

References
----------
struct can_frame and the flags of its identifier, linux/can.h.

"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import ctypes
import errno
import os
import socket
import struct
import threading
import time

from facade_manipulator.arrivals import Arrivals
from facade_manipulator.blackbox.messages import Kept, RecordedTopic

CAN_TOPIC = RecordedTopic('can_frames', 'can_msgs/msg/Frame', """\
std_msgs/Header header
uint32 id
bool is_rtr
bool is_extended
bool is_error
uint8 dlc
uint8[8] data
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
""")
_FRAME = struct.Struct('<4siIIs3xI???B8s')  # an empty frame_id; CDR, little endian
_LITTLE_ENDIAN = b'\0\1\0\0'
_NANOSECONDS = 1_000_000_000
_RECORD = struct.Struct('@llIB3x8s')
_STAMP_SIZE = struct.calcsize('@ll')
IS_EXTENDED, IS_RTR, IS_ERROR, IDENTIFIER = 1 << 31, 1 << 30, 1 << 29, (1 << 29) - 1
REOPEN_AFTER = 1.0  # s
TAKE_PERIOD = 0.02  # s, in which 1 Mbit/s brings at most 430 frames, all of them empty
BUFFER = 1 << 20  # byte; the kernel grants less, for some 550 frames
SO_TIMESTAMPNS, CAN_RAW_ERR_FILTER = 35, 2  # not in every build of Python's socket
MOST_AT_ONCE = 600  # frames: more than the kernel keeps
_SPACE = socket.CMSG_SPACE(_STAMP_SIZE)  # of what comes beside a frame; it ends with the stamp
_SLOT = struct.Struct(f'@{_SPACE - _STAMP_SIZE}x{_RECORD.size}sPN')  # then struct iovec
_HEADER = struct.Struct('@PI0PPNPNi0PI0P')  # struct mmsghdr
_libc = ctypes.CDLL(None, use_errno=True)


def stamp_of(record: bytes) -> float:
    """Return the stamp of a kept frame [s, system's clock]."""
    seconds, nanoseconds, *_ = _RECORD.unpack(record)
    return seconds + nanoseconds / _NANOSECONDS


def messages_of(batch: Kept) -> Iterator[Kept]:
    """Yield the frames of a batch, whose time is that of its newest, each as a message."""
    newest = stamp_of(batch.data[-_RECORD.size:])
    for seconds, nanoseconds, flagged, length, data in _RECORD.iter_unpack(batch.data):
        stamp = seconds + nanoseconds / _NANOSECONDS
        yield Kept(batch.time - (newest - stamp), batch.topic, frame_bytes(
            stamp, flagged & IDENTIFIER, data[:length], is_rtr=bool(flagged & IS_RTR),
            is_extended=bool(flagged & IS_EXTENDED), is_error=bool(flagged & IS_ERROR)))


def frame_bytes(
    stamp: float, cob_id: int, data: bytes, *, is_rtr: bool = False, is_extended: bool = False,
    is_error: bool = False,
) -> bytes:
    """Return a frame as a serialised message; `stamp` is the system's time [s]."""
    seconds, nanoseconds = divmod(round(stamp * _NANOSECONDS), _NANOSECONDS)
    return _FRAME.pack(_LITTLE_ENDIAN, seconds, nanoseconds, 1, b'\0', cob_id,
                       is_rtr, is_extended, is_error, len(data), data)


class CanListener:
    """
    Hand every frame of a SocketCAN interface on, in batches, in a thread of its own; never send.

    It opens the interface, such as ``can0``, again for as long as it is lost. `add` takes the
    monotonic time of the newest frame [s] and a batch of them, for `messages_of`.
    """

    def __init__(self, channel: str, add: Callable[[float, bytes], None]) -> None:
        self.channel = channel
        self.error = ''
        self._add = add
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, name='CAN listener', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End; return when the socket is closed."""
        self._ends.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ends.is_set():
            try:
                with socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as opened:
                    self._open(opened)
                    self._listen(opened)
            except OSError as error:
                self.error = f'{self.channel}: {error.strerror}'
                self._ends.wait(REOPEN_AFTER)

    def _open(self, opened: socket.socket) -> None:
        opened.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, socket.CAN_ERR_MASK)
        opened.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        opened.bind((self.channel,))
        opened.setblocking(False)
        self.error = ''

    def _listen(self, opened: socket.socket) -> None:
        """Take the frames many at once: to be woken for each would cost more than to keep it."""
        arrivals, received = Arrivals(), FrameBuffer(opened)
        while not self._ends.is_set():
            time.sleep(TAKE_PERIOD)
            arrivals.begin()
            if batch := received.take():
                self._add(arrivals.time(stamp_of(batch[-_RECORD.size:])), batch)


class FrameBuffer:
    """
    Room for what the kernel gives of many frames in one call.

    With a call for each, 1400 frames a second took 0.3 % more of a processor (0.25 and 0.28).
    """

    def __init__(self, opened: socket.socket) -> None:
        self._opened = opened
        self._slots = ctypes.create_string_buffer(MOST_AT_ONCE * _SLOT.size)
        begin, self._fresh = ctypes.addressof(self._slots), b''
        for place in range(0, len(self._slots), _SLOT.size):
            slot = begin + place
            _SLOT.pack_into(self._slots, place, b'', slot + _SPACE, _RECORD.size - _STAMP_SIZE)
            self._fresh += _HEADER.pack(
                0, 0, slot + _SPACE - _STAMP_SIZE + _RECORD.size, 1, slot, _SPACE, 0, 0)
        self._headers = ctypes.create_string_buffer(self._fresh)

    def take(self) -> bytes:
        """Return the frames that have come, each as it is kept; raises an OSError."""
        count = _libc.recvmmsg(
            self._opened.fileno(), self._headers, MOST_AT_ONCE, socket.MSG_DONTWAIT, None)
        if count < 0 and (number := ctypes.get_errno()) != errno.EAGAIN:
            raise OSError(number, os.strerror(number))
        count = max(0, count)
        ctypes.memmove(self._headers, self._fresh, count * _HEADER.size)  # the kernel wrote there
        came = memoryview(self._slots)[:count * _SLOT.size]
        return b''.join(record for record, *_ in _SLOT.iter_unpack(came))
