"""The stiffness of the contact, learnt while the force is raised and where it changes at once."""

from __future__ import annotations

from collections import deque
import math

LEAST, GREATEST = 400.0, 20000.0  # N/m, that the slow estimate may give
MARGIN = 1.3  # of the slow estimate: rather too stiff than too soft
RISE_TIME = 0.07  # s, about the loop's delay: what a rise in it shows was no answer to it
LEAST_RISE = 6.0  # N
UNKNOWN_MOTION = 5e-4  # m, that the wall may have moved meanwhile
STIFFER = 1.5  # each time the force chatters


class ContactStiffness:
    """
    Estimate the stiffness.

    Slowly: the desired force F_d rises whatever the wall does, so it is an instrument that the
    wall's motion does not correlate with, k = cov(F_d, F) / cov(F_d, a). At once, where a force
    that rises faster than the loop can answer shows that the contact is stiffer than thought.

    Parameters
    ----------
    value : float
        First guess [N/m], which the law works with.

    """

    def __init__(self, value: float) -> None:
        self.value = value
        self._recent: deque[tuple[float, float, float]] = deque()
        self.begin()

    def begin(self) -> None:
        """Begin the slow estimate: the force begins to rise."""
        self._count = 0
        self._means = [0.0, 0.0, 0.0]
        self._with_force = self._with_offset = 0.0

    def add(self, stamp: float, force: float, offset: float) -> None:
        """Look for a sudden rise of the force [N] at a stamp [s], at an offset [m]."""
        recent = self._recent
        recent.append((stamp, force, offset))
        while stamp - recent[0][0] > RISE_TIME:
            recent.popleft()
        _, least, there = min(recent, key=lambda item: item[1])
        if force - least > LEAST_RISE:
            self.value = max(
                self.value, (force - least) / (max(offset - there, 0.0) + UNKNOWN_MOTION))

    def add_rising(self, desired: float, force: float, offset: float) -> None:
        """Learn from the desired force, the force and the offset of a moment of the ramp."""
        self._count += 1
        before = desired - self._means[0]
        for i, value in enumerate((desired, force, offset)):
            self._means[i] += (value - self._means[i]) / self._count
        self._with_force += before * (force - self._means[1])
        self._with_offset += before * (offset - self._means[2])

    def finish(self) -> None:
        """Take the slow estimate: the ramp is at its end."""
        if self._with_force > 0.0:
            slope = self._with_offset / self._with_force
            self.value = min(max(MARGIN / slope if slope > 0.0 else math.inf, LEAST), GREATEST)

    def stiffen(self) -> None:
        """Think of the contact as stiffer: the force chatters."""
        self.value *= STIFFER
