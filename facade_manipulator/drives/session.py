"""
The drives, the bus they are on, and what became of both; used in the control thread alone.

A lost bus is not opened again by itself: the drives stay stopped, and their positions count for
nothing, until the operator cleans up, configures and homes.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, replace

import can

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.bus import CanBus
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.nmt import NmtCommand
from facade_manipulator.canopen.sdo import expedited_download, SdoChannel
from facade_manipulator.drives.axis_settings import AXIS_NAMES, AxisSettings, check_axes
from facade_manipulator.drives.bus_load import check_bus_load
from facade_manipulator.drives.cause import Cause, Remedy
from facade_manipulator.drives.commissioning import Commissioning, Drive
from facade_manipulator.drives.configuration import object_writes
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.exchange import CyclicExchange
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.monitor import AxisMonitor, require_dead_master_stop
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.realtime import GarbageCollectionPause
from facade_manipulator.drives.states import Power
from facade_manipulator.drives.targets import MechanismChecks, TargetSupervisor
from facade_manipulator.errors import BusError, DriveStateError


@dataclass(frozen=True)
class BusAccess:
    """How to open the bus, which `open` returns or raises why not; bit rate in bit/s; its name."""

    open: Callable[[], CanBus]
    bitrate: int = 1_000_000
    name: str = 'the bus'


class Session:
    """
    Three drives, whose axes are q1, q2, q3, and their bus.

    Raises a ParameterError if settings contradict each other, a drive profile is missing, or the
    bus load is too high.
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
            settings, bus.bitrate, tuple(profile.pdos for profile in self._profiles))
        self.axes = tuple(
            profile.applied(axis)
            for axis, profile in zip(axes, self._profiles, strict=True))
        for profile, axis in zip(self._profiles, self.axes, strict=True):
            object_writes(profile, axis, settings)
        self.targets = TargetSupervisor(self.axes, settings, mechanism)
        self.clock = clock or Clock()
        self.worker = self.clock.workers(1, 'drive objects')
        self.collector = GarbageCollectionPause()
        #: why no drive may have power, ``''`` if it may; set by any thread
        self.forbidden = ''
        #: whether it has ended for good
        self.is_closed = False
        self.bus = bus
        self._forget()

    def _forget(self) -> None:
        #: with the open bus
        self.exchange: CyclicExchange | None = None
        #: the worker's access to the drives on it
        self.commissioning: Commissioning | None = None
        #: the state machine, once the drives are configured
        self.group: Group | None = None
        #: why the bus of configured drives is gone, ``''`` if it is not
        self.lost = ''
        self._asked: Future[list[str]] | None = None
        #: what was skipped at configure
        self.notes: tuple[str, ...] = ()
        self.monitors = tuple(
            AxisMonitor(name, axis, self.settings, profile)
            for name, axis, profile in zip(
                AXIS_NAMES, self.axes, self._profiles, strict=True))

    @property
    def unhomed(self) -> list[str]:
        """Names of the axes that must be homed."""
        return [one.name for one in self.monitors if not one.encoder.homed]

    @property
    def is_powered(self) -> bool:
        """Return whether the drives are meant to have power."""
        return self.group is not None and self.group.state.has_power

    @property
    def is_stopped(self) -> bool:
        """Return whether something has stopped the drives and was not cleared yet."""
        return self.group is not None and self.group.is_stopped

    @property
    def is_off(self) -> bool:
        """Return whether all drives have confirmed that they have no power."""
        return self.has_done(ControllerState.INACTIVE)

    def require_open(self, request: str) -> tuple[CyclicExchange, Commissioning]:
        """Return the bus and the worker's access to the drives; a BusError if it is not open."""
        if self.lost:
            raise BusError(f'{request} is not possible, the bus is lost: {self.lost}')
        if self.exchange is None or self.commissioning is None:
            raise BusError(f'{request} is not possible, the bus is not open')
        return self.exchange, self.commissioning

    def require_power_allowed(self, request: str) -> None:
        """Raise a DriveStateError if power is forbidden, or would stay on without this master."""
        require_dead_master_stop(request, self.monitors, self.settings)
        if self.forbidden:
            raise DriveStateError(f'{request} is not possible: {self.forbidden}')

    def watch_stop(self) -> None:
        """Let the worker ask the drives for their errors, once, when they stand still."""
        if self.group is None or not self.group.is_stopped:
            self._asked = None
        elif (self._asked is None and self.commissioning is not None
              and self.group.state is ControllerState.STOPPED):
            self._asked = self.worker.submit(self.commissioning.errors)

    @property
    def drive_errors(self) -> tuple[str, ...]:
        """What the drives answered after the stop."""
        job = self._asked
        if job is None or not job.done() or job.exception() is not None:
            return ()
        return tuple(job.result())

    def unconfirmed(self, since: float) -> list[AxisMonitor]:
        """Return the drives that have not said since a time [s] that they have no power."""
        return [one for one in self.monitors if one.answers.newest <= since
                or one.snapshot(None, since).power is not Power.CONFIRMED_OFF]

    def has_done(self, state: ControllerState) -> bool:
        """Return whether all drives are where a state wants them."""
        return self.group is not None and self.group.state is state and self.group.is_settled

    # --- the bus: opened, closed, lost

    def open(self) -> tuple[CyclicExchange, Commissioning]:
        """Open the bus and listen; nothing is sent. A BusError says why it cannot be opened."""
        try:
            bus = self.bus.open()
        except (can.CanError, OSError, ValueError) as error:
            raise BusError(f'the CAN bus cannot be opened: {error}') from error
        if self.settings.own_garbage_collection:
            self.collector.start()  # its first, full collection takes longer than a heartbeat
        exchange = CyclicExchange(bus, self.monitors, self.settings, self.targets, self.clock)
        drives = tuple(
            Drive(one, SdoChannel(
                exchange.network, one.axis.node_id, one.name, one.profile.eds,
                clock=self.clock))
            for one in self.monitors)
        commissioning = Commissioning(bus, drives, self.settings, exchange.is_closing, self.clock)
        self.exchange, self.commissioning = exchange, commissioning
        return exchange, commissioning

    def start_cycle(self, exchange: CyclicExchange, now: float) -> Group:
        """Let the cycle run, with all drives switched off."""
        self.collector.keep()  # what configuring has made would cost the first collection a cycle
        self.group = group = Group(AXIS_NAMES, self.settings, now)
        exchange.start(group, self.clock.monotonic())
        return group

    def close(self) -> None:
        """Leave the drives in NMT pre-operational, close the bus, forget everything."""
        if self.exchange is not None:
            self.exchange.stop()
            if self.exchange.transmits:  # else they are another master's, or lost
                self._leave_operational(self.exchange.bus)
        self.let_go()

    def let_go(self) -> None:
        """Close the bus without a word to the drives, forget everything."""
        if self.exchange is not None:
            self.exchange.close()
        self.collector.stop()
        self._forget()

    def _leave_operational(self, bus: CanBus) -> None:
        """Let the drives miss nobody from now on, so that none reports a lost master."""
        try:
            for one in self.monitors:
                bus.command(NmtCommand.ENTER_PRE_OPERATIONAL, one.axis.node_id)
                # its answer is not awaited
                bus.send(
                    pdo.sdo_request_cob_id(one.axis.node_id),
                    expedited_download(*one.profile.heartbeat_consumer, bytes(4)))
        except BusError:
            pass  # the drives notice the missing heartbeat by themselves

    def lose(self, error: BusError, now: float) -> None:
        """Send nothing more, so that the drives stop by themselves; forget their positions."""
        if self.exchange is not None:
            self.exchange.close()
            self.exchange = self.commissioning = None
        for monitor in self.monitors:
            monitor.lose()
        if self.group is not None:
            self.lost = str(error)
            self.group.stop(Cause(self.lost, Remedy.BUS, configure_again=True), now)
