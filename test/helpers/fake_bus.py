"""The master's end of a bus that is a list of frames."""

from __future__ import annotations

from collections import deque
import math
from typing import TYPE_CHECKING

from facade_manipulator.canopen.bus import CanBus, Frame

if TYPE_CHECKING:
    from bus_world import Rig

ON_THE_WIRE = 1e-4  # s, of a frame


class FakeBus(CanBus):
    """The master's end of the bus, with or without a kernel that sends SYNC."""

    def __init__(self, world: Rig) -> None:
        super().__init__(None)
        self.inbox: deque[Frame] = deque()
        self.next_sync, self.period = math.inf, 0.0
        self.is_virtual, self.has_kernel_sync = False, world.has_kernel_sync
        self._world, self._clock = world, world.clock

    def __str__(self) -> str:
        return 'can0'

    def receive(self, timeout: float) -> Frame | None:
        self._clock.wait_for(lambda: self.inbox or self._world.bus_error, timeout)
        self._require_up()
        if not self.inbox:
            return None
        self._clock.now += ON_THE_WIRE
        self._received += 1
        return self.inbox.popleft()

    def send(self, cob_id: int, data: bytes = b'', sampled: float | None = None) -> None:
        self._require_up()
        self._sent += 1
        self._world.carry(cob_id, bytes(data))

    def _require_up(self) -> None:
        if self._world.bus_error is not None:
            raise self._world.bus_error

    def start_sync(self, period: float) -> None:
        self.next_sync, self.period = self._clock.now + period, period

    def stop_sync(self) -> None:
        self.next_sync = math.inf

    def close(self) -> None:
        self._world.bus = None
