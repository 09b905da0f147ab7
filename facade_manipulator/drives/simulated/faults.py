"""Frames that get lost, late or doubled on their way: fault injection for one drive."""

from __future__ import annotations

import heapq
from itertools import count
import math
import random

from facade_manipulator.parameters import parameter, settings

Frame = tuple[int, bytes]


@settings
class FrameLoss:
    """How badly frames travel; the default is a perfect wire."""

    dropped: float = parameter(
        0.0, 'Share of the frames that are lost', minimum=0.0, maximum=1.0)
    doubled: float = parameter(
        0.0, 'Share of the frames that come twice', minimum=0.0, maximum=1.0)
    delayed: float = parameter(
        0.0, 'Share of the frames that come late, so that later ones overtake them',
        minimum=0.0, maximum=1.0)
    delay: float = parameter(
        0.005, 'Longest delay of a late frame', unit='s', minimum=0.0, maximum=10.0)
    seed: int = parameter(0, 'Seed of the chance', minimum=0)


class FrameFilter:
    """
    A wire of bad quality, in one direction.

    Parameters
    ----------
    loss : FrameLoss
        How bad it is.

    """

    def __init__(self, loss: FrameLoss | None = None) -> None:
        self.set(loss or FrameLoss())

    def set(self, loss: FrameLoss) -> None:
        """Make the wire better or worse; what is under way is lost."""
        self._loss = loss
        self._is_perfect = loss.dropped == loss.doubled == loss.delayed == 0.0
        self._random = random.Random(loss.seed)
        self._late: list[tuple[float, int, Frame]] = []
        self._count = count()

    @property
    def deadline(self) -> float:
        """When the next late frame arrives; infinity if none is under way."""
        return self._late[0][0] if self._late else math.inf

    def carry(self, frames: list[Frame], now: float) -> list[Frame]:
        """Return what arrives now, of `frames` sent now and of those that were late."""
        if self._is_perfect:
            return frames
        arrived = [frame for sent in frames for frame in self._send(sent, now)]
        while self._late and self._late[0][0] <= now:
            arrived.append(heapq.heappop(self._late)[2])
        return arrived

    def _send(self, frame: Frame, now: float) -> list[Frame]:
        loss, chance = self._loss, self._random.random
        if chance() < loss.dropped:
            return []
        frames = [frame, frame] if chance() < loss.doubled else [frame]
        if chance() >= loss.delayed:
            return frames
        for late in frames:
            arrival = now + loss.delay * chance()
            heapq.heappush(self._late, (arrival, next(self._count), late))
        return []
