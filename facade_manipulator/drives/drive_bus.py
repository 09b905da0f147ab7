"""CAN bus of the three drives, from opening to closing."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
import gc

from facade_manipulator.canopen import cob_ids
from facade_manipulator.canopen.bus import CanBus
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.sdo import expedited_download
from facade_manipulator.drives import realtime
from facade_manipulator.drives.axis import Axis
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.exchange import CyclicExchange
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.targets import TargetSupervisor
from facade_manipulator.errors import BusError


class DriveBus:
    """
    Bus opened by `open_bus`, and whether its drives are configured.

    The controller opens and closes the bus, and ends it after a loss. A lost bus is never opened
    again automatically; the operator requests cleanup, configure and home.
    """

    def __init__(
        self,
        open_bus: Callable[[], CanBus],
        settings: ControllerSettings,
        clock: Clock,
    ) -> None:
        self.exchange: CyclicExchange | None = None  #: present while the bus is open
        #: whether the drives are configured; they remain so when the bus is lost
        self.is_configured = False
        #: why the bus of configured drives is lost, ``''`` if it is not
        self.lost = ''
        #: the drives whose power the last cleanup has not confirmed off, as a message; ``''`` for
        #: none, or after the next configure
        self.unconfirmed = ''
        self.notes: tuple[str, ...] = ()  #: from configure
        self._open_bus = open_bus
        self._settings = settings
        self._clock = clock

    def open(self, group: Group, targets: TargetSupervisor) -> CyclicExchange:
        """Open the bus and listen without sending; raise a BusError if this fails."""
        bus = self._open_bus()
        realtime.freeze_objects()  # the first, full collection takes longer than a heartbeat
        serials = {axis.settings.serial_number: axis.name for axis in group.axes}
        for axis in group.axes:
            axis.connect(bus, self._clock, serials)
        self.exchange = CyclicExchange(bus, group, targets, self._settings, self._clock)
        return self.exchange

    def command(self, name: str, axes: Iterable[Axis]) -> None:
        """Send a network management command to drives; raise a BusError if this fails."""
        if self.exchange is not None:
            for axis in axes:
                self.exchange.command(name, axis)

    def take_notes(self, notes: Iterable[str]) -> None:
        """Store the notes of configure for the operator."""
        self.notes = tuple(notes)

    def confirm_configuration(self) -> None:
        """Record that the drives are configured."""
        self.is_configured = True
        self.unconfirmed = ''

    def leave_unconfirmed(self, message: str) -> None:
        """Record the drives that have not confirmed that they are without power."""
        self.unconfirmed = message

    def close(self, axes: Iterable[Axis], without_power: Collection[Axis]) -> None:
        """
        Put the drives into NMT pre-operational, and close the bus.

        Drives without power no longer monitor this master, so that no drive reports its loss. Any
        other drive stops by itself when it misses the heartbeat.
        """
        exchange = self.exchange
        if exchange is not None:
            # the drives notice the missing heartbeat by themselves
            with suppress(BusError):
                # drives of another master are left unchanged
                if exchange.transmitter.sends_heartbeats:
                    self.command('PRE-OPERATIONAL', axes)
                for axis in without_power:  # the answers are not awaited
                    exchange.bus.send(
                        cob_ids.SDO_REQUEST + axis.settings.node_id,
                        expedited_download(*axis.profile.heartbeat_consumer, bytes(4)),
                    )
            exchange.bus.close()
        gc.unfreeze()
        self.exchange = None
        self.is_configured = False
        self.lost = ''
        self.notes = ()

    def lose(self, reason: str) -> None:
        """Stop sending, so that the drives stop by themselves."""
        if self.exchange is not None:
            self.exchange.bus.close()
        self.exchange = None
        if self.is_configured:
            self.lost = reason
