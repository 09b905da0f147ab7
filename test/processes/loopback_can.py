"""
CAN bus between processes without root: python-can's interface ``loopback``.

Each frame is a datagram to all sockets of a port on this machine's loopback network. The kernel
stamps the frame, and drops it if a reader's buffer is full, as on SocketCAN. Python-can finds this
interface by `loopback_can.dist-info`.
"""

from contextlib import suppress
import select
import socket
import struct
import zlib

import can

EVERYBODY = '127.255.255.255'
FRAME = struct.Struct('=IB3x8s')  # struct can_frame, with its flags
EXTENDED = 0x80000000
REMOTE = 0x40000000
ERROR = 0x20000000
STAMP = struct.Struct('@ll')
SO_RCVBUFFORCE = 33
SO_TIMESTAMPNS = 35
MUCH = 8 << 20  # bytes that wait for a reader


class LoopbackBus(can.BusABC):
    """One end of the bus."""

    def __init__(self, channel: str, **details: object) -> None:
        self._everybody = EVERYBODY, 20_000 + zlib.crc32(channel.encode()) % 10_000
        self._receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._receiver.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        with suppress(PermissionError):
            self._receiver.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, MUCH)
        self._receiver.bind(self._everybody)
        self._sender.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._sender.bind(('127.0.0.1', 0))
        self._own_address = self._sender.getsockname()
        self.channel_info = f'loopback {channel}'
        super().__init__(channel)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        # filters are applied here, as SocketCAN's are by the kernel: python-can's own end a
        # recv(0.0) at the first frame that does not pass
        while select.select([self._receiver], [], [], timeout)[0]:
            message = self._take()
            if message is not None and self._matches_filters(message):
                return message, True
            # what has come by now; python-can waits for the rest
            timeout = timeout and 0.0
        return None, False

    def _take(self) -> can.Message | None:
        room = socket.CMSG_SPACE(STAMP.size)
        data, ancillary, _, sender = self._receiver.recvmsg(FRAME.size, room)
        if sender == self._own_address:
            return None
        stamp = ancillary[0][2]
        seconds, nanoseconds = STAMP.unpack(stamp)
        cob_id, length, data = FRAME.unpack(data)
        message = can.Message(
            timestamp=seconds + 1e-9 * nanoseconds,
            arbitration_id=cob_id & 0x1FFFFFFF,
            is_remote_frame=bool(cob_id & REMOTE),
            dlc=length,
            data=data[:length],
        )
        message.is_extended_id = bool(cob_id & EXTENDED)
        message.is_error_frame = bool(cob_id & ERROR)
        return message

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame to all other readers."""
        flags = (
            EXTENDED * msg.is_extended_id
            | REMOTE * msg.is_remote_frame
            | ERROR * msg.is_error_frame
        )
        frame = FRAME.pack(msg.arbitration_id | flags, msg.dlc, bytes(msg.data))
        self._sender.sendto(frame, self._everybody)

    def fileno(self) -> int:
        """Return the file descriptor that becomes readable when a frame arrives."""
        return self._receiver.fileno()

    def shutdown(self) -> None:
        """Close the socket of this end."""
        super().shutdown()
        self._receiver.close()
        self._sender.close()
