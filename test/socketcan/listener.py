"""An independent listener: a raw AF_CAN socket, whose frames the kernel stamps."""

from __future__ import annotations

import socket
import struct
from typing import NamedTuple

from support import hear_much

from facade_manipulator.drives.canopen.pdo import tpdo_cob_id
from facade_manipulator.drives.cia402.states import decode_state, State

NODES = (1, 2, 3)
FRAME = struct.Struct('<IB3x8s')
SO_TIMESTAMPNS = 35
STAMP = struct.Struct('@ll')


class Frame(NamedTuple):
    """One frame; its time is the system clock's."""

    time: float
    cob_id: int
    data: bytes


class Listener:
    """A socket that shares no code with what it watches."""

    def __init__(self, interface: str) -> None:
        self._socket = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        hear_much(self._socket)
        self._socket.bind((interface,))
        self._socket.setblocking(False)
        self.frames: list[Frame] = []

    def read(self) -> list[Frame]:
        """Take what has come; return all frames so far."""
        while True:
            try:
                data, ((_, _, stamp), *_), *_ = self._socket.recvmsg(
                    FRAME.size, socket.CMSG_SPACE(STAMP.size))
            except BlockingIOError:
                return self.frames
            seconds, nanoseconds = STAMP.unpack(stamp)
            cob_id, length, data = FRAME.unpack(data)
            self.frames.append(Frame(seconds + 1e-9 * nanoseconds, cob_id, data[:length]))

    def of(self, cob_id: int) -> list[Frame]:
        """Return the frames of one COB-ID so far."""
        return [frame for frame in self.read() if frame.cob_id == cob_id]

    def send(self, cob_id: int, data: bytes) -> None:
        """Send a frame, which this socket itself does not hear."""
        self._socket.send(FRAME.pack(cob_id, len(data), data))

    def states(self) -> list[State | None]:
        """Return the drives' CiA 402 states by their newest TPDO1."""
        newest = [self.of(tpdo_cob_id(1, node))[-1:] for node in NODES]
        return [decode_state(struct.unpack_from('<H', found[0].data)[0]) if found else None
                for found in newest]

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
