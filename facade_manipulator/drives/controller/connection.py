"""What exists once per opened bus: frames, SDO, commissioning and the cyclic exchange."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import can

from facade_manipulator.drives.canopen import CanBus, NmtCommand, PumpedNetwork, SdoChannel
from facade_manipulator.drives.cia402 import Cause, DriveProfile
from facade_manipulator.drives.controller.commissioning import Commissioning, Drive, send_nmt
from facade_manipulator.drives.controller.monitor import AxisMonitor
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.drives.controller.stream import Stream
from facade_manipulator.drives.controller.targets import Targets
from facade_manipulator.errors import BusError


@dataclass(frozen=True)
class Connection:
    """An opened bus and what works on it."""

    bus: CanBus
    stream: Stream
    commissioning: Commissioning
    monitors: tuple[AxisMonitor, ...]

    def close(self) -> None:
        """Let go of the bus; whoever waits for an answer gives up."""
        self.stream.hearing.cancel()
        self.stream.stop()
        self.bus.close()

    def leave(self) -> None:
        """Send the drives to NMT pre-operational, then close."""
        self.stream.stop()
        try:
            for monitor in self.monitors:
                send_nmt(self.bus, NmtCommand.ENTER_PRE_OPERATIONAL, monitor.axis.node_id)
        except BusError:
            pass  # the drives notice the missing heartbeat by themselves
        self.close()


def open_frames(
    open_bus: Callable[[], can.BusABC], tap: Callable[[float, int, bytes], None] | None
) -> CanBus:
    """
    Open the bus; `tap` as for `CanBus`.

    Raises
    ------
    BusError
        Whatever `open_bus` raises.

    """
    try:
        return CanBus(open_bus(), tap)
    except (can.CanError, OSError, ValueError) as error:
        raise BusError(f'the CAN bus cannot be opened: {error}') from error


def connect(
    bus: CanBus, monitors: tuple[AxisMonitor, ...], profiles: tuple[DriveProfile, ...],
    settings: ControllerSettings, targets: Targets,
    supervise: Callable[[float], list[Cause]], on_cycle: Callable[[float], None],
) -> Connection:
    """Build everything that works on an opened bus."""
    network = PumpedNetwork(bus)
    drives = tuple(
        Drive(monitor, SdoChannel(network, monitor.axis.node_id, monitor.name, profile.eds),
              profile)
        for monitor, profile in zip(monitors, profiles, strict=True))
    stream = Stream(bus, network, monitors, settings, targets, supervise, on_cycle)
    commissioning = Commissioning(bus, drives, settings, stream.hearing)
    return Connection(bus, stream, commissioning, monitors)
