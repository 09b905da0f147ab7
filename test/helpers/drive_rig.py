"""A drive controller and three simulated drives on one CAN bus, with somebody listening."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import can
from support import wait_until
import yaml

from facade_manipulator.canopen.bus import can_bus, CanBus
from facade_manipulator.canopen.nmt import NmtState
from facade_manipulator.drives.axis_settings import AxisSettings, DEFAULT_AXES
from facade_manipulator.drives.controller import DriveController
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.session import BusAccess, Session
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import State
from facade_manipulator.drives.targets import MechanismChecks
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.resources import config_path
from facade_manipulator.simulation.drives.drive import simulated_drives
from facade_manipulator.simulation.drives.simulator import DriveSimulator

PATIENCE = 20.0
HOME = (-0.1, 0.1, 0.0)
# what a busy computer does to the cycle must fail no test that is not about it
SETTINGS = ControllerSettings(
    own_garbage_collection=False, boot_timeout=0.5, hold_cycles=3,
    max_missed_cycles=10, heartbeat_timeout=0.5)
MOVING = 0.1  # m/s


class Source:
    """Targets that go to and fro from where they were reset, at a constant speed."""

    def __init__(self, period: float = SETTINGS.period) -> None:
        self.speed = 0.0
        self.time = 0.0
        self.period = period
        self.distort = None
        self.start = self.positions = None
        self.held = False

    @property
    def at_rest(self) -> bool:
        return self.held or self.speed == 0.0

    def reset(self, positions) -> None:
        self.start = self.positions = positions
        self.held = False
        self.time = 0.0

    def hold(self) -> None:
        self.held = True

    def wait(self, seconds: float) -> None:
        """Go on at once."""

    def sample(self, latch_time: float):
        if not self.held:
            self.time += self.period
            step = self.speed * self.period * (1.0 if self.time % 2.0 < 1.0 else -1.0)
            self.positions = tuple(position + step for position in self.positions)
        return self.distort(self.positions) if self.distort else self.positions


class Rig:
    """A controller and three simulated drives on one virtual bus, with somebody listening."""

    def __init__(
        self, channel: str, interface='virtual', settings=SETTINGS, axes=DEFAULT_AXES,
        drives=None, source=None, **checks,
    ) -> None:
        self.channel = channel
        self.interface = interface
        self.axes = axes
        self.source = source or Source(settings.period)
        self.buses = []
        self.bus_is_missing = False
        self.drives = drives
        try:
            self._start_drives()
            self.listener = self._new_bus()
            self.controller = self._make_controller(settings, **checks)
            self.controller.start()
        except BaseException:
            self.simulator.stop()  # or its drives would answer in every test that follows
            raise

    def _start_drives(self) -> None:
        self.drives = self.drives or simulated_drives(self.axes)
        self.simulator = DriveSimulator(self._new_bus, self.drives)
        self.simulator.start()
        wait_until(lambda: NmtState.INITIALISING not in {d.nmt_state for d in self.drives},
                   'drives that are on')  # a boot-up while they are reset means: once more

    def _make_controller(self, settings: ControllerSettings, **checks) -> DriveController:
        return DriveController(Session(
            settings, self.axes, BusAccess(self.open_bus),
            MechanismChecks(self.source, **checks)))

    def _new_bus(self) -> can.BusABC:
        return can.Bus(interface=self.interface, channel=self.channel, ignore_config=True)

    def open_bus(self) -> CanBus:
        if self.bus_is_missing:
            raise OSError(19, 'No such device')
        self.buses.append(self._new_bus())
        return can_bus(self.buses[-1])

    def close(self) -> None:
        with suppress(ManipulatorError):  # of what a test has done to its drives
            self.controller.close()
        self.simulator.stop()
        self.listener.shutdown()

    def do(self, *names: str) -> str:
        for name in names:
            answer = self.controller.request(name).result(PATIENCE)
        return answer

    @property
    def state(self) -> ControllerState:
        return self.controller.snapshot().state

    @property
    def drive_states(self) -> list[State]:
        with self.simulator.access() as drives:
            return [drive.state for drive in drives]

    @property
    def carriages(self) -> list[float]:
        with self.simulator.access() as drives:
            return [drive.motor.carriage_position for drive in drives]

    def rejection(self, name: str) -> str | None:
        """Return why a request is rejected, None if it is not."""
        try:
            self.do(name)
        except ManipulatorError as error:
            return str(error)
        return None

    @property
    def all_causes(self) -> str:
        snapshot = self.controller.snapshot()
        return ' '.join((snapshot.cause, *snapshot.further_causes))

    def cycles(self, count: int) -> None:
        """Wait for a number of cycles."""
        goal = self.controller.snapshot().cycle.cycles + count
        wait_until(lambda: self.controller.snapshot().cycle.cycles >= goal, f'{count} cycles')

    def until(self, *states: ControllerState) -> None:
        wait_until(lambda: self.state in states, f'{states}')

    def until_stopped(self) -> None:
        self.until(ControllerState.STOPPED)
        wait_until(lambda: State.OPERATION_ENABLED not in self.drive_states, 'the drives to stop')

    def frames(self) -> list[can.Message]:
        """Return what the listener has received since it was last asked."""
        received = []
        for _ in range(2):  # a socket tells once that the interface went down, before what it has
            with suppress(can.CanOperationError):
                while (message := self.listener.recv(0.0)) is not None:
                    received.append(message)
        return received

    def forge(self, cob_id: int, data: bytes) -> None:
        self.listener.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))


def at_rest(rig: Rig) -> None:
    rig.do('configure', 'home', 'activate')


def moving(rig: Rig) -> None:
    rig.source.speed = MOVING
    at_rest(rig)
    start = rig.controller.snapshot().joints().positions
    wait_until(
        lambda: abs(rig.controller.snapshot().joints().positions[0] - start[0]) > 0.003, 'motion')


def axes_with(directory: Path, base: str = 'simulated', **changes) -> tuple[AxisSettings, ...]:
    """Return axes whose drive type is one of the package's with changes."""
    data = yaml.safe_load(config_path(f'drives/{base}.yaml').read_text())
    data |= {'eds': str(config_path(f"drives/{data['eds']}")), **changes}
    path = directory / 'mine.yaml'
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return tuple(replace(axis, profile=str(path)) for axis in DEFAULT_AXES)
