"""
Channel of whole messages between two processes over a Unix socket pair, without waiting.

A SOCK_SEQPACKET socket keeps messages whole, and its buffer is the bound. A message that may get
lost is dropped if it does not fit. The others wait in a backlog, whose length is the number of
requests of the operator. Only `Channel.receive` reports the end of the other process.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
import logging
import pickle
import select
import socket
from threading import Lock
from typing import Any

from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.stopping import StoppingAnalysis
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.follower import StreamSettings
from facade_manipulator.motion.limits import MotionLimits

# plain numbers: combining Python's flags takes longer than the system call
_WITHOUT_WAITING = int(socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
MAY_GET_LOST = (
    'feed',
    'setpoint',
    'forces',
    'state',
    'rejected',
)  # the next ones replace them
LONGEST_MESSAGE = 1 << 16  # bytes, more than any message
Message = tuple[str, tuple[Any, ...]]  # kind and content


@dataclass(frozen=True)
class LoopSetup:
    """Settings of the loop, sent once at its start."""

    geometry: Geometry
    controller: ControllerSettings
    axes: tuple[AxisSettings, ...]
    bus: BusSettings = BusSettings()
    stream: StreamSettings = StreamSettings()
    limits: MotionLimits = MotionLimits()
    #: name ``'module:function'`` of the function that takes bus and axes and starts simulated
    #: drives, as `facade_manipulator.simulation.drives.simulator.start_simulator`; ``''`` for real
    #: drives
    simulate: str = ''
    log_level: int = logging.INFO  #: minimum severity that the loop logs

    @property
    def extra_time(self) -> float:
        """Return the time that slow brakes add to the end of the loop [s]."""
        return 2.0 * max(axis.stop_time for axis in self.axes)

    def stopping(self, limits: MotionLimits) -> StoppingAnalysis:
        """Return the stopping analysis of limits; raises the errors of its `check`."""
        analysis = StoppingAnalysis(self.geometry, limits, self.axes, self.controller)
        analysis.check()
        return analysis


class Channel:
    """
    End of a channel; any thread may send, one thread receives.

    The channel owns the socket, which is one of a SOCK_SEQPACKET pair.
    """

    def __init__(self, end: socket.socket) -> None:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 17)  # some seconds
        self._socket = end
        self._sending = Lock()
        self._backlog: deque[bytes] = deque()

    def send(self, kind: str, *content: Any) -> bool:
        """
        Send a message without waiting; return whether it was sent.

        A message that must arrive is otherwise kept until the next call.
        """
        data = pickle.dumps((kind, content), pickle.HIGHEST_PROTOCOL)
        must_arrive = kind not in MAY_GET_LOST
        if must_arrive:
            self._backlog.append(data)
        # the thread that sends now may have been interrupted: the loop does not wait for it either
        if not self._sending.acquire(blocking=False):
            return False
        try:
            while self._backlog:
                self._socket.send(self._backlog[0], _WITHOUT_WAITING)
                self._backlog.popleft()
            if not must_arrive:
                self._socket.send(data, _WITHOUT_WAITING)
        except OSError:  # full, or closed, which `receive` reports
            return False
        finally:
            self._sending.release()
        return True

    def receive(self, timeout: float) -> Message | None:
        """
        Return the next message, None after a timeout [s].

        Raises a ConnectionError if the process at the other end has closed it, or has ended.
        """
        if timeout and not select.select([self._socket], [], [], timeout)[0]:
            return None
        try:
            data = self._receive()
        except BlockingIOError:
            return None
        except OSError:  # this end is closed, or the other process was killed
            data = b''
        if not data:
            raise ConnectionError('the other process has ended')
        message: Message = pickle.loads(data)
        return message

    def _receive(self) -> bytes:
        """Return the next message, ``b''`` after the end."""
        try:
            return self._socket.recv(LONGEST_MESSAGE, _WITHOUT_WAITING)
        except ConnectionResetError:
            # the other process has ended before it read all; its own messages come after this
            return self._socket.recv(LONGEST_MESSAGE, _WITHOUT_WAITING)

    def close(self) -> None:
        """Close this end; the other end raises a ConnectionError."""
        with self._sending:
            self._socket.close()
