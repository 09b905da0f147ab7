"""
Channel for whole messages between two processes; it uses two Unix socket pairs and never waits.

SOCK_SEQPACKET sockets keep messages whole, and the size of their buffers limits the number of
messages. All *commands* arrive, in order. Messages of the *stream* may get lost, because the next
messages replace them. A flood of the stream therefore delays no command.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
import copyreg
from dataclasses import dataclass
import logging
import pickle
import select
import socket
from typing import Any

from facade_manipulator.canopen.link import BusSettings, BusStatistics
from facade_manipulator.drives.axis_settings import AxisSettings, read_axes
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.snapshot import (
    AxisSnapshot,
    ControllerSnapshot,
    CycleStatistics,
)
from facade_manipulator.drives.stopping_distances import StoppingAnalysis
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.follower import StreamSettings, StreamStatus
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.parameters import ParameterSource
from facade_manipulator.timeouts import braking_time

# plain numbers: combining Python's flags takes longer than the system call
_WITHOUT_WAITING = int(socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
Message = tuple[str, tuple[Any, ...]]  # kind and content


def _reduce_tuple(value: tuple[Any, ...]) -> tuple[type, tuple[Any, ...]]:
    return type(value), tuple(value)


def _reduce_dataclass(value: object) -> tuple[type, tuple[Any, ...]]:
    return type(value), tuple(vars(value).values())


# A state is sent 100 times a second. From the values of its parts, pickle writes and reads a state
# in 20 us. By calling the methods of the parts, pickle would need 60 us.
for _part in (ControllerSnapshot, AxisSnapshot, StreamStatus):
    copyreg.pickle(_part, _reduce_tuple)
for _counters in (CycleStatistics, BusStatistics):
    copyreg.pickle(_counters, _reduce_dataclass)


@dataclass(frozen=True)
class LoopSetup:
    """Settings of the loop, which the node sends once at the start."""

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

    @classmethod
    def read(cls, source: ParameterSource) -> LoopSetup:
        """Read the parameters of the control loop."""
        geometry = source.read(Geometry, 'geometry')
        controller = source.read(ControllerSettings, 'controller')
        stream = source.read(StreamSettings, 'stream')
        stream.require_rate('controller.rate', controller.rate)
        return cls(
            geometry=geometry,
            controller=controller,
            axes=read_axes(source.read, geometry.stroke),
            bus=source.read(BusSettings, 'bus'),
            stream=stream,
            limits=source.read(MotionLimits, 'limits'),
        )

    @property
    def extra_time(self) -> float:
        """Return the additional time that the end of the loop needs for slow brakes [s]."""
        return braking_time(max(axis.stop_time for axis in self.axes))

    @property
    def stopping(self) -> StoppingAnalysis:
        """Return the stopping analysis; the node calls its `check` before starting the loop."""
        return StoppingAnalysis(self.geometry, self.limits, self.axes, self.controller)


def channel_ends() -> tuple[tuple[socket.socket, ...], tuple[socket.socket, ...]]:
    """Return the sockets for both ends of a channel, each as (commands, stream)."""
    commands = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    stream = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    return (commands[0], stream[0]), (commands[1], stream[1])


class Channel:
    """
    One end of a channel, used by a single thread.

    The channel owns both sockets, each of which is one of a SOCK_SEQPACKET pair.
    """

    STREAM = frozenset({'setpoint', 'forces', 'state', 'rejected'})
    SEND_BUFFER = 1 << 17  # bytes, about 250 commands

    def __init__(self, commands: socket.socket, stream: socket.socket) -> None:
        for end in (commands, stream):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, self.SEND_BUFFER)
        self._commands = commands
        self._stream = stream
        self._poll_commands = _poll_of(commands)
        self._poll_stream = _poll_of(stream)

    def send(self, kind: str, *content: Any) -> bool:
        """
        Send a message without waiting; return whether it fitted into the buffer.

        The end of the other process is reported by the methods that receive.
        """
        data = pickle.dumps((kind, content), pickle.HIGHEST_PROTOCOL)
        end = self._stream if kind in self.STREAM else self._commands
        try:
            end.send(data, _WITHOUT_WAITING)
        except BlockingIOError:
            return False
        except OSError:
            pass
        return True

    def wait(self, timeout: float) -> None:
        """Wait until a command arrives or a timeout [s] expires."""
        self._poll_commands.poll(1e3 * timeout)

    def commands(self) -> Iterator[Message]:
        """
        Receive all waiting commands in order.

        Raises a ConnectionError if the process at the other end has closed it, or has ended.
        """
        while (data := _receive(self._commands, self._poll_commands)) is not None:
            if not data:
                raise ConnectionError('the other process has ended')
            yield pickle.loads(data)

    def stream(
        self, number: int, may_continue: Callable[[], bool] = lambda: True
    ) -> list[Message]:
        """Receive stream messages while a condition holds; return the newest in order."""
        newest = deque[bytes](maxlen=number)
        while may_continue():
            data = _receive(self._stream, self._poll_stream)
            if not data:
                break
            newest.append(data)
        return [pickle.loads(data) for data in newest]

    def close(self) -> None:
        """Close this end; the other end then raises a ConnectionError."""
        self._commands.close()
        self._stream.close()


def _poll_of(end: socket.socket) -> select.poll:
    poll = select.poll()
    poll.register(end, select.POLLIN)
    return poll


def _receive(end: socket.socket, poll: select.poll) -> bytes | None:
    """Return a waiting message; None without a message, ``b''`` if the other end is closed."""
    # the exception of an empty socket would take 4 us, a poll takes 1 us
    if not poll.poll(0):
        return None
    try:
        return _message(end)
    except BlockingIOError:
        return None
    except OSError:  # this end is closed, or the other process was killed
        return b''


LONGEST_MESSAGE = 1 << 16  # bytes, more than any message


def _message(end: socket.socket) -> bytes:
    try:
        return end.recv(LONGEST_MESSAGE, _WITHOUT_WAITING)
    except ConnectionResetError:
        # the other process has ended before it read all messages; its own messages follow this
        # error
        return end.recv(LONGEST_MESSAGE, _WITHOUT_WAITING)
