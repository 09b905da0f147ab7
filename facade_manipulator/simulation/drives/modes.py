"""
Modes of operation of a simulated drive: cyclic synchronous position, and homing.

A mode makes the position demand and returns its own bits of the statusword.

References
----------
IEC 61800-7-201 (CiA 402-2): homing and cyclic synchronous position mode, homing methods 1 to 37.
Maxon defines the methods -1 to -4, which find a hard stop from the motor current.

"""

from __future__ import annotations

import math

from facade_manipulator.canopen import indices
from facade_manipulator.drives.states import Controlword, Status
from facade_manipulator.simulation.drives.motor import SimulatedMotor, STANDSTILL
from facade_manipulator.simulation.drives.objects import Objects


class SpeedRamp:
    """
    Position demand [counts] whose speed approaches `goal` [counts/s].

    The acceleration of the demand is bounded [counts/s²].
    """

    def __init__(
        self, position: float, speed: float = 0.0, acceleration: float = 1.0
    ) -> None:
        self.position = position
        self.speed = speed
        self.acceleration = acceleration
        self.goal = 0.0

    def step(self, interval: float) -> float:
        """Move the demand over an interval [s]; return its speed [counts/s]."""
        most = self.acceleration * interval
        change = min(max(self.goal - self.speed, -most), most)
        self.position += (self.speed + 0.5 * change) * interval
        self.speed += change
        return self.speed


class Idle(SpeedRamp):
    """Mode without motion, with constant demand; base class of the other modes."""

    def __init__(self, objects: Objects, motor: SimulatedMotor) -> None:
        self._objects = objects
        self._motor = motor
        self.enter()

    def enter(self) -> None:
        """Start at rest at the carriage position."""
        super().__init__(self._motor.position)

    def status(self) -> int:
        """Return the mode-specific statusword bits."""
        return 0


class CyclicPosition(Idle):
    """Cyclic synchronous position: latch 607Ah at each SYNC, then interpolate linearly to it."""

    _remaining = 0.0  # s, of the interpolation period

    def target(self) -> float:
        """Return the target position [counts] relative to the middle of the rail."""
        return self._objects.values[indices.TARGET_POSITION, 0] - self._motor.offset

    def latch(self) -> None:
        """Latch a target, to be reached after one interpolation period; period 0 means a step."""
        values = self._objects.values
        value = values[indices.INTERPOLATION_PERIOD, 1]
        power = values[indices.INTERPOLATION_PERIOD, 2]
        self._remaining = value * 10.0 ** min(power, 0)
        if self._remaining > 0.0:
            self.speed = (self.target() - self.position) / self._remaining
        else:
            self.position = self.target()

    def step(self, interval: float) -> float:
        """Move the demand over an interval [s]; return its mean speed [counts/s]."""
        moving = min(interval, self._remaining)
        self._remaining -= moving
        self.position += self.speed * moving
        return self.speed * moving / interval

    def status(self) -> int:
        """Return the mode-specific statusword bits."""
        return Status.DRIVE_FOLLOWS * (not self._objects.profile.quirks.never_follows)


class Homing(Idle):
    """
    Homing: a rising edge of controlword bit 4 starts the homing, a falling edge interrupts it.

    The carriage moves directly to its home position.
    """

    # by method: attribute of SimulatedMotor; its side of the rail's middle; direction of the index
    # pulse from there, 0 for no index pulse
    _SEARCHES = {
        37: ('position', 1, 0),
        35: ('position', 1, 0),
        34: ('position', 1, 1),
        33: ('position', 1, -1),
        17: ('limit_switch', -1, 0),
        1: ('limit_switch', -1, 1),
        18: ('limit_switch', 1, 0),
        2: ('limit_switch', 1, -1),
        23: ('home_switch', -1, 0),
        7: ('home_switch', -1, -1),
        27: ('home_switch', 1, 0),
        11: ('home_switch', 1, 1),
        -4: ('hard_stop', -1, 0),
        -2: ('hard_stop', -1, 1),
        -3: ('hard_stop', 1, 0),
        -1: ('hard_stop', 1, -1),
    }

    attained = False  #: success of the last homing; the value survives a change of mode
    _failed = False

    def __init__(self, objects: Objects, motor: SimulatedMotor) -> None:
        super().__init__(objects, motor)
        methods = self._SEARCHES.keys() & objects.profile.homing_methods
        objects.choices[indices.HOMING_METHOD, 0] = {0, *methods}

    def enter(self) -> None:
        """Start at rest at the carriage position."""
        super().enter()
        self._home: float | None = None

    def control(self, before: int, controlword: int) -> None:
        """Start or interrupt homing."""
        start = controlword & Controlword.HOMING_START
        if not start:
            self._home = None
        elif not before & Controlword.HOMING_START:
            self._home = self._find_home(self._objects.values[indices.HOMING_METHOD, 0])
            self.attained = False
            self._failed = self._home is None
            self.acceleration = self._objects.counts(indices.HOMING_ACCELERATION)

    def _find_home(self, method: int) -> float | None:
        """Return the home position [counts]; None if the method or its switch is not available."""
        if method not in self._SEARCHES:
            return None
        edge, side, direction = self._SEARCHES[method]
        home = side * getattr(self._motor, edge)
        turn = self._motor.counts_per_revolution
        if edge == 'home_switch' and not home:
            return None
        if direction:  # there is one index pulse on each revolution
            return direction * turn * (math.floor(direction * home / turn) + 1)
        return home

    def step(self, interval: float) -> float:
        """Move the demand over an interval [s]; return its speed [counts/s]."""
        self.goal = 0.0
        if self._home is not None:
            way = self._home - self.position
            speed = self._objects.counts(indices.HOMING_SPEEDS, 1)
            braking = math.sqrt(2.0 * self.acceleration * abs(way))
            self.goal = math.copysign(min(speed, braking), way)
            if abs(way) < 1.0 + 2.0 * self.acceleration * interval * interval:
                self._count_from(self._home)  # reached while braking
        return super().step(interval)

    def _count_from(self, home: float) -> None:
        """End homing: set the encoder to the configured value at the home position [counts]."""
        values = self._objects.values
        profile = self._objects.profile
        offset = profile.location('home_offset')  # from home to the new zero
        if offset is None:
            place = profile.location('home_position') or (indices.HOME_OFFSET, 0)
            at_home = values[place]
        else:
            at_home = -values[offset]
        self._motor.offset = at_home - round(home)
        self._home = None
        self.attained = True

    def status(self) -> int:
        """Return the mode-specific statusword bits."""
        rests = self._home is None and abs(self._motor.velocity) < STANDSTILL
        return (
            Status.TARGET_REACHED * rests
            | Status.HOMING_ATTAINED * self.attained
            | Status.HOMING_ERROR * self._failed
        )
