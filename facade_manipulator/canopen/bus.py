"""
A CAN bus of our own: frames in and out, SYNC, error frames, statistics.

python-can opens the bus, filters, and has the kernel send SYNC. Its Notifier is not used, because
that thread dies on a link error and stays dead: whoever owns a `CanBus` calls `CanBus.receive` and
meets every error as a `BusError`. On SocketCAN frames go past python-can's messages: one system
call sends, two receive, and Python has half the work.

References
----------
Linux kernel, include/uapi/linux/can.h: struct can_frame and the flags in its identifier;
include/uapi/linux/can/error.h: classes and data bytes of error frames.

"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
import errno
from select import select
import socket
import struct
from threading import Lock
import time
from typing import NamedTuple

import can
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.virtual import VirtualBus

from facade_manipulator.canopen.link import restart_command
from facade_manipulator.canopen.nmt import NmtCommand
from facade_manipulator.canopen.pdo import NMT_COB_ID, SYNC_COB_ID
from facade_manipulator.errors import BusError

LATEST_STAMP_AGE = 10.0  # s: an older stamp is of another clock
MAX_COB_ID = 0x7FF
_EXTENDED, _REMOTE, ERROR_FRAME = 0x80000000, 0x40000000, 0x20000000
_FRAME = struct.Struct('=IB3x8s')
_FLEXIBLE = 72  # bytes of a CAN FD frame, so that it is not taken for a classic one cut short
_STAMP = struct.Struct('@ll')  # seconds and nanoseconds of the system clock
_ANCILLARY = socket.CMSG_SPACE(_STAMP.size)


class BusCongestedError(BusError):
    """The interface takes no more frames: nobody acknowledges them, or its queue is too short."""


class Condition(IntEnum):
    """How well the controller of the interface is, as its error frames say."""

    ACTIVE = 0
    WARNING = 1
    PASSIVE = 2
    OFF = 3


class Frame(NamedTuple):
    """A standard data frame as received."""

    cob_id: int
    data: bytes
    time: float  #: when it came, on the monotonic clock [s]
    stamp: float  #: the same on the system clock [s]


class BusStatistics(NamedTuple):
    """Counters since the bus was opened; `condition` is the present one."""

    received: int = 0
    sent: int = 0
    ignored: int = 0
    error_frames: int = 0
    overflows: int = 0
    condition: Condition = Condition.ACTIVE


_ERROR_OVERFLOW = 0x03
# error class in the identifier, or bit in data[1] of a controller problem, and what it means
_ERROR_CLASSES = ((0x040, Condition.OFF), (0x100, Condition.ACTIVE))
_CONTROLLER_PROBLEM = 0x004
_CONTROLLER_BITS = (
    (0x30, Condition.PASSIVE), (0x0C, Condition.WARNING), (0x40, Condition.ACTIVE))

_DOWN = {
    errno.ENETDOWN: 'the CAN interface is down',
    errno.ENODEV: 'the CAN interface has vanished',
    errno.ENXIO: 'the CAN interface has vanished',
    errno.EBADF: 'the CAN socket is closed',
}


_FULL = (errno.ENOBUFS, errno.EAGAIN)  # the interface's queue, the socket's


def condition_of(cob_id: int, data: bytes) -> Condition | None:
    """Return the controller's condition that an error frame reports, None if it reports none."""
    for error_class, condition in _ERROR_CLASSES:
        if cob_id & error_class:
            return condition
    if cob_id & _CONTROLLER_PROBLEM and len(data) > 1:
        return next((found for bits, found in _CONTROLLER_BITS if data[1] & bits), None)
    return None


class CanBus:
    """Frames of a python-can bus, owned from now on; any thread may `send`, one does the rest."""

    has_kernel_sync = False
    #: why the kernel does not send SYNC on an interface where it usually does; ``''`` elsewhere
    sync_note = ''

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self.is_virtual = isinstance(bus, VirtualBus)  # within this process: there is no cable
        self._sending = Lock()
        self._sync_task: can.CyclicSendTaskABC | None = None
        self._received = self._sent = self._ignored = 0
        self._error_frames = self._overflows = 0
        self._condition = Condition.ACTIVE

    def __str__(self) -> str:
        return str(self._bus.channel_info)

    @property
    def statistics(self) -> BusStatistics:
        """Counters and the controller's condition."""
        return BusStatistics(
            self._received, self._sent, self._ignored, self._error_frames, self._overflows,
            self._condition)

    def listen_to(self, cob_ids: tuple[int, ...]) -> None:
        """Let the kernel drop every other frame, where it is the kernel that filters."""

    def receive(self, timeout: float) -> Frame | None:
        """
        Wait for the next standard data frame [s]; return None after that or for one not for us.

        Raises a BusError if the interface is down or gone, or its controller is bus-off.
        """
        try:
            received = self._receive(max(0.0, timeout))
        except (can.CanError, OSError, ValueError) as error:
            raise BusError(f'{self}: {_reason(error)}') from error
        if received is None:
            return None
        identifier, data, stamp = received
        if identifier > MAX_COB_ID:
            self._set_aside(identifier, data)
            return None
        self._received += 1
        age = time.time() - stamp
        if not 0.0 <= age < LATEST_STAMP_AGE:
            age = 0.0  # the system clock was set meanwhile
        return Frame(identifier, data, time.monotonic() - age, stamp)

    def _receive(self, timeout: float) -> tuple[int, bytes, float] | None:
        """Return identifier and flags, data and stamp of the next frame."""
        # what an interface of python-can implements; its `recv` around that would wait on for as
        # long as the system clock is set back meanwhile
        message, _ = self._bus._recv_internal(timeout)
        if message is None:
            return None
        flags = ERROR_FRAME if message.is_error_frame else (
            _EXTENDED if message.is_extended_id or message.is_remote_frame or message.is_fd else 0)
        return message.arbitration_id | flags, bytes(message.data), message.timestamp

    def send(self, cob_id: int, data: bytes = b'', sampled: float | None = None) -> None:
        """
        Send a standard data frame without waiting.

        `sampled` is when what it says was so, on the monotonic clock [s]: its stamp where the
        sender stamps, which is on the bus within one process alone. Raises a BusCongestedError if
        the interface's queue is full, a BusError if it is down or gone.
        """
        try:
            with self._sending:
                self._send(cob_id, data, sampled)
        except (can.CanError, OSError, ValueError) as error:
            raise self._send_error(error) from error
        self._sent += 1

    def _send(self, cob_id: int, data: bytes, sampled: float | None) -> None:
        stamp = time.time() if sampled is None else time.time() - time.monotonic() + sampled
        message = can.Message(
            timestamp=stamp, arbitration_id=cob_id & ~ERROR_FRAME, data=data,
            is_extended_id=False, is_error_frame=cob_id >= ERROR_FRAME)
        # the virtual bus copies deeply: a bytearray costs it as much again
        message.data = data  # type: ignore[assignment]
        self._bus.send(message)

    def command(self, command: NmtCommand, node_id: int) -> None:
        """Send a network management command to one node, 0 for all; raises what `send` does."""
        self.send(NMT_COB_ID, bytes([command, node_id]))

    def start_sync(self, period: float) -> None:
        """Let the kernel send SYNC, without jitter of Python; a BusError if that cannot be."""
        message = can.Message(arbitration_id=SYNC_COB_ID, is_extended_id=False)
        try:
            self._sync_task = self._bus.send_periodic(message, period)
        except (can.CanError, OSError) as error:
            raise BusError(f'{self}: no SYNC from the kernel, {_reason(error)}') from error

    def stop_sync(self) -> None:
        """Stop the kernel's SYNC; harmless without one."""
        task, self._sync_task = self._sync_task, None
        if task is not None:
            _quietly(task.stop)

    def close(self) -> None:
        """Fall silent and give the interface back; never raises."""
        self.stop_sync()
        _quietly(self._bus.shutdown)

    def _set_aside(self, identifier: int, data: bytes) -> None:
        """Count what is no frame for us; note what the controller reports of itself."""
        if not identifier & ERROR_FRAME:
            self._ignored += 1
            return
        self._error_frames += 1
        condition = condition_of(identifier, data)
        if identifier & _CONTROLLER_PROBLEM and len(data) > 1:
            self._overflows += bool(data[1] & _ERROR_OVERFLOW)
        if condition is not None:
            self._condition = condition
        if condition is Condition.OFF:
            raise BusError(self._bus_off())

    def _bus_off(self) -> str:
        return f'{self}: the controller is bus-off, check bit rate and wiring'

    def _send_error(self, error: Exception) -> BusError:
        code = _code(error)
        if code in _FULL or (code is None and 'full' in str(error).lower()):
            return BusCongestedError(
                f'{self}: the send queue is full, no node acknowledges frames '
                '(power of the drives, wiring, bit rate)')
        return BusError(f'{self}: {_reason(error)}')


class SocketCanBus(CanBus):
    """Frames of SocketCAN: python-can sets the socket up so that each comes with its stamp."""

    _bus: SocketcanBus

    def __init__(self, bus: SocketcanBus) -> None:
        super().__init__(bus)
        try:  # the kernel loads its module, if it has it
            socket.socket(socket.PF_CAN, socket.SOCK_DGRAM, socket.CAN_BCM).close()
        except OSError:
            self.sync_note = (
                'the control loop sends SYNC, because the kernel has no CAN broadcast manager; '
                'with less jitter: sudo modprobe can-bcm, then cleanup and configure')
        self.has_kernel_sync = not self.sync_note

    def listen_to(self, cob_ids: tuple[int, ...]) -> None:
        """Let the kernel drop every other frame."""
        self._bus.set_filters([
            {'can_id': cob_id, 'can_mask': MAX_COB_ID, 'extended': False} for cob_id in cob_ids])

    def _receive(self, timeout: float) -> tuple[int, bytes, float] | None:
        if not select((self._bus.socket,), (), (), timeout)[0]:
            return None
        content, ((_, _, stamp),), _, _ = self._bus.socket.recvmsg(_FLEXIBLE, _ANCILLARY)
        identifier, length, data = _FRAME.unpack_from(content)
        if len(content) > _FRAME.size:
            identifier |= _EXTENDED
        seconds, nanoseconds = _STAMP.unpack(stamp)
        return identifier, data[:length], seconds + 1e-9 * nanoseconds

    def _send(self, cob_id: int, data: bytes, sampled: float | None) -> None:
        self._bus.socket.send(_FRAME.pack(cob_id, len(data), data), socket.MSG_DONTWAIT)

    def _bus_off(self) -> str:
        return f'{super()._bus_off()}, then {restart_command(self._bus.channel)}'


def can_bus(bus: can.BusABC) -> CanBus:
    """Return the best access to an interface that python-can has opened, owned from now on."""
    if isinstance(bus, VirtualBus):
        bus.preserve_timestamps = True  # else it stamps what it carries
    return SocketCanBus(bus) if isinstance(bus, SocketcanBus) else CanBus(bus)


def _code(error: Exception) -> int | None:
    return getattr(error, 'error_code', None) or getattr(error, 'errno', None)


def _reason(error: Exception) -> str:
    return _DOWN.get(_code(error) or 0, str(error))


def _quietly(release: Callable[[], object]) -> None:
    """Release what may be gone already: an interface that vanished takes its sockets along."""
    try:
        release()
    except (can.CanError, OSError, ValueError):
        return
