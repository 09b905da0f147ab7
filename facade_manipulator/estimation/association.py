"""
What a measurement belongs to: the wall, one of its other levels, or nothing.

A mullion, a recess or the next edge displaces what a sensor measures by about the same from then
on. A gate alone would either follow it or lock the sensor out.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field
import math

import numpy as np

GATE = 4.0  # standard deviations: 1 of 16 000 good measurements is beyond
COASTING_GATE = 10.0  # without an inertial sensor: nobody expects a push
NEW_LEVEL = 8.0  # standard deviations from every level, from which on a level is another one
NEAREST = 3e-3  # m or rad, between two levels: less than any mullion, more than any joint
AGREEMENT, SPAN, FEWEST = 0.8, 0.25, 4  # share, s and number of measurements that make a level
REFINED = 400  # measurements over which the offset of a found level is averaged
MOST = 12  # levels that are kept; the one longest unused goes first
LOST = 1.0  # s without a measurement that belongs to anything: the axis starts again
OUTLIER = math.inf
SMOOTHING = 0.02  # of means over measurements: the last 50 or so


@dataclass
class Level:
    """How much farther than the wall something on it is."""

    offset: float
    configured: bool
    count: int = 0
    used: float = -math.inf  #: when a measurement belonged to it last [s]


class Levels:
    """The levels of what a sensor, or several, look at."""

    def __init__(self, offsets: tuple[float, ...] = ()) -> None:
        self.known = [Level(offset, True) for offset in dict.fromkeys((0.0, *offsets))]

    def nearest(self, residual: float) -> Level:
        """Return the level nearest to a residual."""
        return min(self.known, key=lambda level: abs(residual - level.offset))

    def add(self, offset: float, stamp: float) -> Level:
        """Add a level that was found, in place of the one longest unused if there are many."""
        if len(self.known) >= MOST:
            found = [level for level in self.known if not level.configured]
            self.known.remove(min(found, key=lambda level: level.used))
        self.known.append(Level(offset, False, 1, stamp))
        return self.known[-1]


@dataclass
class SensorRecord:
    """What became of the measurements of a sensor."""

    counts: Counter[str] = field(default_factory=Counter)  #: by 'used', 'other level', …
    stamp: float = -math.inf  #: of the newest measurement [s]
    fitted: float = -math.inf  #: of the newest that belonged to something [s]
    period: float = math.nan  #: mean time between measurements [s]
    age: float = math.nan  #: mean age of measurements when they came [s]
    square: float = 1.0  #: mean of the normalised innovation squared: 1 where the noise is right

    def note_arrival(self, now: float, stamp: float) -> None:
        """Count a measurement that came."""
        self.period = _mean(self.period, stamp - self.stamp)
        self.age = _mean(self.age, now - stamp)
        self.stamp = stamp

    def note_fit(self, stamp: float, square: float, is_wall: bool) -> None:
        """Count a measurement that belongs to something."""
        self.counts['used' if is_wall else 'other level'] += 1
        self.fitted = max(self.fitted, stamp)
        self.square = _mean(self.square, square)


def _mean(mean: float, value: float) -> float:
    """Return the running mean with another value; one that is not finite yet begins there."""
    return mean + SMOOTHING * (value - mean) if math.isfinite(mean) else value


@dataclass
class Verdict:
    """What a measurement belongs to, and what follows of it."""

    level: float  #: offset, infinite for nothing
    event: str = ''
    spread: float = 0.0  #: by which the state must be less certain to be where it was found again


class Association:
    """Decide what the measurements of one sensor belong to."""

    def __init__(self, levels: Levels, tolerance: float) -> None:
        self.levels, self.record = levels, SensorRecord()
        self._tolerance = max(NEAREST, tolerance)
        self._recent: deque[tuple[float, float]] = deque()  # stamps and residuals, 0 of what fits

    def decide(
        self, stamp: float, residual: float, deviation: float, gate: float = GATE
    ) -> Verdict:
        """Return what a measurement belongs to, by its residual and what is to be expected."""
        level = self.levels.nearest(residual)
        rest = residual - level.offset
        if abs(rest) <= gate * deviation:
            self._note(stamp, math.nan)
            self.record.note_fit(stamp, (rest / deviation) ** 2, level.offset == 0.0)
            level.used = stamp
            if not level.configured and level.count < REFINED:
                level.count += 1
                level.offset += rest / level.count
            return Verdict(level.offset)
        self._note(stamp, residual)
        agreed = self._agreed()
        if agreed is None:
            self.record.counts['outlier'] += 1
            return Verdict(OUTLIER)
        self._recent.clear()
        return self._agreement(stamp, agreed, deviation)

    def _note(self, stamp: float, residual: float) -> None:
        self._recent.append((stamp, residual))
        while stamp - self._recent[0][0] > SPAN * 1.2:
            self._recent.popleft()

    def _agreed(self) -> float | None:
        """Return the residual on which nearly all of the last measurements agree."""
        if len(self._recent) < FEWEST or self._recent[-1][0] - self._recent[0][0] < 0.8 * SPAN:
            return None
        residuals = np.array([residual for _, residual in self._recent])
        if np.isnan(residuals).mean() > 1.0 - AGREEMENT:
            return None
        middle = float(np.nanmedian(residuals))
        close = np.abs(residuals - middle) <= self._tolerance
        return middle if close.mean() >= AGREEMENT else None

    def _agreement(self, stamp: float, residual: float, deviation: float) -> Verdict:
        distance = abs(residual - self.levels.nearest(residual).offset)
        if distance > max(self._tolerance, NEW_LEVEL * deviation):
            self.record.counts['levels found'] += 1
            level = self.levels.add(residual, stamp)
            self.record.note_fit(stamp, 0.0, False)
            return Verdict(level.offset, f'another level of {1e3 * residual:+.1f} mm')
        self.record.counts['found again'] += 1
        return Verdict(OUTLIER, f'found again {1e3 * distance:.1f} mm from where it was expected',
                       distance)
