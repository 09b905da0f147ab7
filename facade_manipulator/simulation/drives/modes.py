"""
Modes of operation of a simulated drive: cyclic synchronous position and homing.

A mode takes its own bits of the controlword, makes the position demand, and returns its own bits
of the statusword.

References
----------
IEC 61800-7-201 (CiA 402-2): homing and cyclic synchronous position mode.

"""

from __future__ import annotations

import math
from typing import Any

from facade_manipulator.drives.profile import DriveProfile
from facade_manipulator.drives.states import Controlword, Status
from facade_manipulator.simulation.drives.homing import find_home, METHODS
from facade_manipulator.simulation.drives.motor import SimulatedMotor, STANDSTILL
from facade_manipulator.simulation.drives.objects import Key

_MAX_PERIOD = 1.0  # s: an interpolation period beyond it is longer than any servo uses


class SpeedRamp:
    """
    Demand [counts] whose speed approaches `goal` [counts/s] by a bounded acceleration [counts/s²].

    A caller may change the goal at any time.
    """

    def __init__(self, position: float, speed: float, acceleration: float) -> None:
        self.position, self.speed, self.acceleration = position, speed, acceleration
        self.goal = 0.0

    def step(self, step: float) -> tuple[float, float]:
        """Return demand position and speed after `step` seconds."""
        most = self.acceleration * step
        change = min(max(self.goal - self.speed, -most), most)
        self.position += (self.speed + 0.5 * change) * step
        self.speed += change
        return self.position, self.speed


class Idle:
    """No mode: a constant demand. The other modes move the demand by their objects."""

    def __init__(
        self, values: dict[Key, Any], motor: SimulatedMotor, profile: DriveProfile,
        units_per_count: float, ramp_units_per_count: float,
    ) -> None:
        self._values, self._motor, self._profile = values, motor, profile
        self._units, self._ramp_units = units_per_count, ramp_units_per_count
        self.enter()

    def enter(self) -> None:
        """Begin where the carriage is, at rest and with no target."""
        self._demand = SpeedRamp(self._motor.position, 0.0, 1.0)

    def control(self, before: int, controlword: int) -> None:
        """Take the mode's own bits of the controlword."""

    def latch(self) -> None:
        """Take what was sent for this SYNC."""

    def step(self, step: float) -> tuple[float, float]:
        """Return demand position and speed after `step` seconds."""
        return self._demand.step(step)

    def status(self) -> int:
        """Return the mode's own bits of the statusword."""
        return 0


class CyclicPosition(Idle):
    """Cyclic synchronous position: 607A is latched at each SYNC; a straight line leads there."""

    def enter(self) -> None:
        """Begin where the carriage is, at rest and with no target."""
        self._position, self._speed, self._remaining = self._motor.position, 0.0, 0.0

    def target(self) -> float:
        """Return the target position, in counts from the middle of the rail."""
        return self._values[0x607A, 0] - self._motor.offset

    def latch(self) -> None:
        """Take a target to be reached after one interpolation period; one of 0 makes a step."""
        period = self._values[0x60C2, 1] * 10.0 ** min(self._values[0x60C2, 2], 0)
        self._remaining = min(period, _MAX_PERIOD)
        if self._remaining > 0.0:
            self._speed = (self.target() - self._position) / self._remaining
        else:
            self._position = self.target()

    def step(self, step: float) -> tuple[float, float]:
        """Return demand position after `step` seconds, and the mean speed during them."""
        moving = min(step, self._remaining)
        self._remaining -= moving
        self._position += self._speed * moving
        return self._position, self._speed * moving / step

    def status(self) -> int:
        """Return the mode's own bits of the statusword."""
        return 0 if self._profile.quirks.never_follows else Status.DRIVE_FOLLOWS


class Homing(Idle):
    """Homing: started by a rising edge of controlword bit 4, interrupted by its falling edge."""

    attained = False  #: by the last homing; it stays when the mode is left and entered again
    _failed = False

    def supports(self, method: int) -> bool:
        """Return whether the drive has a homing method."""
        return method in METHODS and method in self._profile.homing_methods

    def enter(self) -> None:
        """Begin where the carriage is, at rest."""
        super().enter()
        self._home: float | None = None

    def control(self, before: int, controlword: int) -> None:
        """Start or interrupt homing."""
        start = controlword & Controlword.HOMING_START
        if start and not before & Controlword.HOMING_START:
            method = self._values[0x6098, 0]
            self._home = find_home(method, self._motor) if self.supports(method) else None
            self.attained, self._failed = False, self._home is None
            self._demand.acceleration = self._values[0x609A, 0] / self._ramp_units
        elif not start:
            self._home = None

    def step(self, step: float) -> tuple[float, float]:
        """Return demand position and speed after `step` seconds."""
        self._demand.goal = 0.0
        if self._home is not None:
            way, acceleration = self._home - self._demand.position, self._demand.acceleration
            fast = self._values[0x6099, 1] / self._units
            self._demand.goal = math.copysign(
                min(fast, math.sqrt(2.0 * acceleration * abs(way))), way)
            if abs(way) < 1.0 + 2.0 * acceleration * step * step:  # it is found while braking
                self._finish(self._home)
        return super().step(step)

    def _finish(self, home: float) -> None:
        self._home, self.attained = None, True
        if offset := self._profile.location('home_offset'):  # from home to the new zero
            at_home = -self._values[offset]
        else:
            at_home = self._values[self._profile.location('home_position') or (0x607C, 0)]
        self._motor.offset = at_home - round(home)

    def status(self) -> int:
        """Return the mode's own bits of the statusword."""
        rests = self._home is None and abs(self._motor.velocity) < STANDSTILL
        return (Status.TARGET_REACHED * rests | Status.HOMING_ATTAINED * self.attained
                | Status.HOMING_ERROR * self._failed)
