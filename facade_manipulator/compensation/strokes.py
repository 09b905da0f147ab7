"""Strokes to and fro, as the goals show them."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from facade_manipulator.kinematics import Pose

LEAST_AMPLITUDE = 0.01  # m
TOLERANCE = 0.1  # of length and time, by which one stroke may differ from the next


class Strokes(NamedTuple):
    """Half their length [m], and the time to and fro [s]."""

    amplitude: float
    period: float


class StrokeWatch:
    """
    Recognise strokes.

    Attributes
    ----------
    strokes : Strokes or None
        The present ones, None where the goals do not go to and fro.

    """

    def __init__(self) -> None:
        self.strokes: Strokes | None = None
        self._goals: deque[tuple[float, float]] = deque(maxlen=3)

    def note(self, now: float, goal: Pose) -> None:
        """Note another goal, from a time [s] on."""
        self._goals.append((now, goal.x))
        self.strokes = None
        if len(self._goals) < 3:
            return
        (begin, first), (turn, other), (end, last) = self._goals
        length, period = abs(other - first), end - begin
        if (length >= 2.0 * LEAST_AMPLITUDE and abs(last - first) <= TOLERANCE * length
                and abs(2.0 * turn - begin - end) <= TOLERANCE * period):
            self.strokes = Strokes(0.5 * length, period)
