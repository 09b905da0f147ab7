"""The zero of a force sensor: taken while the head is off the wall, checked, missed in contact."""

from __future__ import annotations

from collections import deque
import math

import numpy as np

BLOCK = 0.5  # s, whose mean is a zero: to 0.07 N with 0.5 N of noise at 100 Hz
BLOCKS = 4  # from the first to the last 1.5 s: a drift shows to 0.07 N/s
MOST_ZERO = 10.0  # N: a sensor of 100 N may be off by as much; more is a wall that is touched
MOST_DRIFT = 0.2  # N/s: within 15 s of contact 3 N, a tenth of the usual force
CREEP_BLOCK = 2.0  # s, of which the mean offset is taken
CREEP_BLOCKS = 8  # that move the same way, 1 in 40,000 if they move at random


class SensorZero:
    """
    Take the zero of force and moment whenever the head is off the wall.

    Attributes
    ----------
    force, moment : float
        Measured off the wall [N, N m].
    drift : float
        Of the force, since 1.5 s ago or since before the last contact [N/s].

    """

    def __init__(self) -> None:
        self.force = self.moment = self.drift = 0.0
        self._blocks: deque[tuple[float, float]] = deque(maxlen=BLOCKS)
        self.begin()

    def begin(self) -> None:
        """Take another zero: the head is going back from the wall."""
        self._samples: list[tuple[float, float, float]] = []
        self._is_taken = False

    def add(self, stamp: float, force: float, moment: float) -> None:
        """Note force [N] and moment [N m] that are measured off the wall at a stamp [s]."""
        self._samples.append((stamp, force, moment))
        if abs(stamp - self._samples[0][0]) < BLOCK:
            return
        stamp, self.force, self.moment = np.mean(self._samples, axis=0).tolist()
        self._samples.clear()
        self._blocks.append((stamp, self.force))
        before, first = self._blocks[0]
        self.drift = (self.force - first) / (stamp - before) if stamp > before else 0.0
        self._is_taken = True

    @property
    def obstacle(self) -> str:
        """Why the head may not press by it yet; empty if it may."""
        is_known = self._is_taken and len(self._blocks) == BLOCKS
        if is_known and abs(self.drift) > MOST_DRIFT:
            return (f'contact_wrench drifts by {self.drift:+.2f} N/s off the wall, bound '
                    f'{MOST_DRIFT:g} N/s')
        if abs(self.force) > MOST_ZERO:
            return (f'{self.force:.1f} N are measured before the wall is looked for, bound '
                    f'{MOST_ZERO:g} N')
        return '' if is_known else 'the zero of contact_wrench is being taken off the wall'


class CreepWatch:
    """
    Find an offset that only creeps on: a zero that drifts moves the head so, and few walls do.

    Whether it is the zero shows off the wall alone. A frame moves the offset for a moment, sway
    and strokes to and fro.
    """

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Forget everything: the force is another one."""
        self._offsets: list[float] = []
        self._since = -math.inf
        self._means: deque[float] = deque(maxlen=CREEP_BLOCKS)

    def add(self, stamp: float, offset: float) -> None:
        """Note the offset [m] that was there at a stamp [s]."""
        if not 0.0 <= stamp - self._since < CREEP_BLOCK:
            if self._offsets:
                self._means.append(math.fsum(self._offsets) / len(self._offsets))
            self._offsets, self._since = [], stamp
        self._offsets.append(offset)

    @property
    def speed(self) -> float:
        """How fast it has crept all the time [m/s], 0 if it has not."""
        steps = np.diff(self._means)
        if len(self._means) < CREEP_BLOCKS or abs(np.sign(steps).sum()) < len(steps):
            return 0.0
        return float(abs(steps).min()) / CREEP_BLOCK
