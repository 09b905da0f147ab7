"""
The drives and their bus; used only in the control thread.

A lost bus is not opened again by itself: the drives stay stopped, and their positions are invalid,
until the operator requests cleanup, configure and home.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, replace
import gc
from typing import Any

import can

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.bus import CanBus
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.nmt import NmtCommand
from facade_manipulator.canopen.sdo import expedited_download, SdoChannel
from facade_manipulator.drives import realtime
from facade_manipulator.drives.axis_settings import AXIS_NAMES, AxisSettings, check_axes
from facade_manipulator.drives.configuration import check_bus_load, object_writes
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.drive_access import Drive
from facade_manipulator.drives.exchange import CyclicExchange
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.monitor import AxisMonitor
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.snapshot import Cause, ControllerState, Remedy
from facade_manipulator.drives.targets import MechanismChecks, TargetSupervisor
from facade_manipulator.errors import BusError


@dataclass(frozen=True)
class BusAccess:
    """The bus: how to open it (or raise the reason against it), its bit rate [bit/s] and name."""

    open: Callable[[], CanBus]
    bitrate: int = 1_000_000
    name: str = 'the bus'


class Session:
    """
    Three drives, whose axes are q1, q2, q3, and their bus.

    Raises a ParameterError if settings contradict each other, a drive profile is missing, or the
    bus load is too high.

    Attributes
    ----------
    exchange : CyclicExchange or None
        Present while the bus is open.
    drives : tuple of Drive
        The objects of the drives by SDO; empty while the bus is closed.
    group : Group
        The state machine of the drives.
    is_configured : bool
        Whether the drives are configured; they remain so when the bus is lost.
    lost : str
        The reason why the bus of configured drives is lost, ``''`` if it is not.
    forbidden : str
        The reason why no drive may have power, ``''`` if it may; set by any thread.

    """

    def __init__(
        self, settings: ControllerSettings, axes: tuple[AxisSettings, ...], bus: BusAccess,
        mechanism: MechanismChecks, clock: Clock | None = None,
    ) -> None:
        check_axes(axes)
        self.settings = settings = replace(  # a step may be to stop
            settings, step_timeout=settings.step_timeout + max(axis.stop_time for axis in axes))
        self._profiles = tuple(load_profile(axis.profile) for axis in axes)
        self.bus_load = check_bus_load(
            settings, bus.bitrate, [profile.pdos for profile in self._profiles])
        self.axes = tuple(
            profile.applied(axis) for axis, profile in zip(axes, self._profiles, strict=True))
        for profile, axis in zip(self._profiles, self.axes, strict=True):
            object_writes(profile, axis, settings)
        self.targets = TargetSupervisor(self.axes, settings, mechanism)
        self.clock = clock or Clock()
        # one thread for each drive: its transfers never overlap, and no drive waits for another
        self._workers = {name: self.clock.workers(1, f'objects of {name}') for name in AXIS_NAMES}
        self.bus = bus
        self.forbidden, self.is_closed = '', False
        self._forget()

    def _forget(self) -> None:
        self.exchange: CyclicExchange | None = None
        self.drives: tuple[Drive, ...] = ()
        self.group = Group(self.axes, self.settings, self.now)
        self.is_configured = False
        self.lost = ''
        self.notes: tuple[str, ...] = ()  #: from configure
        self.monitors = tuple(
            AxisMonitor(name, axis, self.settings, profile)
            for name, axis, profile in zip(AXIS_NAMES, self.axes, self._profiles, strict=True))

    @property
    def now(self) -> float:
        """The time on the monotonic clock [s]."""
        return self.clock.monotonic()

    @property
    def unhomed(self) -> list[str]:
        """Names of the axes that must be homed."""
        return [one.name for one in self.monitors if not one.encoder.homed]

    def has_done(self, *states: ControllerState) -> bool:
        """Return whether all drives have reached one of these states of the group."""
        return self.group.state in states and self.group.is_settled

    def submit(self, work: Callable[[Drive], Any], drive: Drive) -> Future[Any]:
        """Let the worker thread of a drive do something with its objects."""
        return self._workers[drive.monitor.name].submit(work, drive)

    # --- the bus: opened, closed, lost

    def open(self) -> CyclicExchange:
        """Open the bus and listen; nothing is sent. Raises a BusError."""
        try:
            bus = self.bus.open()
        except (can.CanError, OSError, ValueError) as error:
            raise BusError(f'the CAN bus cannot be opened: {error}') from error
        realtime.freeze_objects()  # the first, full collection takes longer than a heartbeat
        exchange = CyclicExchange(bus, self.monitors, self.settings, self.targets, self.clock)
        serials = {one.axis.serial_number: one.name for one in self.monitors}
        self.drives = tuple(
            Drive(one, SdoChannel(
                exchange.network, one.axis.node_id, one.name, one.profile.eds, clock=self.clock),
                self.settings, serials, self.clock)
            for one in self.monitors)
        self.exchange = exchange
        return exchange

    def command(self, command: NmtCommand, monitors: Iterable[AxisMonitor]) -> None:
        """Send a network management command to drives; raises a BusError."""
        if self.exchange is not None:
            for one in monitors:
                self.exchange.bus.command(command, one.axis.node_id)

    def close(self) -> None:
        """Leave the drives in NMT pre-operational, close the bus, forget everything."""
        if self.exchange is not None:
            self.exchange.stop()
            if self.exchange.transmits:  # else they are another master's
                self._leave_operational(self.exchange.bus)
            self.exchange.close()
        gc.unfreeze()
        self._forget()

    def _leave_operational(self, bus: CanBus) -> None:
        """End the drives' watch of our heartbeat, so that none reports a lost master."""
        with suppress(BusError):  # the drives notice the missing heartbeat by themselves
            for one in self.monitors:
                bus.command(NmtCommand.ENTER_PRE_OPERATIONAL, one.axis.node_id)
                # its answer is not awaited
                bus.send(
                    pdo.sdo_request_cob_id(one.axis.node_id),
                    expedited_download(*one.profile.heartbeat_consumer, bytes(4)))

    def lose(self, error: BusError) -> None:
        """Send nothing more, so that the drives stop by themselves; forget their positions."""
        if self.exchange is not None:
            self.exchange.close()
        self.exchange, self.drives = None, ()
        for monitor in self.monitors:
            monitor.lose()
        if self.is_configured:
            self.lost = str(error)
            self.group.stop(Cause(self.lost, Remedy.BUS, configure_again=True), self.now)
