"""
Messages between two processes over a Unix socket pair: whole, bounded, never waited for.

A SOCK_SEQPACKET socket keeps messages whole, and its buffer is the bound: a message that does not
fit is dropped. Setpoints and states, which come hundreds of times a second, may get lost: the next
ones replace them. Replies must not, and wait for room. The end of the other process is an error.
"""

from __future__ import annotations

from collections import deque
import pickle
import select
import socket
from threading import Lock
from typing import Any, NamedTuple

from facade_manipulator.errors import ManipulatorError

MAX_MESSAGE = 1 << 16  # bytes
BUFFER = 1 << 17  # bytes, about a second of states
MAX_BACKLOG = 4096  # messages that must arrive: a process that reads none of so many has ended
_END_OF_KIND = b'\0'
# plain numbers: to combine flags of Python's takes longer than the call of the system
_WITHOUT_WAITING = int(socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
_TRUNCATED = int(socket.MSG_TRUNC)


class ChannelError(ManipulatorError):
    """A message cannot be read."""


class ChannelClosedError(ChannelError):
    """The process at the other end has closed the channel, or has ended."""


class Message(NamedTuple):
    """A message as received: what it is about, and its content still packed."""

    kind: str
    packed: bytes  #: of many states only some are looked at, and unpacked for it

    @property
    def content(self) -> tuple[Any, ...]:
        """The values that were sent; a ChannelError if they cannot be read."""
        try:
            return pickle.loads(self.packed)
        except Exception as error:  # pickle raises whatever the damage makes it raise
            raise ChannelError(f'a message {self.kind!r} cannot be read: {error}') from error


class Channel:
    """
    One end of a channel; any thread may send, one receives.

    The socket is a blocking one of a SOCK_SEQPACKET pair, and owned from now on. If the other end
    is gone, a ChannelClosedError is raised.
    """

    def __init__(self, end: socket.socket) -> None:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
        self._socket = end
        self._poll = select.poll()
        self._poll.register(end, select.POLLIN)
        self._buffer = bytearray(MAX_MESSAGE)
        self._sending = Lock()
        self._backlog: deque[bytes] = deque()

    def send(self, kind: str, *content: Any, must_arrive: bool = False) -> bool:
        """
        Send a message without waiting; return whether it is on its way.

        Its kind says what it is about, its content is anything that can be pickled. One that must
        arrive is kept for the next sending rather than dropped.
        """
        data = kind.encode() + _END_OF_KIND + pickle.dumps(content, pickle.HIGHEST_PROTOCOL)
        if must_arrive:
            if len(self._backlog) >= MAX_BACKLOG:
                raise ChannelClosedError('the other process reads nothing any more')
            self._backlog.append(data)
        # another thread that sends just now may have been interrupted: not even for it is waited
        if not self._sending.acquire(blocking=False):
            return False
        try:
            while self._backlog:
                self._socket.send(self._backlog[0], _WITHOUT_WAITING)
                self._backlog.popleft()
            if not must_arrive:
                self._socket.send(data, _WITHOUT_WAITING)
        except BlockingIOError:
            return False
        except OSError as error:
            raise ChannelClosedError('the other process has ended') from error
        finally:
            self._sending.release()
        return True

    def receive(self, timeout: float) -> Message | None:
        """Wait for a message; return None after the time-out [s]."""
        if not self._poll.poll(1e3 * timeout):
            return None
        try:
            length, _, flags, _ = self._socket.recvmsg_into(
                [self._buffer], 0, _WITHOUT_WAITING)
        except BlockingIOError:
            return None
        except OSError as error:
            raise ChannelClosedError('the other process has ended') from error
        if length == 0:
            raise ChannelClosedError('the other process has closed the channel')
        if flags & _TRUNCATED:
            return None
        kind, _, packed = bytes(memoryview(self._buffer)[:length]).partition(_END_OF_KIND)
        return Message(kind.decode(errors='replace'), packed)

    def close(self) -> None:
        """Close this end; the other one meets a `ChannelClosedError`."""
        with self._sending:
            self._socket.close()


def socket_pair() -> tuple[socket.socket, socket.socket]:
    """Return the two ends of a new channel."""
    return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
