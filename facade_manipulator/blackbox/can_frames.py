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

import numpy as np

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
LONGEST_BATCH = 10.0  # s; of a longer one the clock was set meanwhile
TAKE_PERIOD = 0.02  # s, in which 1 Mbit/s brings at most 430 frames, all of them empty
BUFFER = 1 << 20  # byte; the kernel grants less, for some 550 frames
SO_TIMESTAMPNS, CAN_RAW_ERR_FILTER = 35, 2  # not in every build of Python's socket
MOST_AT_ONCE = 600  # frames: more than the kernel keeps
ROOM = 2 * MOST_AT_ONCE
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
        before = min(max(0.0, newest - stamp), LONGEST_BATCH)
        yield Kept(batch.time - before, batch.topic, frame_bytes(
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
    Keep every frame of a SocketCAN interface until it is handed on, in a thread of its own.

    It never sends, and opens the interface, such as ``can0``, again for as long as it is lost.
    `add` takes the monotonic time of the newest frame [s] and a batch of them, for `messages_of`.
    """

    def __init__(self, channel: str, add: Callable[[float, bytes], None]) -> None:
        self.channel = channel
        self.error = ''
        self._add = add
        self._arrivals, self._frames = Arrivals(), FrameBuffer()
        self._lock = threading.Lock()
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, name='CAN listener', daemon=True)
        self._thread.start()

    def hand_on(self) -> None:
        """Hand on what has come since; the thread does so by itself where its room gets short."""
        with self._lock:
            self._arrivals.begin()
            if batch := self._frames.take():
                self._add(self._arrivals.time(stamp_of(batch[-_RECORD.size:])), batch)

    def close(self) -> None:
        """End; return when the socket is closed and all is handed on."""
        self._ends.set()
        self._thread.join()
        self.hand_on()

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
        """Receive many at once: to be woken for each frame would cost more than to keep it."""
        while not self._ends.is_set():
            time.sleep(TAKE_PERIOD)
            with self._lock:
                self._frames.receive(opened.fileno())
            if self._frames.is_short:
                self.hand_on()


class FrameBuffer:
    """
    Room for what the kernel gives, of many frames in one call, until it is taken.

    With a call for each, 1400 frames a second took 0.3 % more of a processor (0.25 and 0.28).
    """

    def __init__(self) -> None:
        self._slots = ctypes.create_string_buffer(ROOM * _SLOT.size)
        begin, fresh = ctypes.addressof(self._slots), bytearray()
        for place in range(0, len(self._slots), _SLOT.size):
            slot = begin + place
            _SLOT.pack_into(self._slots, place, b'', slot + _SPACE, _RECORD.size - _STAMP_SIZE)
            fresh += _HEADER.pack(
                0, 0, slot + _SPACE - _STAMP_SIZE + _RECORD.size, 1, slot, _SPACE, 0, 0)
        self._fresh = bytes(fresh)
        self._headers = ctypes.create_string_buffer(self._fresh)
        self._records = np.ndarray(ROOM, f'V{_RECORD.size}', memoryview(self._slots),
                                   _SPACE - _STAMP_SIZE, _SLOT.size)
        self._count = 0

    @property
    def is_short(self) -> bool:
        """Return whether the room might not do for what the kernel keeps."""
        return self._count + MOST_AT_ONCE > ROOM

    def receive(self, descriptor: int) -> None:
        """Receive the frames that have come at a socket; raises an OSError."""
        count = _libc.recvmmsg(
            descriptor, ctypes.byref(self._headers, self._count * _HEADER.size),
            min(MOST_AT_ONCE, ROOM - self._count), socket.MSG_DONTWAIT, None)
        if count >= 0:
            self._count += count
        elif (number := ctypes.get_errno()) != errno.EAGAIN:
            raise OSError(number, os.strerror(number))

    def take(self) -> bytes:
        """Return the frames that were received since, each as it is kept."""
        count, self._count = self._count, 0
        ctypes.memmove(self._headers, self._fresh, count * _HEADER.size)  # the kernel wrote there
        return self._records[:count].tobytes()
