"""All frames on a CAN interface, through a socket of its own: the driver knows nothing of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import socket
import threading

from facade_manipulator.blackbox.arrivals import Arrivals
from facade_manipulator.blackbox.can_frames import FRAME_SIZE, stamp_of, STAMP_SIZE

REOPEN_AFTER = 1.0  # s
TAKE_PERIOD = 0.02  # s, in which 1 Mbit/s brings at most 430 frames, all of them empty
BUFFER = 1 << 20  # byte; the kernel grants less, for some 550 frames
SO_TIMESTAMPNS, CAN_RAW_ERR_FILTER = 35, 2  # not in every build of Python's socket


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
        arrivals = Arrivals()
        while not self._ends.wait(TAKE_PERIOD):
            arrivals.begin()
            if batch := list(_records(opened)):
                self._add(arrivals.time(stamp_of(batch[-1])), b''.join(batch))


def _records(opened: socket.socket) -> Iterator[bytes]:
    """Yield what has come: the kernel's stamp and the frame, as the kernel writes them."""
    room = socket.CMSG_SPACE(STAMP_SIZE)
    while True:
        try:
            frame, ((_, _, stamp),), _, _ = opened.recvmsg(FRAME_SIZE, room)
        except BlockingIOError:
            return
        yield stamp + frame
