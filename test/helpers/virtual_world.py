"""
A drive controller, three simulated drives and their bus in one thread and in a time of its own.

Nothing waits for a clock: time steps to the next instant at which anybody has something to do. The
worker thread that asks the drives by SDO has its turns in between, one thread at a time, so that a
run is the same each time, on a busy computer too.
"""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future
import math
import queue
import sys
import threading
from types import SimpleNamespace

import can
import canopen.sdo.client
import pytest

from facade_manipulator.drives.cia402 import DEFAULT_AXES, group
from facade_manipulator.drives.controller import (
    BusAccess,
    commissioning,
    ControllerSettings,
    DriveController,
    MechanismChecks,
)
from facade_manipulator.drives.controller import (
    controller as controller_module,
)
from facade_manipulator.drives.controller.session import Session
from facade_manipulator.drives.simulated.drive import simulated_drives
from facade_manipulator.errors import BusError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion import (
    HomingGuard,
    MechanismGuard,
    MotionLimits,
    Setpoint,
    SetpointFollower,
    StreamSettings,
)

RESET_WINDOW = 3.0  # s, instead of a minute, in which nobody would learn anything
WALL_CLOCK = 1.7e9  # s, of the system clock when a run begins


class Time:
    """The time of a world, with the functions of the module `time` that the package calls."""

    def __init__(self) -> None:
        self.now, self.offset = 100.0, WALL_CLOCK
        self.turn = threading.Condition()
        self.is_worker_busy = False
        self.worker_wakes = math.inf

    def monotonic(self) -> float:
        return self.now

    def time(self) -> float:
        return self.now + self.offset

    def step_to(self, now: float) -> None:
        """Let time pass; a worker whose patience ends has its turn."""
        self.now = max(self.now, now)
        if self.now >= self.worker_wakes:
            self.wake_worker()

    # --- turns

    def wake_worker(self) -> None:
        """Let a worker that waits look again."""
        with self.turn:
            self.is_worker_busy = self.worker_wakes < math.inf
            self.turn.notify_all()

    def await_worker(self) -> None:
        """Give the worker its turn, until it waits or has ended."""
        with self.turn:
            self.turn.wait_for(lambda: not self.is_worker_busy)

    def wait_in_worker(self, condition, timeout: float | None) -> bool:
        """Wait in the worker for a condition until a time-out in this world's time."""
        self.worker_wakes = self.now + timeout
        while not (held := condition()) and self.now < self.worker_wakes:
            self.is_worker_busy = False
            self.turn.notify_all()
            self.turn.wait_for(lambda: self.is_worker_busy)
        self.worker_wakes = math.inf
        return bool(held)


class Condition:
    """A `threading.Condition` for the worker."""

    def __init__(self, time: Time) -> None:
        self._time = time

    def __enter__(self) -> None:
        self._time.turn.acquire()

    def __exit__(self, *details: object) -> None:
        self._time.turn.release()

    def notify_all(self) -> None:
        self._time.wake_worker()

    def wait_for(self, condition, timeout: float) -> bool:
        return self._time.wait_in_worker(condition, timeout)


class Answers(deque):
    """A `queue.Queue` of answers for the worker."""

    def __init__(self, time: Time) -> None:
        super().__init__()
        self._time = time

    def empty(self) -> bool:
        return not self

    def qsize(self) -> int:
        return len(self)

    def put(self, item: bytes) -> None:
        self.append(item)
        self._time.wake_worker()

    def get(self, block: bool = True, timeout: float | None = None) -> bytes:
        with self._time.turn:
            if not self._time.wait_in_worker(lambda: self, timeout):
                raise queue.Empty
        return self.popleft()


class Worker:
    """A `ThreadPoolExecutor` of one thread that has turns."""

    def __init__(self, time: Time) -> None:
        self._time = time

    def submit(self, function, *arguments) -> Future:
        job: Future = Future()
        job.set_running_or_notify_cancel()
        self._time.await_worker()
        self._time.is_worker_busy = True
        threading.Thread(target=self._run, args=(job, function, arguments), daemon=True).start()
        return job

    def _run(self, job: Future, function, arguments) -> None:
        try:
            job.set_result(function(*arguments))
        except Exception as error:
            job.set_exception(error)
        with self._time.turn:
            self._time.is_worker_busy = False
            self._time.turn.notify_all()

    def shutdown(self, **_: bool) -> None:
        """End nothing: a job that is left ends with the bus."""


class Bus:
    """What a `can.BusABC` of the master does, with the drives at its other end."""

    channel_info = 'a bus of its own world'

    def __init__(self, world: World) -> None:
        self._world = world
        self._received: deque[can.Message] = deque()
        self._is_open = True

    def _recv_internal(self, timeout: float) -> tuple[can.Message | None, bool]:
        return self._receive(timeout), False

    def _receive(self, timeout: float) -> can.Message | None:
        world = self._world
        end = world.time.now + max(timeout, 0.0)
        while True:
            world.time.await_worker()
            self._require_up()
            if self._received:
                return self._received.popleft()
            if world.time.now >= end:
                return None
            world.time.step_to(min(end, *(drive.deadline for drive in world.drives)))
            self.deliver([frame for drive in world.drives
                          for frame in drive.advance(world.time.now)])

    def send(self, message: can.Message) -> None:
        self._require_up()
        self._world.sent.append((self._world.time.now, message.arbitration_id,
                                 bytes(message.data)))
        self.deliver(self._world.give(message.arbitration_id, bytes(message.data)))

    def deliver(self, frames: list[tuple[int, bytes]]) -> None:
        """Let the master receive frames."""
        self._received.extend(
            can.Message(arbitration_id=cob_id, data=data, is_extended_id=False,
                        timestamp=self._world.time.time()) for cob_id, data in frames)

    def shutdown(self) -> None:
        self._is_open = False

    def _require_up(self) -> None:
        if not self._is_open or self._world.bus_is_down:
            raise can.CanOperationError('Network is down', 100)


class _NoThread:
    def __init__(self, **_: object) -> None:
        """Take what a thread takes."""

    def start(self) -> None:
        """Start nothing: the world has the turns."""


class _Wake:
    """A `threading.Event` whose waiting is the world's time passing."""

    def __init__(self, world: World) -> None:
        self._world = world

    def set(self) -> None:
        """Wake nobody: nobody waits."""

    clear = set

    def wait(self, timeout: float) -> None:
        self._world.pass_time(min(timeout, 0.05))


class World:
    """
    A drive controller on three simulated drives, with targets from a stream of setpoints.

    Attributes
    ----------
    sent : deque of (float, int, bytes)
        What the master has sent and nobody has looked at yet.
    errors : list of Exception
        What the control loop has raised and nobody foresaw.

    """

    def __init__(self, settings: ControllerSettings | None = None, axes=DEFAULT_AXES) -> None:
        self.time, self.sent, self.errors = Time(), deque(), []
        self.bus_is_down = False
        self.settings = settings or ControllerSettings(own_garbage_collection=False)
        self.drives = simulated_drives(axes)
        self.guard = MechanismGuard(Geometry())
        self.follower = SetpointFollower(
            StreamSettings(), MotionLimits(), self.settings.period, self.guard)
        self.buses: list[Bus] = []
        self._patches = pytest.MonkeyPatch()
        self._enter()
        for drive in self.drives:
            drive.reboot()
        session = Session(
            self.settings, axes, BusAccess(self._open),
            MechanismChecks(self.follower, MechanismGuard(Geometry()), HomingGuard(Geometry())))
        session.worker.shutdown()
        session.worker = Worker(self.time)
        self.controller = DriveController(session)
        self.controller._wake = _Wake(self)

    def _enter(self) -> None:
        """Let the package live in this world's time."""
        self._patches.setattr(group, 'RESET_WINDOW', RESET_WINDOW)
        for name, module in list(sys.modules.items()):
            if name.startswith('facade_manipulator.drives.') and hasattr(module, 'time'):
                self._patches.setattr(module, 'time', self.time)
        threads = SimpleNamespace(Thread=_NoThread, Event=threading.Event)
        self._patches.setattr(controller_module, 'threading', threads)
        self._patches.setattr(commissioning, 'threading', SimpleNamespace(
            Condition=lambda: Condition(self.time)))
        self._patches.setattr(canopen.sdo.client, 'queue', SimpleNamespace(
            Queue=lambda: Answers(self.time), Empty=queue.Empty))

    def close(self) -> None:
        """Leave this world's time."""
        try:
            self.finish(self.controller._request(_close_kind()), 20.0)
        finally:
            self._patches.undo()

    def _open(self) -> Bus:
        if self.bus_is_down:
            raise OSError(19, 'No such device')
        self.buses.append(Bus(self))
        return self.buses[-1]

    def give(self, cob_id: int, data: bytes) -> list[tuple[int, bytes]]:
        """Give a frame to the drives; return their answers."""
        return [frame for drive in self.drives
                for frame in drive.receive(cob_id, data, self.time.now)]

    def forge(self, cob_id: int, data: bytes) -> None:
        """Let somebody else send a frame, which all receive."""
        frames = [(cob_id, data), *self.give(cob_id, data)]
        if self.buses and not self.bus_is_down:
            self.buses[-1].deliver(frames)

    def pass_time(self, seconds: float) -> None:
        """Let the drives live for a while without a master."""
        end = self.time.now + seconds
        while self.time.now < end:
            self.time.await_worker()
            self.time.step_to(min(end, *(max(drive.deadline, self.time.now + 1e-4)
                                         for drive in self.drives)))
            for drive in self.drives:
                drive.advance(self.time.now)

    def turn(self) -> None:
        """Let the control loop have a turn, as its thread does."""
        controller = self.controller
        try:
            controller._turn()
        except BusError as error:
            controller._lose_bus(error)
        except Exception as error:
            self.errors.append(error)
            raise

    def run(self, seconds: float, each=lambda: None) -> None:
        """Let the control loop run for a while; call a function after each turn."""
        end = self.time.now + seconds
        while self.time.now < end:
            self.turn()
            each()

    def finish(self, job: Future, bound: float, each=lambda: None) -> str:
        """Let the control loop run until a request is answered; return the answer, or raise it."""
        end = self.time.now + bound
        while not job.done():
            assert self.time.now < end, f'no answer within {bound:g} s'
            self.turn()
            each()
        return job.result()

    def stream(self, setpoint: Setpoint) -> None:
        """Send a setpoint."""
        self.follower.add(setpoint, self.time.time())


def _close_kind() -> type:
    return controller_module.service_operations.Close
