"""
CAN bus of python-can: frames, SYNC sent by the kernel, error frames and statistics.

The thread of python-can's Notifier ends with the first error of the link. Instead, the owner of a
`CanBus` calls `CanBus.receive` in one thread, and each error is raised there as a `BusError`.

References
----------
Linux kernel, include/uapi/linux/can/error.h: classes and data bytes of error frames.

"""

from __future__ import annotations

from contextlib import suppress
import errno
import time
from typing import Any, NamedTuple

import can
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.socketcan.socketcan import create_bcm_socket
from can.interfaces.virtual import VirtualBus

from facade_manipulator.canopen import cob_ids, nmt
from facade_manipulator.canopen.link import (
    BusSettings,
    BusStatistics,
    check_link,
    restart_command,
)
from facade_manipulator.errors import BusError


class BusCongestedError(BusError):
    """The send queue is full: no node acknowledges frames, or the queue is too short."""


class _SentMessage(can.Message):
    """Message that its sender never changes; the virtual bus saves a copy of 10 us."""

    __slots__ = ()

    def __deepcopy__(self, memo: dict[int, Any] | None) -> _SentMessage:
        return self


class Frame(NamedTuple):
    """Standard frame with its times of reception."""

    cob_id: int  #: with the bit `cob_ids.REMOTE_FRAME` for a remote frame
    data: bytes
    time: float  #: time of reception on the monotonic clock [s]
    stamp: float  #: time of reception on the system clock [s]
    #: whether SocketCAN marks the frame as sent on this computer
    is_local: bool = False


def open_bus(settings: BusSettings) -> can.BusABC:
    """
    Return the opened CAN interface.

    Raises a BusError if the interface is missing, down or bus-off, runs at another bit rate or
    cannot be opened. The message names the next step.
    """
    if settings.interface == 'socketcan':
        check_link(settings.channel, settings.bitrate)
    try:
        return can.Bus(  # a user's can.conf could make a bus receive its own frames
            interface=settings.interface,
            channel=settings.channel,
            bitrate=settings.bitrate,
            ignore_config=True,
        )
    except (
        can.CanError,
        OSError,
        ValueError,
        ImportError,
        NotImplementedError,
    ) as error:
        raise BusError(
            f'{settings.interface} {settings.channel} cannot be opened: {error}; '
            'next: check bus.interface, bus.channel and the adapter'
        ) from error


class CanBus:
    """Owner of a python-can bus, which sends and receives frames; only one thread may send."""

    MAXIMUM_STAMP_AGE = 10.0  # s; an older stamp comes from another clock
    NO_KERNEL_SYNC = (
        'the control loop sends SYNC, because the kernel has no CAN broadcast manager; next: '
        'sudo modprobe can-bcm, then cleanup and configure, for less jitter'
    )
    # the queue of the interface is full, that of the socket
    _FULL = (errno.ENOBUFS, errno.EAGAIN)
    # the interface is down, gone or closed
    _ERRORS = (
        can.CanError,
        OSError,
        ValueError,
    )
    # error classes in the identifier of an error frame
    _CONTROLLER_PROBLEM = 0x004
    _BUS_OFF = 0x040
    _RESTARTED = 0x100
    # bits of data[1] for a controller problem
    _OVERFLOWS = 0x03
    _CONDITIONS = {0x30: 'passive', 0x0C: 'warning', 0x40: 'active'}  # the worst first

    has_kernel_sync = False
    sync_note = ''  #: reason why the kernel of a SocketCAN interface does not send SYNC

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self._sync_task: can.CyclicSendTaskABC | None = None
        #: counters, and the condition of the controller
        self.statistics = BusStatistics()
        #: whether the bus is within this process, without a cable
        self.is_virtual = isinstance(bus, VirtualBus)
        if isinstance(bus, VirtualBus):
            # frames of simulated drives have their own stamps
            bus.preserve_timestamps = True
        if isinstance(bus, SocketcanBus):
            try:  # the kernel loads its module if it is available
                create_bcm_socket(bus.channel).close()
                self.has_kernel_sync = True
            except OSError:
                self.sync_note = self.NO_KERNEL_SYNC

    def __str__(self) -> str:
        hint = " (python-can's bus within one process: no real drive is on it)"
        return f'{self._bus.channel_info}{hint if self.is_virtual else ""}'

    def listen_to(self, wanted: tuple[int, ...]) -> None:
        """
        On SocketCAN, let the kernel drop all frames except those with the given COB-IDs.

        Data frames and remote frames with these COB-IDs are received, and error frames.
        """
        if not isinstance(self._bus, SocketcanBus):
            return
        identifiers = {one & cob_ids.COB_ID_BITS for one in wanted}
        self._bus.set_filters(
            [
                {'can_id': one, 'can_mask': cob_ids.COB_ID_BITS, 'extended': False}
                for one in sorted(identifiers)
            ]
        )

    def receive(self, timeout: float) -> Frame | None:
        """
        Return the next frame within a timeout [s]; None without a frame, or for other frame types.

        Raises a BusError if the interface is down or gone, or its controller is bus-off.
        """
        try:
            # This method is implemented by each interface of python-can. The `recv` around it uses
            # the system clock, and would wait longer after this clock is set back.
            message, _ = self._bus._recv_internal(max(0.0, timeout))
        except self._ERRORS as error:
            raise self._error(error) from error
        if message is None:
            return None
        if message.is_error_frame:
            self._note_error(
                message.arbitration_id, bytes(message.data).ljust(2, b'\0')[1]
            )
            return None
        if message.is_extended_id or message.is_fd:
            self.statistics.ignored += 1
            return None
        self.statistics.received += 1
        age = time.time() - message.timestamp
        if not 0.0 <= age < self.MAXIMUM_STAMP_AGE:
            age = 0.0  # the system clock was set after reception
        remote = cob_ids.REMOTE_FRAME if message.is_remote_frame else 0
        return Frame(
            message.arbitration_id | remote,
            bytes(message.data),
            time.monotonic() - age,
            message.timestamp,
            is_local=not message.is_rx,
        )

    def send(
        self, cob_id: int, data: bytes = b'', sampled: float | None = None
    ) -> None:
        """
        Send a standard data frame without waiting.

        `sampled` is the time at which the content of the frame was measured [s, monotonic], by
        default now. Only simulated drives pass another time. A virtual bus carries this time as
        the stamp of the frame; other interfaces ignore it. Raises a BusCongestedError if the
        interface's queue is full, a BusError if the interface is down or gone.
        """
        age = 0.0 if sampled is None else time.monotonic() - sampled
        message = _SentMessage(
            time.time() - age, cob_id, is_extended_id=False, data=data
        )
        try:
            self._bus.send(message)
        except self._ERRORS as error:
            raise self._error(error) from error
        self.statistics.sent += 1

    def command(self, name: str, node_id: int) -> None:
        """
        Send a network management command to a node; node 0 addresses all. Raises as `send`.

        The library names a command after the state that follows, such as ``'OPERATIONAL'``.
        """
        self.send(cob_ids.NMT, nmt.command(name, node_id))

    def start_sync(self, period: float) -> None:
        """Let the kernel send SYNC once a period [s]; raise a BusError if this is impossible."""
        message = can.Message(arbitration_id=cob_ids.SYNC, is_extended_id=False)
        try:
            self._sync_task = self._bus.send_periodic(message, period)
        except self._ERRORS as error:
            raise self._error(error) from error

    def stop_sync(self) -> None:
        """Stop the kernel's SYNC if it is running."""
        task = self._sync_task
        self._sync_task = None
        if task is not None:
            # the sockets of a removed interface are already closed
            with suppress(*self._ERRORS):
                task.stop()

    def close(self) -> None:
        """Stop SYNC and close the interface; never raises."""
        self.stop_sync()
        with suppress(*self._ERRORS):
            self._bus.shutdown()

    def _note_error(self, error_class: int, bits: int) -> None:
        """
        Record the state of the CAN controller that an error frame reports.

        Raises a BusError for bus-off.
        """
        noted = self.statistics
        noted.error_frames += 1
        if error_class & self._BUS_OFF:
            noted.condition = 'off'
            raise BusError(
                f'{self}: the controller is bus-off; next: check bit rate and wiring, '
                f'then {restart_command(getattr(self._bus, "channel", str(self)))}'
            )
        if error_class & self._RESTARTED:
            noted.condition = 'active'
        elif error_class & self._CONTROLLER_PROBLEM:
            if bits & self._OVERFLOWS:  # of the queues of the controller
                noted.overflows += 1
            for mask, condition in self._CONDITIONS.items():
                if bits & mask:
                    noted.condition = condition
                    break

    def _error(self, error: Exception) -> BusError:
        """Convert an error of the interface to an error of this bus."""
        code = getattr(error, 'error_code', None) or getattr(error, 'errno', None)
        if code in self._FULL or (code is None and 'full' in str(error).lower()):
            return BusCongestedError(
                f'{self}: the send queue is full, because no node acknowledges frames; '
                'next: check power of the drives, wiring and bit rate'
            )
        return BusError(f'{self}: {error}')
