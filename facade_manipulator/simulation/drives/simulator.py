"""Simulated drives on a CAN bus: the thread that carries frames and time to them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import threading
import time

import can

from facade_manipulator.drives.canopen.bus import BusCongestedError, can_bus, CanBus
from facade_manipulator.drives.canopen.bus import Frame as ReceivedFrame
from facade_manipulator.drives.canopen.link import BusSettings, open_bus
from facade_manipulator.drives.cia402.settings import AxisSettings
from facade_manipulator.errors import BusError
from facade_manipulator.simulation.drives.drive import simulated_drives, SimulatedDrive
from facade_manipulator.simulation.drives.node import Frame

_LONGEST_WAIT = 0.1  # s: how long stopping may take when the bus is quiet
_FIRST_PAUSE, _LONGEST_PAUSE = 0.02, 0.5  # s: after an error of the bus


class DriveSimulator:
    """
    Simulated drives that share one bus.

    `open_bus` returns it, or raises a BusError; it is called again after an error.
    """

    def __init__(
        self, open_bus: Callable[[], can.BusABC], drives: Sequence[SimulatedDrive]
    ) -> None:
        self._open_bus = open_bus
        self._bus: CanBus | None = None
        self._drives = tuple(drives)
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._pause = 0.0
        self._retry = 0.0
        self.bus_errors = 0  #: how often sending or receiving has failed

    def start(self) -> None:
        """Give the drives power: they boot; raises a BusError if the bus cannot be opened."""
        if self._thread is None:
            self._bus = can_bus(self._open_bus())
            self._stopping.clear()
            self._thread = threading.Thread(target=self._run, name='drive simulator', daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Take the drives off the bus; returns when the thread has ended."""
        self._stopping.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join()
            self._close_bus()

    def __enter__(self) -> DriveSimulator:
        self.start()
        return self

    def __exit__(self, *details: object) -> None:
        self.stop()

    @contextmanager
    def access(self) -> Iterator[tuple[SimulatedDrive, ...]]:
        """
        Lend the drives to another thread, for reading them or injecting faults.

        What they have to say about it goes to the bus when the context ends.

        """
        with self._lock:
            yield self._drives
            self._advance(None)

    def apply_forces(self, forces: Sequence[float]) -> None:
        """Let forces along the rail [N] pull at the carriages, one for each drive, from now on."""
        with self._lock:
            for drive, force in zip(self._drives, forces, strict=True):
                drive.motor.external_force = force

    def _run(self) -> None:
        with self._lock:
            now = time.monotonic()
            for drive in self._drives:
                drive.advance(now)
                drive.reboot()
        while not self._stopping.is_set():
            received = self._receive()
            with self._lock:
                self._advance(received)

    def _advance(self, received: ReceivedFrame | None) -> None:
        """Let the drives live until a frame came, however late this thread is, or until now."""
        for drive in self._drives:
            self._send(drive.advance(time.monotonic()) if received is None else
                       drive.receive(received.cob_id, received.data, received.time), drive.now)

    def _receive(self) -> ReceivedFrame | None:
        """Wait for a frame until a drive wants to be called; time passes on a dead bus, too."""
        with self._lock:
            deadline = min((drive.deadline for drive in self._drives), default=0.0)
        now = time.monotonic()
        wait = min(max(deadline - now, 0.0), _LONGEST_WAIT)
        if now < self._retry:
            self._stopping.wait(min(wait, self._retry - now))
            return None
        try:
            bus = self._bus = self._bus or can_bus(self._open_bus())
            received = bus.receive(wait)
        except BusError as error:
            self._note_error(error)
            return None
        if received is not None:
            self._pause = 0.0
        return received

    def _send(self, frames: list[Frame], now: float) -> None:
        bus = self._bus
        if bus is None or time.monotonic() < self._retry:
            return  # nobody would receive it
        try:
            for cob_id, data in frames:
                bus.send(cob_id, data, now)
        except BusError as error:
            self._note_error(error)

    def _note_error(self, error: BusError) -> None:
        self.bus_errors += 1
        self._pause = min(max(2.0 * self._pause, _FIRST_PAUSE), _LONGEST_PAUSE)
        self._retry = time.monotonic() + self._pause
        if not isinstance(error, BusCongestedError):  # what was received waits in the socket
            self._close_bus()

    def _close_bus(self) -> None:
        bus, self._bus = self._bus, None
        if bus is not None:
            bus.close()


def start_simulator(bus: BusSettings, axes: Sequence[AxisSettings]) -> DriveSimulator:
    """Start the drives of `axes` on a bus; raises a BusError if that cannot be opened."""
    simulator = DriveSimulator(lambda: open_bus(bus), simulated_drives(axes))
    simulator.start()
    return simulator
