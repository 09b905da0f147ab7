"""
Bus that is a list of frames, with drives and other nodes, in simulated time.

Time passes while the master waits.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
import math

from facade_manipulator.canopen import cob_ids
from facade_manipulator.canopen.bus import CanBus, Frame
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.errors import BusError
from facade_manipulator.simulation.drives.drive import SimulatedDrive

ON_THE_WIRE = 1e-4  # s, of a frame
STEP = 1e-6  # s, by which time passes at least
Frames = list[tuple[int, bytes]]  # COB-IDs and data


class BusWorld:
    """Drives and other nodes on a bus of one master; a subclass is the master's program."""

    def __init__(
        self, drives: Sequence[SimulatedDrive], has_kernel_sync: bool = False
    ) -> None:
        self.has_kernel_sync = has_kernel_sync
        self.clock = FakeClock(self)
        self.drives = drives
        # drives of another fake bus keep their own time, which never decreases
        self.clock.now = max(self.clock.now, *(drive.now for drive in drives))
        #: further nodes, which take COB-ID and data, and return frames
        self.nodes: list[Callable[[int, bytes], Frames]] = []
        #: whether the kernel's SYNC returns marked as sent on this computer
        self.marks_kernel_sync = False
        self.make_bus: Callable[[BusWorld], FakeBus] = FakeBus
        self.bus: FakeBus | None = None
        self.bus_error: BusError | None = None  #: raised by sending and receiving
        self.heard: list[Frame] = []  #: all frames on the bus
        self._events: list[tuple[float, Callable[[], object]]] = []

    def open_bus(self, *_: object) -> FakeBus:
        """Return the master's end of the bus."""
        if self.bus_error is not None:
            raise self.bus_error
        self.bus = self.make_bus(self)
        return self.bus

    def power_cut(self) -> None:
        """Switch the drives off and on."""
        for drive in self.drives:
            drive.advance(self.clock.now)
            drive.reboot()

    def later(self, seconds: float, act: Callable[[], object]) -> None:
        """Call a function after a time [s], within a cycle."""
        self._events.append((self.clock.now + seconds, act))

    def pass_time(self, seconds: float) -> None:
        """Let time pass while the master is idle [s]."""
        end = self.clock.now + seconds
        while self.clock.now < end:
            self.clock.pass_time(end)

    def carry(self, cob_id: int, data: bytes) -> None:
        """Pass a frame to drives and nodes, and their answers to the master."""
        self.heard.append(self._frame(cob_id, data))
        for drive in self.drives:
            self._hear(drive.receive(cob_id, data, self.clock.now))
        for node in self.nodes:
            self._hear(node(cob_id, data))

    def forge(self, cob_id: int, data: bytes = b'') -> None:
        """Send a frame from another node to all receivers."""
        self.deliver([(cob_id, data)])
        self.carry(cob_id, data)

    def deliver(self, frames: Frames) -> None:
        """Pass frames only to the master."""
        if self.bus is not None and self.bus_error is None:
            self.bus.inbox += [self._frame(*frame) for frame in frames]

    def _hear(self, frames: Frames) -> None:
        self.heard += [self._frame(*frame) for frame in frames]
        self.deliver(frames)

    def _frame(self, cob_id: int, data: bytes) -> Frame:
        return Frame(cob_id, data, self.clock.now, self.clock.time())

    @property
    def deadline(self) -> float:
        """Return the time of the next event, action of a drive or SYNC of the kernel [s]."""
        sync = self.bus.next_sync if self.bus is not None else math.inf
        times = [sync]
        for time, _ in self._events:
            times.append(time)
        for drive in self.drives:
            times.append(drive.deadline)
        return min(times)

    def advance(self) -> None:
        """Execute events, actions of drives and the kernel's SYNC until now."""
        due = [one for one in self._events if one[0] <= self.clock.now]
        self._events = [one for one in self._events if one not in due]
        for _, act in due:
            act()
        for drive in self.drives:
            self._hear(drive.advance(self.clock.now))
        bus = self.bus
        if bus is not None and self.clock.now >= bus.next_sync:
            bus.next_sync += bus.period
            sync = self._frame(cob_ids.SYNC, b'')
            bus.inbox.append(sync._replace(is_local=self.marks_kernel_sync))
            self.carry(sync.cob_id, sync.data)


class FakeBus(CanBus):
    """Master's end of the bus, with or without a kernel that sends SYNC."""

    def __init__(self, world: BusWorld) -> None:
        super().__init__(None)
        self.inbox: deque[Frame] = deque()
        self.next_sync = math.inf
        self.period = 0.0
        self.is_virtual = False
        self.has_kernel_sync = world.has_kernel_sync
        self._world = world

    def __str__(self) -> str:
        return 'can0'

    def receive(self, timeout: float) -> Frame | None:
        clock = self._world.clock
        clock.wait_for(lambda: self.inbox or self._world.bus_error, timeout)
        self._require_up()
        if not self.inbox:
            return None
        clock.now += ON_THE_WIRE
        self.statistics.received += 1
        return self.inbox.popleft()

    def send(
        self, cob_id: int, data: bytes = b'', sampled: float | None = None
    ) -> None:
        self._require_up()
        self.statistics.sent += 1
        self._world.carry(cob_id, bytes(data))

    def _require_up(self) -> None:
        if self._world.bus_error is not None:
            raise self._world.bus_error

    def start_sync(self, period: float) -> None:
        self.next_sync = self._world.clock.now + period
        self.period = period

    def stop_sync(self) -> None:
        self.next_sync = math.inf

    def close(self) -> None:
        self._world.bus = None


class FakeClock(Clock):
    """Simulated clock, which advances while the controller waits."""

    def __init__(self, world: BusWorld) -> None:
        self.now = 100.0  #: time on the monotonic clock [s]
        self.offset = 1.7e9  #: time by which the system clock is ahead [s]
        self._world = world

    def monotonic(self) -> float:
        return self.now

    def time(self) -> float:
        return self.now + self.offset

    def sleep(self, seconds: float) -> None:
        self.wait_for(lambda: False, seconds)

    def wait_for(self, condition: Callable[[], object], timeout: float) -> bool:
        """Wait until a condition holds, or a timeout has passed [s]; return whether it holds."""
        deadline = self.now + max(timeout, STEP)
        while not condition() and self.now < deadline:
            self.pass_time(deadline)
        return bool(condition())

    def pass_time(self, end: float) -> None:
        """Advance the time until the next event, until a time [s] at most."""
        wanted = min(self._world.deadline, end)
        self.now = max(self.now + STEP, wanted)
        self._world.advance()
