"""
How an axis gives way to the wall: forces desired, the law that follows them, the stiffness learnt.

On y by the contact force, on θ by the contact moment, the goal is shifted by an offset a. What is
measured is late by T in all: F(t) = k (a(t) + w(t)) is known at a stamp, and the offset decided
now acts only a horizon later. With â the offset meant for the stamp,

    da/dt = (F_d − F − k̂ (a − â)) / (k̂ τ),    τ = 1.7 T,

which predicts the force by what has been decided since. With k̂ = k no latency remains in the
loop; it is stable to k = 4.1 k̂, and for every smaller k it is but slower. With T = 70 ms and
k̂ = 1.3 k as it is learnt, another 0.33 s of latency would make it unstable; it halves the wall's
motion w below 0.35 Hz and lets it grow above 0.97 Hz, by 1.25 at 2.9 Hz (Bode's integral).
A brush that damps with c adds c da/dt to F, for which the loop's gain is c / (k̂ τ) at every high
frequency: of 25 N s/m 0.35 at k̂ = 600 N/m, 0.53 at 400, where it rings with noise. So k̂ is no
less than 600 N/m; a softer contact forgives a slower law.
"""

from __future__ import annotations

from collections import deque
import math
from typing import ClassVar

from facade_manipulator.motion.timed_buffer import TimedBuffer
from facade_manipulator.parameters import parameter, settings

FILTER_TIME = 0.01  # s, of force and offset alike, against the sensor's noise
TIME_CONSTANT = 1.7  # τ in delays
SHORTEST_DELAY, LONGEST_DELAY = 0.02, 0.5  # s
LEAST_STIFFNESS, GREATEST_STIFFNESS = 400.0, 20000.0  # N/m, that the slow estimate may give
LAW_STIFFNESS = 600.0  # N/m, least k̂ of the law: the brush's damping is in its loop, too
MARGIN = 1.3  # of the slow estimate: rather too stiff than too soft
LATENCY = 0.07  # s, usual from a force to the head's answer: a rise within it was none
LEAST_RISE = 6.0  # N
UNKNOWN_MOTION = 5e-4  # m, that the wall may have moved meanwhile
STIFFER = 1.5  # each time the force chatters
LEARNING_RAMP = 8.0  # s, in which the stiffness is learnt


@settings
class ImpedanceSettings:
    """Desired force on the wall and how the axis y gives way to it."""

    approach_speed: ClassVar[float] = 0.004  # m/s, of the search: gentle even on a stiff wall
    speed: ClassVar[float] = 0.04  # m/s, highest of the offset

    enabled: bool = parameter('Whether the axis gives way to the wall', default=False, live=True)
    force: float = parameter(
        'Desired force on the wall', default=30.0, unit='N', minimum=0.1, maximum=1000.0,
        live=True)
    stiffness: float = parameter(
        'Stiffness towards the goal; 0 keeps the force whatever the offset', default=0.0,
        unit='N/m or N m/rad', minimum=0.0, maximum=1e6)
    contact_stiffness: float = parameter(
        'First guess of the stiffness of the contact, which is learnt', default=3000.0, unit='N/m',
        minimum=1.0, maximum=1e6)
    brush_width: float = parameter(
        'Width over which the head touches: makes a moment of the stiffness', default=0.3,
        unit='m', minimum=0.01, maximum=5.0)
    ramp_time: float = parameter(
        'Time in which the force rises from a tenth to the desired one; above 8 s also after a '
        'retract', default=LEARNING_RAMP, unit='s', minimum=0.5, maximum=120.0)
    retreat: float = parameter(
        'How far before the goal the head waits and returns to', default=0.05, unit='m',
        minimum=0.0, maximum=0.5)
    range: float = parameter(
        'Furthest offset from the goal', default=0.08, unit='m', minimum=1e-4, maximum=0.5)
    most_yaw: float = parameter(
        'Yaw of the gondola beyond which the force is reduced', default=0.087, unit='rad',
        minimum=0.01, maximum=1.0)
    most_sway: float = parameter(
        'Sway of the gondola along the wall beyond which the force is reduced', default=0.25,
        unit='m', minimum=0.01, maximum=2.0)


@settings
class YawImpedanceSettings:
    """Desired moment on the wall and how the axis θ gives way to it."""

    speed: ClassVar[float] = 0.25  # rad/s, highest of the offset: 38 mm/s at the brush's ends

    enabled: bool = parameter('Whether the axis gives way to the wall', default=False, live=True)
    force: float = parameter(
        'Desired moment on the wall', default=0.0, unit='N m', minimum=-100.0, maximum=100.0,
        live=True)
    stiffness: float = parameter(
        'Stiffness towards the goal; 0 keeps the moment whatever the offset', default=0.0,
        unit='N m/rad', minimum=0.0, maximum=1e6)
    range: float = parameter(
        'Furthest offset from the goal', default=0.12, unit='rad', minimum=1e-4, maximum=0.5)


class ForceLaw:
    """The offset of one axis and what was measured with it."""

    def __init__(self) -> None:
        self.offset = 0.0  #: present offset [m or rad]
        #: force on the wall as last measured and after the filter [N or N m], and the offset
        #: that the latter was measured with
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


class ContactStiffness:
    """
    Estimate the stiffness of the contact.

    Slowly: the desired force F_d rises whatever the wall does, so it is an instrument that the
    wall's motion does not correlate with, k = cov(F_d, F) / cov(F_d, a). At once, where a force
    that rises faster than the loop can answer shows that the contact is stiffer than thought.

    The first guess is a stiffness [N/m], too.
    """

    def __init__(self, value: float) -> None:
        self.value = self._guess = value
        #: what a ramp and the time after it have shown [N/m], None before
        self.learnt: float | None = None
        self._recent: deque[tuple[float, float, float]] = deque()
        self.begin()

    @property
    def for_law(self) -> float:
        """What the law works with [N/m]."""
        return max(self.value, LAW_STIFFNESS)

    @property
    def likely(self) -> float:
        """What it is without the margin [N/m]."""
        return self.value / MARGIN

    def begin(self) -> None:
        """Begin the slow estimate, and forget sudden rises: another touch is to come."""
        self.value = self.learnt or self._guess
        self._count = 0
        self._means = [0.0, 0.0, 0.0]
        self._with_force = self._with_offset = 0.0

    def add(self, stamp: float, force: float, offset: float) -> bool:
        """Return whether a sudden rise of the force [N], at an offset [m], shows a stiffer one."""
        recent = self._recent
        recent.append((stamp, force, offset))
        while stamp - recent[0][0] > LATENCY:
            recent.popleft()
        _, least, there = min(recent, key=lambda item: item[1])
        rise, before = force - least, self.value
        if rise > LEAST_RISE:
            self.value = max(before, rise / (max(offset - there, 0.0) + UNKNOWN_MOTION))
        return self.value > before

    def add_rising(self, desired: float, force: float, offset: float) -> None:
        """Learn from the desired force, the force and the offset of a moment of the ramp."""
        self._count += 1
        before = desired - self._means[0]
        for i, value in enumerate((desired, force, offset)):
            self._means[i] += (value - self._means[i]) / self._count
        self._with_force += before * (force - self._means[1])
        self._with_offset += before * (offset - self._means[2])

    def finish(self) -> None:
        """Take the slow estimate, unless there was one before: the ramp is at its end."""
        if self._with_force > 0.0 and self.learnt is None:
            slope = self._with_offset / self._with_force
            self.value = self.learnt = min(
                max(MARGIN / slope if slope > 0.0 else math.inf, LEAST_STIFFNESS),
                GREATEST_STIFFNESS)

    def limit(self, greatest: float) -> None:
        """Think of the contact as softer where it can only be so stiff [N/m]."""
        most = max(MARGIN * greatest, LEAST_STIFFNESS)
        self.value = min(self.value, most)
        if self.learnt is not None:
            self.learnt = min(self.learnt, most)

    def stiffen(self) -> None:
        """Think of the contact as stiffer: the force chatters."""
        self.value *= STIFFER
