"""Transmitter of this master's frames, on a bus whose send queue may be temporarily full."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
import math

from facade_manipulator.canopen import cob_ids, nmt
from facade_manipulator.canopen.bus import BusCongestedError, CanBus
from facade_manipulator.canopen.clock import Clock


class Transmitter:
    """
    Transmitter of process data, heartbeats and network management commands.

    The exchange calls the transmitter. A frame without room in the send queue is dropped, because
    the next cycle sends newer frames. Network management commands wait for room. Sending raises a
    BusError if the bus is lost, or the queue is full for `LONGEST_UNSENT`.
    """

    LONGEST_UNSENT = 0.2  # s, without a frame sent: the bus is lost
    _HEARTBEAT = cob_ids.HEARTBEAT + cob_ids.MASTER_NODE_ID
    _OPERATIONAL = nmt.heartbeat('OPERATIONAL')

    def __init__(self, bus: CanBus, clock: Clock, heartbeat_period: float) -> None:
        self._bus = bus
        self._now = clock.monotonic
        self._heartbeat_period = heartbeat_period
        #: time of the next heartbeat [s]; a bus that was just opened is only listened to
        self.next_heartbeat = math.inf
        # name and node id of NMT commands that a full queue has delayed
        self._waiting_commands: deque[tuple[str, int]] = deque()
        self._full_since = math.inf  # time since which the queue has been full [s]

    @property
    def sends_heartbeats(self) -> bool:
        """Return whether this master sends heartbeats, and may command drives."""
        return self.next_heartbeat < math.inf

    def begin_heartbeats(self) -> None:
        """Start sending heartbeats."""
        self.next_heartbeat = self._now()

    def send_heartbeat(self, now: float) -> None:
        """Send the heartbeat if it is due at a time [s]."""
        if now >= self.next_heartbeat:
            self.next_heartbeat = now + self._heartbeat_period
            self.send(self._HEARTBEAT, self._OPERATIONAL)

    def send(self, cob_id: int, data: bytes = b'') -> None:
        """Send a frame, or drop it if the queue is full."""
        self._try(partial(self._bus.send, cob_id, data))

    def command(self, name: str, node_id: int) -> None:
        """Send a network management command to a node when the send queue has room."""
        self._waiting_commands.append((name, node_id))
        self.send_waiting_commands()

    def send_waiting_commands(self) -> None:
        """Send the network management commands that waited for room in the send queue."""
        while self._waiting_commands:
            name, node_id = self._waiting_commands[0]
            if not self._try(partial(self._bus.command, name, node_id)):
                return
            self._waiting_commands.popleft()

    def _try(self, send: Callable[[], None]) -> bool:
        """Try to send a frame; return whether the send queue had room."""
        try:
            send()
        except BusCongestedError:
            now = self._now()
            self._full_since = min(self._full_since, now)
            if now - self._full_since >= self.LONGEST_UNSENT:
                raise
            return False
        self._full_since = math.inf
        return True
