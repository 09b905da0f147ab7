"""
A drive controller, three simulated drives and their bus, in a time of their own, step by step.

A run is the same each time (`simulated_time`), and is looked at after every cycle.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
import itertools

import can
from can.interfaces.virtual import VirtualBus
import pytest
from simulated_time import SimulatedTime

from facade_manipulator.drives.canopen.bus import can_bus, CanBus
from facade_manipulator.drives.cia402 import group
from facade_manipulator.drives.cia402.settings import DEFAULT_AXES
from facade_manipulator.drives.controller.session import BusAccess
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.drives.controller.snapshot import ControllerSnapshot
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.loop.control_loop import assemble, LoopSetup
from facade_manipulator.motion.guard import mechanism_guard
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.simulation.drives.drive import simulated_drives
from facade_manipulator.simulation.drives.simulator import DriveSimulator

RESET_WINDOW = 3.0  # s, instead of a minute, in which nobody would learn anything
STEP = 0.05  # s, between two looks where no cycle runs
_channels = itertools.count()


class Bus(VirtualBus):
    """The master's end of the bus."""

    def __init__(self, world: World) -> None:
        super().__init__(world.channel)
        self._world = world

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        received = super()._recv_internal(timeout)
        self._require_up()
        return received

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        self._require_up()
        self._world.sent.append((self._world.time.now, message.arbitration_id,
                                 bytes(message.data)))
        super().send(message, timeout)

    def _require_up(self) -> None:
        if self._world.bus_is_down:
            raise can.CanOperationError('Network is down', 100)


class World:
    """A drive controller on three simulated drives, with targets from a stream of setpoints."""

    def __init__(self, settings: ControllerSettings | None = None, axes=DEFAULT_AXES) -> None:
        self.sent = deque()  #: times, identifiers and data that nobody has looked at yet
        self.errors = []  #: what the control loop has raised and nobody foresaw
        self.channel, self.bus_is_down = f'world {next(_channels)}', False
        self.settings = settings or ControllerSettings(own_garbage_collection=False)
        self.guard = mechanism_guard(Geometry())
        self._patches = pytest.MonkeyPatch()
        self._patches.setattr(group, 'RESET_WINDOW', RESET_WINDOW)
        self.time = SimulatedTime().__enter__()
        self.drives = simulated_drives(axes)
        self._simulator = DriveSimulator(lambda: VirtualBus(self.channel), self.drives)
        self._simulator.start()
        self.follower, self.controller = assemble(
            LoopSetup(Geometry(), self.settings, axes), BusAccess(self._open))
        recover = self.controller._recover
        self.controller._recover = lambda error: (self.errors.append(error), recover(error))
        self.controller.observe = self._observe
        self.controller.start()
        self._cycles, self._pause = 0, 0.0

    def close(self) -> None:
        """Leave this world's time."""
        try:
            with suppress(ManipulatorError):  # of what was done to the drives
                self.controller.close()
            self._simulator.stop()
        finally:
            self.time.__exit__()
            self._patches.undo()

    def _open(self) -> CanBus:
        if self.bus_is_down:
            raise OSError(19, 'No such device')
        return can_bus(Bus(self))

    def _observe(self, snapshot: ControllerSnapshot) -> None:
        self._cycles += 1
        self.time.notify(self)
        pause, self._pause = self._pause, 0.0
        if pause:
            self.time.sleep(pause)

    def forge(self, cob_id: int, data: bytes) -> None:
        """Let somebody else send a frame, which all receive."""
        if not self.bus_is_down:
            with VirtualBus(self.channel) as somebody:
                somebody.send(
                    can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))

    def pass_time(self, seconds: float) -> None:
        """Let the control loop stand still for a while."""
        self._pause = seconds
        self.run(seconds)

    def run(self, seconds: float, each: Callable[[], object] = bool) -> None:
        """Let all live for a while; call a function after each cycle."""
        end = self.time.now + seconds
        while self.time.now < end:
            self._step(min(STEP, end - self.time.now))
            each()

    def finish(self, job: Future, bound: float, each: Callable[[], object] = bool) -> str:
        """Live on until a request is answered; return the answer, or raise it."""
        end = self.time.now + bound
        while not job.done():
            assert self.time.now < end, f'no answer within {bound:g} s'
            self._step(STEP)
            each()
        return job.result()

    def _step(self, longest: float) -> None:
        before = self._cycles
        self.time.wait(lambda: self._cycles > before, longest, self)
        if self.errors:
            raise self.errors[0]

    def stream(self, setpoint: Setpoint) -> None:
        """Send a setpoint."""
        self.follower.add(setpoint, self.time.time())
