"""A bus that loses, doubles and delays what a simulated drive sends and receives."""

from __future__ import annotations

import heapq
from itertools import count
import random

DELAY = 0.005  # s, the longest of a late frame


class FrameFilter:
    """One direction of the bus: which share of the frames is dropped, doubled, delayed."""

    def __init__(self, dropped=0.0, doubled=0.0, delayed=0.0, delay=DELAY, seed=0) -> None:
        self.dropped, self.doubled, self.delayed, self.delay = dropped, doubled, delayed, delay
        self._chance = random.Random(seed).random
        self._late, self._count = [], count()

    def carry(self, frames: list, now: float) -> list:
        """Return what arrives now, of `frames` sent now and of those that were late."""
        arrived = [frame for sent in frames for frame in self._send(sent, now)]
        while self._late and self._late[0][0] <= now:
            arrived.append(heapq.heappop(self._late)[2])
        return arrived

    def _send(self, frame, now: float) -> list:
        if self._chance() < self.dropped:
            return []
        frames = [frame, frame] if self._chance() < self.doubled else [frame]
        if self._chance() >= self.delayed:
            return frames
        for late in frames:
            arrival = now + self.delay * self._chance()
            heapq.heappush(self._late, (arrival, next(self._count), late))
        return []


def put_on_bad_bus(drive, sending: dict | None = None, receiving: dict | None = None) -> None:
    """Let frames of a drive get lost, heartbeats too; what is late comes with the next frame."""
    receive, advance = type(drive).receive, type(drive).advance
    to_drive, from_drive = FrameFilter(**receiving or {}), FrameFilter(**sending or {})

    def receive_what_arrives(cob_id: int, data: bytes, now: float) -> list:
        return [answer for frame in to_drive.carry([(cob_id, data)], now)
                for answer in receive(drive, *frame, now)]

    drive.receive = receive_what_arrives
    drive.advance = lambda now: from_drive.carry(advance(drive, now), now)
