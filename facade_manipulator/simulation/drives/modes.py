"""
Modes of operation of a simulated drive: cyclic synchronous position and homing.

A mode gets the controlword's bits, makes the position demand, and returns the statusword's bits.

References
----------
IEC 61800-7-201 (CiA 402-2): homing and cyclic synchronous position mode.

"""

from __future__ import annotations

from typing import Any

from facade_manipulator.drives.profile import DriveProfile
from facade_manipulator.drives.states import Controlword, Status
from facade_manipulator.simulation.drives import homing
from facade_manipulator.simulation.drives.motor import SimulatedMotor, STANDSTILL
from facade_manipulator.simulation.drives.objects import Key

_MAX_PERIOD = 1.0  # s: an interpolation period beyond it is longer than any servo uses
_RATED_CURRENT = 2000  # mA, of a drive without 6075h


class Interpolator:
    """Demand of cyclic synchronous position [counts]: a straight line from SYNC to SYNC."""

    def __init__(self, position: float) -> None:
        self.position = self._target = position
        self.speed = self._remaining = 0.0

    def latch(self, target: float, period: float) -> None:
        """Take a target to be reached after one period in s; a period of 0 makes a step."""
        self._target, self._remaining = target, period
        if period > 0.0:
            self.speed = (target - self.position) / period
        else:
            self.position, self.speed = target, 0.0

    def step(self, step: float) -> tuple[float, float]:
        """Return demand position after `step` seconds, and the speed during them."""
        if self._remaining > step:
            self._remaining -= step
            self.position += self.speed * step
            return self.position, self.speed
        speed = (self._target - self.position) / step if self._remaining > 0.0 else 0.0
        self.position, self.speed, self._remaining = self._target, 0.0, 0.0
        return self.position, speed


class SpeedRamp:
    """
    Demand [counts] whose speed goes to `goal` [counts/s] with a bounded acceleration [counts/s²].

    A caller may change the goal at any time.
    """

    def __init__(self, position: float, speed: float, acceleration: float) -> None:
        self.position, self.speed, self._acceleration = position, speed, acceleration
        self.goal = 0.0

    def step(self, step: float) -> tuple[float, float]:
        """Return demand position and speed after `step` seconds."""
        most = self._acceleration * step
        change = min(max(self.goal - self.speed, -most), most)
        self.position += (self.speed + 0.5 * change) * step
        self.speed += change
        return self.position, self.speed


class Idle:
    """No mode: a demand that rests. The other modes move it as their objects say."""

    _demand: Interpolator | SpeedRamp

    def __init__(
        self, values: dict[Key, Any], motor: SimulatedMotor, profile: DriveProfile,
        units_per_count: float, ramp_units_per_count: float,
    ) -> None:
        self._values, self._motor, self._profile = values, motor, profile
        self._units, self._ramp_units = units_per_count, ramp_units_per_count
        self.share = 1.0  #: fault: which part of the way to a target it goes
        self.enter()

    def enter(self) -> None:
        """Begin where the carriage is, at rest and with no target."""
        self._demand = Interpolator(self._motor.position)

    def control(self, before: int, controlword: int) -> None:
        """Take the mode's own bits of the controlword."""

    def latch(self) -> None:
        """Take what was sent for this SYNC."""

    def step(self, step: float) -> tuple[float, float]:
        """Return demand position and speed after `step` seconds."""
        return self._demand.step(step)

    def status(self) -> int:
        """Return the mode's bits of the statusword."""
        return 0


class CyclicPosition(Idle):
    """Cyclic synchronous position: 607A is latched at each SYNC."""

    needed_bits = 0  #: controlword bits without which it takes no target, as some drives do
    _takes_targets = True
    _demand: Interpolator

    def enter(self) -> None:
        """Begin where the carriage is."""
        super().enter()
        self._start = self._motor.position

    def control(self, before: int, controlword: int) -> None:
        """Note whether the controlword lets it take targets."""
        self._takes_targets = controlword & self.needed_bits == self.needed_bits

    def latch(self) -> None:
        """Take the target position."""
        if not self._takes_targets:
            return
        values = self._values
        period = values[0x60C2, 1] * 10.0 ** min(values[0x60C2, 2], 0)
        way = values[0x607A, 0] - self._motor.offset - self._start
        self._demand.latch(self._start + self.share * way, min(period, _MAX_PERIOD))

    def status(self) -> int:
        """Return the mode's bits of the statusword."""
        follows = self._takes_targets and not self._profile.quirks.never_follows
        return Status.DRIVE_FOLLOWS if follows else 0


class Homing(Idle):
    """Homing: started by a rising edge of controlword bit 4, interrupted by its falling edge."""

    attained = False  #: by the last homing; it stays when the mode is left and entered again
    _failed = False
    _demand: SpeedRamp

    def supports(self, method: int) -> bool:
        """Return whether the drive has a homing method."""
        return method in homing.METHODS and method in self._profile.homing_methods

    def enter(self) -> None:
        """Begin where the carriage is, at rest."""
        self._search: homing.Steps | None = None
        self._demand = SpeedRamp(self._motor.position, 0.0, 1.0)

    def control(self, before: int, controlword: int) -> None:
        """Start or interrupt the search."""
        start = controlword & Controlword.HOMING_START
        if start and not before & Controlword.HOMING_START:
            self._begin(self._values[0x6098, 0])
        elif not start:
            self._search = None

    def _begin(self, method: int) -> None:
        self.attained, self._failed = False, not self.supports(method)
        if self._failed:
            return
        values, units = self._values, self._units
        self._demand = SpeedRamp(
            self._motor.position, 0.0, values[0x609A, 0] / self._ramp_units)
        rated = values.get((0x6075, 0), _RATED_CURRENT)
        where = self._profile.location('homing_current_threshold')
        current = values[where] if where else rated
        self._search = homing.Search(
            self._motor, values[0x6099, 1] / units, values[0x6099, 2] / units,
            1000.0 * current / max(rated, 1)).run(method)

    def step(self, step: float) -> tuple[float, float]:
        """Return demand position and speed after `step` seconds."""
        goal = None
        try:
            goal = next(self._search) if self._search else 0.0
            if goal is None:  # it gives up pushing
                self._demand.position, self._demand.speed = self._motor.position, 0.0
        except StopIteration as end:
            self._finish(end.value)
        except homing.HomingFailed:
            self._failed, self._search = True, None
        self._demand.goal = goal or 0.0
        return super().step(step)

    def _finish(self, home: float) -> None:
        self._search, self.attained = None, True
        if offset := self._profile.location('home_offset'):  # from home to the new zero
            at_home = -self._values[offset]
        else:
            at_home = self._values[self._profile.location('home_position') or (0x607C, 0)]
        self._motor.offset = at_home - round(home)

    def status(self) -> int:
        """Return the mode's bits of the statusword."""
        rests = self._search is None and abs(self._motor.velocity) < STANDSTILL
        return (Status.TARGET_REACHED * rests | Status.HOMING_ATTAINED * self.attained
                | Status.HOMING_ERROR * self._failed)
