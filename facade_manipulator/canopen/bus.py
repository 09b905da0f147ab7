"""
A CAN bus of python-can: frames in and out, SYNC of the kernel, error frames, statistics.

python-can's Notifier is not used, because its thread ends with the first error of the link: the
owner of a `CanBus` calls `CanBus.receive` in one thread, and gets every error as a `BusError`.

References
----------
Linux kernel, include/uapi/linux/can/error.h: classes and data bytes of error frames.

"""

from __future__ import annotations

from contextlib import suppress
from enum import IntEnum
import errno
from threading import Lock
import time
from typing import NamedTuple

import can
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.socketcan.socketcan import create_bcm_socket
from can.interfaces.virtual import VirtualBus

from facade_manipulator.canopen.link import restart_command
from facade_manipulator.canopen.nmt import NmtCommand
from facade_manipulator.canopen.pdo import NMT_COB_ID, SYNC_COB_ID
from facade_manipulator.errors import BusError

LATEST_STAMP_AGE = 10.0  # s: an older stamp is of another clock
MAX_COB_ID = 0x7FF
NO_KERNEL_SYNC = (
    'the control loop sends SYNC, because the kernel has no CAN broadcast manager; with less '
    'jitter: sudo modprobe can-bcm, then cleanup and configure')
_ERRORS = (can.CanError, OSError, ValueError)  # of an interface that is down, gone or closed


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


# error class in the identifier, or bits of data[1] in a controller problem, and what they mean
_ERROR_CLASSES = ((0x040, Condition.OFF), (0x100, Condition.ACTIVE))
_CONTROLLER_PROBLEM, _OVERFLOW = 0x004, 0x03
_CONTROLLER_BITS = (
    (0x30, Condition.PASSIVE), (0x0C, Condition.WARNING), (0x40, Condition.ACTIVE))
_FULL = (errno.ENOBUFS, errno.EAGAIN)  # the queue of the interface, of the socket
_DOWN = {
    errno.ENETDOWN: 'the CAN interface is down',
    errno.ENODEV: 'the CAN interface has vanished',
    errno.ENXIO: 'the CAN interface has vanished',
    errno.EBADF: 'the CAN socket is closed'}


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
    sync_note = ''  #: why the kernel of a SocketCAN interface does not send SYNC

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self._sending = Lock()
        self._sync_task: can.CyclicSendTaskABC | None = None
        self._received = self._sent = self._ignored = 0
        self._error_frames = self._overflows = 0
        self._condition = Condition.ACTIVE
        self.is_virtual = isinstance(bus, VirtualBus)  # within this process: there is no cable
        if isinstance(bus, VirtualBus):
            bus.preserve_timestamps = True  # frames of simulated drives have their own
        if isinstance(bus, SocketcanBus):
            try:  # the kernel loads its module, if it has it
                create_bcm_socket(bus.channel).close()
                self.has_kernel_sync = True
            except OSError:
                self.sync_note = NO_KERNEL_SYNC

    def __str__(self) -> str:
        return str(self._bus.channel_info)

    @property
    def statistics(self) -> BusStatistics:
        """Counters and the controller's condition."""
        return BusStatistics(
            self._received, self._sent, self._ignored, self._error_frames, self._overflows,
            self._condition)

    def listen_to(self, cob_ids: tuple[int, ...]) -> None:
        """Let the kernel drop every other frame, on SocketCAN."""
        if isinstance(self._bus, SocketcanBus):
            self._bus.set_filters([
                {'can_id': cob_id, 'can_mask': MAX_COB_ID, 'extended': False}
                for cob_id in cob_ids])

    def receive(self, timeout: float) -> Frame | None:
        """
        Wait for the next standard data frame [s]; return None after that or for one not for us.

        Raises a BusError if the interface is down or gone, or its controller is bus-off.
        """
        try:
            # the method that each interface of python-can implements: `recv` around it counts on
            # the system clock, and would wait longer if that is set back
            message, _ = self._bus._recv_internal(max(0.0, timeout))
        except _ERRORS as error:
            raise BusError(f'{self}: {_reason(error)}') from error
        if message is None:
            return None
        if message.is_error_frame:
            self._note_error(message.arbitration_id, bytes(message.data))
            return None
        if message.is_extended_id or message.is_remote_frame or message.is_fd:
            self._ignored += 1
            return None
        self._received += 1
        age = time.time() - message.timestamp
        if not 0.0 <= age < LATEST_STAMP_AGE:
            age = 0.0  # the system clock was set since
        return Frame(message.arbitration_id, bytes(message.data), time.monotonic() - age,
                     message.timestamp)

    def send(self, cob_id: int, data: bytes = b'', sampled: float | None = None) -> None:
        """
        Send a standard data frame without waiting.

        `sampled` is the monotonic time of the content [s], which a virtual bus carries as the
        frame's stamp. Raises a BusCongestedError if the interface's queue is full, a BusError if
        it is down or gone.
        """
        age = 0.0 if sampled is None else time.monotonic() - sampled
        message = can.Message(time.time() - age, cob_id, is_extended_id=False, data=data)
        try:
            with self._sending:
                self._bus.send(message)
        except _ERRORS as error:
            raise self._send_error(error) from error
        self._sent += 1

    def command(self, command: NmtCommand, node_id: int) -> None:
        """Send a network management command to one node, 0 for all; raises what `send` does."""
        self.send(NMT_COB_ID, bytes([command, node_id]))

    def start_sync(self, period: float) -> None:
        """Let the kernel send SYNC, without jitter of Python; a BusError if that cannot be."""
        message = can.Message(arbitration_id=SYNC_COB_ID, is_extended_id=False)
        try:
            self._sync_task = self._bus.send_periodic(message, period)
        except _ERRORS as error:
            raise BusError(f'{self}: no SYNC from the kernel, {_reason(error)}') from error

    def stop_sync(self) -> None:
        """Stop the kernel's SYNC; harmless without one."""
        task, self._sync_task = self._sync_task, None
        if task is not None:
            with suppress(*_ERRORS):  # an interface that vanished took its sockets along
                task.stop()

    def close(self) -> None:
        """Send nothing more and give the interface back; never raises."""
        self.stop_sync()
        with suppress(*_ERRORS):
            self._bus.shutdown()

    def _note_error(self, error_class: int, data: bytes) -> None:
        """Note what the controller reports of itself; raise a BusError if it is bus-off."""
        self._error_frames += 1
        if error_class & _CONTROLLER_PROBLEM and len(data) > 1:
            self._overflows += bool(data[1] & _OVERFLOW)
        condition = condition_of(error_class, data)
        if condition is not None:
            self._condition = condition
        if condition is Condition.OFF:
            cure = (f', then {restart_command(self._bus.channel)}'
                    if isinstance(self._bus, SocketcanBus) else '')
            raise BusError(
                f'{self}: the controller is bus-off, check bit rate and wiring{cure}')

    def _send_error(self, error: Exception) -> BusError:
        code = _code(error)
        if code in _FULL or (code is None and 'full' in str(error).lower()):
            return BusCongestedError(
                f'{self}: the send queue is full, no node acknowledges frames '
                '(power of the drives, wiring, bit rate)')
        return BusError(f'{self}: {_reason(error)}')


def _code(error: Exception) -> int | None:
    return getattr(error, 'error_code', None) or getattr(error, 'errno', None)


def _reason(error: Exception) -> str:
    return _DOWN.get(_code(error) or 0, str(error))
