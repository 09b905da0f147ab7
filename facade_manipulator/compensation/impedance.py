"""
Position-based impedance: the head gives way to the wall as a mass on spring and damper would.

On one axis (y by the contact force, θ by the contact moment) the goal is shifted by an offset a,

    m ä + d ȧ + k a = F_d − F,    F = k_c (a + w).

F is the force that the contact has now, not the one measured some time ago: an observer sees the
disturbance w of the contact, that is the wall's unknown position (its steps and what the
prediction did not remove), in what a contact of stiffness k_c would need to explain it,

    w = Q(s) [F_measured(t) / k_c − a(t)],

where a(t) is the offset meant for the stamp of the measurement. With k_c right, w does not depend
on a, so latency makes nothing oscillate; k_c is better taken too high than too low.

References
----------
Park et al., conclusion: position-based impedance control with disturbance observer technique.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import ClassVar

from facade_manipulator.motion import TimedBuffer
from facade_manipulator.parameters import parameter, settings

CONTACT_SHARE = 0.2  # of the desired force, from which the head counts as touching
OBSERVER_TIME = 0.02  # s, time constant of Q: two cycles at 100 Hz
OLDEST_WRENCH = 0.2  # s, from which a measurement is not used; the offset returns to 0
NEGLIGIBLE = 1e-9  # m or rad, and per s


@settings
class ImpedanceSettings:
    """Desired force and what the head is to feel like on the axis y."""

    mass: ClassVar[float] = 2.0  # kg, that the head feels like: damping alone decides how it moves
    speed: ClassVar[float] = 0.25  # m/s, highest of the offset in contact
    approach_speed: ClassVar[float] = 0.04  # m/s, without contact: with it the head meets the wall

    enabled: bool = parameter(False, 'Whether the axis gives way to the wall')
    force: float = parameter(
        30.0, 'Desired force or moment on the wall', unit='N or N m', minimum=-1000.0,
        maximum=1000.0)
    damping: float = parameter(
        75.0, 'Damping that the head feels like', unit='N s/m or N m s/rad', minimum=0.0,
        maximum=1e5)
    stiffness: float = parameter(
        0.0, 'Stiffness towards the goal; 0 keeps the force whatever the offset',
        unit='N/m or N m/rad', minimum=0.0, maximum=1e6)
    contact_stiffness: float = parameter(
        700.0, 'Stiffness of the contact, rather too high than too low', unit='N/m or N m/rad',
        minimum=0.1, maximum=1e6)
    range: float = parameter(
        0.06, 'Furthest offset from the goal', unit='m or rad', minimum=1e-4, maximum=0.5)


@dataclass(frozen=True)
class YawImpedanceSettings(ImpedanceSettings):
    """Desired moment and what the head is to feel like on the axis θ."""

    mass: ClassVar[float] = 0.045  # kg m²
    speed: ClassVar[float] = 0.5  # rad/s
    approach_speed: ClassVar[float] = 0.1  # rad/s

    force: float = parameter(
        0.0, 'Desired moment on the wall', unit='N m', minimum=-100.0, maximum=100.0)
    damping: float = parameter(
        1.7, 'Damping that the head feels like', unit='N m s/rad', minimum=0.0, maximum=1e4)
    contact_stiffness: float = parameter(
        16.0, 'Stiffness of the contact, rather too high than too low', unit='N m/rad',
        minimum=0.01, maximum=1e5)
    range: float = parameter(
        0.12, 'Furthest offset from the goal', unit='rad', minimum=1e-4, maximum=0.5)


class Impedance:
    """
    The offset of one axis.

    Attributes
    ----------
    offset : float
        Present offset [m or rad].
    force : float
        Force on the wall that was last measured [N or N m].

    """

    def __init__(self, settings: ImpedanceSettings) -> None:
        self.settings = settings
        self.offset = 0.0
        self.force = 0.0
        self._velocity = 0.0
        self._disturbance: float | None = None
        self._measured_at = -math.inf
        self._offsets: TimedBuffer[float] = TimedBuffer()

    @property
    def idle(self) -> bool:
        """Whether the offset stays as it is without a step: switched off and back at the goal."""
        return not self.settings.enabled and self.offset == 0.0 == self._velocity

    def add_measurement(self, stamp: float, force: float) -> None:
        """Learn from the force [N] or moment [N m] on the wall measured at a stamp [s]."""
        interval = max(stamp - self._measured_at, 0.0)
        self.force, self._measured_at = force, stamp
        needed = force / self.settings.contact_stiffness - self._offset_at(stamp)
        if self._disturbance is None or interval > OLDEST_WRENCH:
            self._disturbance = needed
        share = 1.0 - math.exp(-interval / OBSERVER_TIME)
        self._disturbance += share * (needed - self._disturbance)

    def step(self, now: float, time: float, interval: float, saturation_error: float) -> None:
        """
        Move the offset on to a time.

        Parameters
        ----------
        now, time, interval : float
            Present time, the time that the offset is for, and the time since the last step [s].
        saturation_error : float
            By how much the axis is held back at the workspace limit: the offset stops there.

        """
        if now - self._measured_at > OLDEST_WRENCH:
            self._disturbance = None
        before = self.offset
        self._move(interval)
        if saturation_error * (self.offset - before) > 0.0:
            self.offset, self._velocity = before, 0.0
        self._offsets.append(time, self.offset)

    def _offset_at(self, time: float) -> float:
        before, after = self._offsets.around(time)
        if before is None:
            return self.offset
        if after is None:
            return before[1]
        (begin, a), (end, b) = before, after
        return a + (b - a) * (time - begin) / (end - begin)

    def _move(self, interval: float) -> None:
        """Step the mass implicitly, so that it is stable for every interval."""
        settings = self.settings
        active = settings.enabled and self._disturbance is not None
        desired = settings.force if active else 0.0
        disturbance = self._disturbance if active else 0.0
        spring = settings.stiffness + settings.contact_stiffness
        force = desired - settings.contact_stiffness * disturbance - spring * self.offset
        resistance = settings.mass + interval * (settings.damping + interval * spring)
        velocity = (settings.mass * self._velocity + interval * force) / resistance
        touching = active and abs(self.force) > CONTACT_SHARE * abs(settings.force)
        limit = settings.speed if touching else settings.approach_speed
        self._velocity = min(max(velocity, -limit), limit)
        moved = self.offset + interval * self._velocity
        self.offset = min(max(moved, -settings.range), settings.range)
        if moved != self.offset:
            self._velocity = 0.0
        if not settings.enabled and max(abs(self.offset), abs(self._velocity)) < NEGLIGIBLE:
            self.offset = self._velocity = 0.0  # else the remainder would never end
