"""
Follow a desired force on one axis through a contact whose stiffness is only estimated.

On y by the contact force, on θ by the contact moment, the goal is shifted by an offset a. What is
measured is late by T in all: F(t) = k (a(t) + w(t)) is known at a stamp, and the offset decided
now acts only a horizon later. With â the offset meant for the stamp,

    da/dt = (F_d − F − k̂ (a − â)) / (k̂ τ),    τ = 1.7 T,

which predicts the force by what has been decided since. With k̂ = k no latency remains in the
loop; it is stable to k = 4.1 k̂, and for every smaller k it is but slower. With T = 70 ms and
k̂ = 1.3 k as it is learnt, another 0.33 s of latency would make it unstable; it halves the wall's
motion w below 0.35 Hz and lets it grow above 0.97 Hz, by 1.25 at 2.9 Hz (Bode's integral).
"""

from __future__ import annotations

import math

from facade_manipulator.motion import TimedBuffer

FILTER_TIME = 0.01  # s, of force and offset alike, against the sensor's noise
TIME_CONSTANT = 1.7  # τ in delays
SHORTEST_DELAY, LONGEST_DELAY = 0.02, 0.5  # s


class ForceLaw:
    """
    The offset of one axis and what was measured with it.

    Attributes
    ----------
    offset : float
        Present offset [m or rad].
    measured : float
        Force on the wall that was last measured [N or N m].
    force, offset_then : float
        The same after the filter, and the offset that it was measured with.

    """

    def __init__(self) -> None:
        self.offset = 0.0
        self.measured = self.force = self.offset_then = 0.0
        self._stamp = -math.inf
        self._offsets: TimedBuffer[float] = TimedBuffer()

    def begin(self, offset: float) -> None:
        """Begin at an offset, as if it had been there all the time."""
        self.offset = self.offset_then = offset
        self._offsets.clear()

    def add_measurement(self, stamp: float, force: float) -> None:
        """Note a force [N or N m] measured at a stamp [s]."""
        share = 1.0 - math.exp(-max(stamp - self._stamp, 0.0) / FILTER_TIME)
        self._stamp, self.measured = stamp, force
        self.force += share * (force - self.force)
        self.offset_then += share * (self._offset_at(stamp) - self.offset_then)

    def velocity(self, desired: float, stiffness: float, time: float) -> float:
        """Return how fast the offset is to move for a desired force, decided for a time [s]."""
        delay = min(max(time - self._stamp, SHORTEST_DELAY), LONGEST_DELAY)
        predicted = self.force + stiffness * (self.offset - self.offset_then)
        return (desired - predicted) / (stiffness * TIME_CONSTANT * delay)

    def move(self, time: float, offset: float) -> None:
        """Move to an offset at a time [s]."""
        self.offset = offset
        self._offsets.append(time, offset)

    def _offset_at(self, time: float) -> float:
        before, after = self._offsets.around(time)
        if before is None or after is None:
            return (before or after or (time, self.offset))[1]
        (begin, a), (end, b) = before, after
        return a + (b - a) * (time - begin) / (end - begin)
