"""All frames on a CAN interface, through a socket of its own: the driver knows nothing of it."""

from __future__ import annotations

from collections.abc import Callable
import threading
import time

import can

from facade_manipulator.blackbox.can_frames import frame_bytes

REOPEN_AFTER = 1.0  # s
LOOK_PERIOD = 0.2  # s, after which `close` is seen


class CanListener:
    """
    Hand every frame of a SocketCAN interface on, in a thread of its own; never send.

    It opens the interface again for as long as it is lost.

    Parameters
    ----------
    channel : str
        Name of the interface, such as ``can0``.
    add : callable
        Takes the monotonic time of a frame [s] and its bytes as a message.

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
                with can.Bus(interface='socketcan', channel=self.channel) as bus:
                    self.error = ''
                    self._listen(bus)
            except (OSError, can.CanError) as error:
                self.error = f'{self.channel}: {error}'
                self._ends.wait(REOPEN_AFTER)

    def _listen(self, bus: can.BusABC) -> None:
        epoch = time.time() - time.monotonic()
        while not self._ends.is_set():
            frame = bus.recv(LOOK_PERIOD)
            if frame is None:
                epoch = time.time() - time.monotonic()
                continue
            self._add(frame.timestamp - epoch, frame_bytes(
                frame.timestamp, frame.arbitration_id, bytes(frame.data),
                is_rtr=frame.is_remote_frame, is_extended=frame.is_extended_id,
                is_error=frame.is_error_frame))
