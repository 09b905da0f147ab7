"""Simulated drives on a CAN bus, and the thread that provides frames and time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
import threading
import time

import can

from facade_manipulator.canopen.bus import CanBus, Frame, open_bus
from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.errors import BusError
from facade_manipulator.simulation.drives.drive import SimulatedDrive


class DriveSimulator(AbstractContextManager['DriveSimulator']):
    """Context manager of simulated drives that share one bus and are powered until it exits."""

    _LONGEST_WAIT = 0.1  # s, maximum time to stop while the bus is quiet
    _PAUSE = 0.05  # s, after an error of the bus, such as an interface that is down

    def __init__(self, bus: can.BusABC, drives: Sequence[SimulatedDrive]) -> None:
        self._bus = CanBus(bus)
        self._drives = tuple(drives)
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._thread = threading.Thread(
            target=self._run, name='drive simulator', daemon=True
        )
        self._thread.start()

    def stop(self) -> None:
        """Stop serving the drives; return after the thread has ended."""
        self._stopping.set()
        self._thread.join()
        self._bus.close()

    def __exit__(self, *details: object) -> None:
        self.stop()

    @contextmanager
    def access(self) -> Iterator[tuple[SimulatedDrive, ...]]:
        """
        Yield the drives to another thread, which may read them or inject faults.

        The drives are at the present time. Frames that the drives send as a result go to the bus
        when the context ends.

        """
        with self._lock:
            self._advance(None)
            yield self._drives
            self._advance(None)

    def apply_forces(self, forces: Sequence[float]) -> None:
        """Apply a force [N] along the rail to each carriage, until the next call."""
        for drive, force in zip(self._drives, forces, strict=True):
            drive.motor.external_force = force

    def _run(self) -> None:
        """Serve the drives until the end: pass on received frames and the time."""
        while not self._stopping.is_set():
            pause = min(drive.deadline for drive in self._drives) - time.monotonic()
            received = None
            try:
                received = self._bus.receive(min(max(pause, 0.0), self._LONGEST_WAIT))
            except BusError:  # drives continue while the interface is down
                self._stopping.wait(self._PAUSE)
            with self._lock:
                self._advance(received)

    def _advance(self, received: Frame | None) -> None:
        """Advance the drives to the time of a received frame; without a frame, to the present."""
        for drive in self._drives:
            frames = (
                drive.advance(time.monotonic())
                if received is None
                else drive.receive(received.cob_id, received.data, received.time)
            )
            for frame in frames:
                with suppress(BusError):  # a bus in error accepts no frame
                    self._bus.send(*frame, drive.now)


def start_simulator(bus: BusSettings, axes: Sequence[AxisSettings]) -> DriveSimulator:
    """Start the drives of `axes` on a bus; raise a BusError if the bus cannot be opened."""
    return DriveSimulator(open_bus(bus), [SimulatedDrive(axis) for axis in axes])
