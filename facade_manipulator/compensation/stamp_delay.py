"""
How late the estimator's stamps are, from the slip that is measured along the wall.

A correction by stamps that are late by a delay is that of the motion so much earlier: the head
slips by the delay times the speed of the rail at the head. Slip regressed on speed shows it.
"""

from __future__ import annotations

import math

MEMORY = 60.0  # s, time constant with which old slip is forgotten
LONGEST_INTERVAL = 0.5  # s, a pause counts as no longer
ALIKE = 1.0  # s, for which the rest of the slip stays alike
LEAST_WEIGHT = 20.0  # s, of slip, before anything is said
LEAST_SPEED = 0.005  # m/s RMS, below which a gondola hangs still


class StampDelay:
    """Regress the slip of the head along the wall on the speed of the rail there."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Forget everything: the estimates are others."""
        self._stamp = -math.inf
        self._weight = self._slip = self._speed = 0.0  # means
        self._slips = self._products = self._speeds = 0.0  # mean products, less those of means

    def add(self, stamp: float, slip: float, speed: float) -> None:
        """Note by how much the head is off along the wall [m] at a stamp, and the speed [m/s]."""
        interval = min(max(stamp - self._stamp, 0.0), LONGEST_INTERVAL)
        self._stamp = stamp
        fade = math.exp(-interval / MEMORY)
        self._weight = fade * self._weight + interval
        share = interval / self._weight
        slip_change, speed_change = slip - self._slip, speed - self._speed
        self._slip += share * slip_change
        self._speed += share * speed_change
        rest = 1.0 - share
        self._slips = rest * (self._slips + share * slip_change * slip_change)
        self._products = rest * (self._products + share * slip_change * speed_change)
        self._speeds = rest * (self._speeds + share * speed_change * speed_change)

    @property
    def found(self) -> tuple[float, float] | None:
        """Return the delay and its standard deviation [s], None while the motion shows none."""
        if self._weight < LEAST_WEIGHT or self._speeds < LEAST_SPEED ** 2:
            return None
        delay = self._products / self._speeds
        left = max(self._slips - delay * self._products, 0.0)
        return delay, math.sqrt(left * ALIKE / (self._speeds * self._weight))
