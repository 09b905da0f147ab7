"""
The two paths through an interface that python-can has opened: its messages, or its socket.

On SocketCAN the frames go past python-can's messages: one system call sends, two receive, and
Python has half the work. Filters and the kernel's SYNC are python-can's on either path.

References
----------
Linux kernel, include/uapi/linux/can.h: struct can_frame and the flags in its identifier.

"""

from __future__ import annotations

from enum import Enum
from select import select
import socket
import struct
from typing import Protocol

import can
from can.interfaces.socketcan import SocketcanBus

MAX_COB_ID = 0x7FF
_EXTENDED, _REMOTE, _ERROR = 0x80000000, 0x40000000, 0x20000000
_FRAME = struct.Struct('=IB3x8s')
_FLEXIBLE = 72  # bytes of a CAN FD frame, so that it is not taken for a classic one cut short
_STAMP = struct.Struct('@ll')  # seconds and nanoseconds of the system clock
_ANCILLARY = socket.CMSG_SPACE(_STAMP.size)


class Kind(Enum):
    """What a frame is: standard data, the controller's report of an error, or not for us."""

    DATA = 'data'
    ERROR = 'error'
    OTHER = 'other'


# kind, identifier, data, and when it came on the system clock [s]
Received = tuple[Kind, int, bytes, float]


class Port(Protocol):
    """A path through an interface; errors are those of python-can and of the system."""

    def receive(self, timeout: float) -> Received | None:
        """Wait for a frame, None after the time-out [s]."""

    def send(self, cob_id: int, data: bytes) -> None:
        """Send a standard data frame without waiting."""


def port_of(bus: can.BusABC) -> Port:
    """Return the best path through an open interface."""
    return SocketPort(bus.socket) if isinstance(bus, SocketcanBus) else MessagePort(bus)


class MessagePort:
    """The path through any interface of python-can."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus

    def receive(self, timeout: float) -> Received | None:
        """Wait for a frame; see `Port`."""
        # recv would wait on for as long as the system clock is set back meanwhile
        message, _ = self._bus._recv_internal(timeout)
        if message is None:
            return None
        kind = Kind.DATA
        if message.is_error_frame:
            kind = Kind.ERROR
        elif message.is_extended_id or message.is_remote_frame or message.is_fd:
            kind = Kind.OTHER
        return kind, message.arbitration_id, bytes(message.data), message.timestamp

    def send(self, cob_id: int, data: bytes) -> None:
        """Send a frame; see `Port`."""
        message = can.Message(arbitration_id=cob_id, data=data, is_extended_id=False)
        message.data = data  # the virtual bus copies deeply: a bytearray costs it as much again
        self._bus.send(message)


class SocketPort:
    """
    The path through a raw CAN socket.

    Parameters
    ----------
    can_socket : socket.socket
        Set to deliver the kernel's time stamp with every frame, as python-can does.

    """

    def __init__(self, can_socket: socket.socket) -> None:
        self._socket = can_socket

    def receive(self, timeout: float) -> Received | None:
        """Wait for a frame; see `Port`."""
        if not select((self._socket,), (), (), timeout)[0]:
            return None
        content, ((_, _, stamp),), _, _ = self._socket.recvmsg(_FLEXIBLE, _ANCILLARY)
        identifier, length, data = _FRAME.unpack_from(content)
        kind = Kind.DATA
        if identifier & _ERROR:
            kind = Kind.ERROR
        elif identifier & (_EXTENDED | _REMOTE) or len(content) > _FRAME.size:
            kind = Kind.OTHER
        seconds, nanoseconds = _STAMP.unpack(stamp)
        return kind, identifier & MAX_COB_ID, data[:length], seconds + 1e-9 * nanoseconds

    def send(self, cob_id: int, data: bytes) -> None:
        """Send a frame; see `Port`."""
        self._socket.send(_FRAME.pack(cob_id, len(data), data), socket.MSG_DONTWAIT)
