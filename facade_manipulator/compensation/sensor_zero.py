"""The zero of a force sensor, which is taken and checked while the head is off the wall."""

from __future__ import annotations

from collections import deque

import numpy as np

BLOCK = 0.5  # s, whose mean is a zero: to 0.07 N with 0.5 N of noise at 100 Hz
BLOCKS = 4  # from the first to the last 1.5 s: a drift shows to 0.07 N/s
MOST_ZERO = 10.0  # N: a sensor of 100 N may be off by as much; more is a wall that is touched
MOST_DRIFT = 0.2  # N/s: within 15 s of contact 3 N, a tenth of the usual force


class SensorZero:
    """Take the zero of force and moment whenever the head is off the wall."""

    def __init__(self) -> None:
        #: force and moment off the wall [N, N m], and the force's drift since 1.5 s ago or since
        #: before the last contact [N/s]
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
