"""
Homing methods of a simulated drive, each as a coroutine over time steps.

A method yields the speed it wants, steps with the machine, and returns the home position. It
yields None to give up pushing: then the demand begins again where the carriage is.

References
----------
CiA 402-2, homing mode: methods 1 to 37. Methods -1 to -4 (hard stop found by the motor current)
are maxon's.

"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
import math

from facade_manipulator.simulation.drives.motor import HOME_SWITCH, LIMITS, SimulatedMotor

Steps = Generator[float | None, None, float]


class HomingFailed(Exception):
    """The switch, stop or index is not where the method looks for it."""


@dataclass(frozen=True)
class Search:
    """A motor, and what a search takes from the objects of the drive."""

    motor: SimulatedMotor
    fast: float  #: speed towards the switch, in counts/s
    slow: float  #: speed for finding the edge, in counts/s
    threshold: float  #: torque that means a hard stop, in thousandths of the rated torque

    def run(self, method: int) -> Steps:
        """Search as a method says, then for the index pulse if it wants one."""
        plain = INDEXED.get(method, method)
        search, direction = SEARCHES[plain]
        home = yield from search(self, direction)
        if plain != method:
            home = yield from self.index(-direction, home)
        return home

    def here(self, direction: int) -> Steps:
        """Take the present position."""
        return self.motor.position
        yield

    def index(self, direction: int, start: float | None = None) -> Steps:
        """Go to the first index pulse after `start`; there is one per revolution of the motor."""
        revolution = self.motor.counts_per_revolution
        turns = (self.motor.position if start is None else start) / revolution
        pulse = revolution * (math.floor(turns) + 1 if direction > 0 else math.ceil(turns) - 1)
        while (pulse - self.motor.position) * direction > 0.0:
            self._reject(direction)
            yield direction * self.slow
        return pulse

    def limit(self, direction: int) -> Steps:
        """Find the inner edge of a limit switch."""
        while not self.motor.inputs & LIMITS[direction > 0]:
            yield direction * self.fast
        return (yield from self._leave(LIMITS[direction > 0], -direction))

    def home_edge(self, direction: int) -> Steps:
        """Find the edge of the home switch that faces away from `direction`."""
        while not self.motor.inputs & (HOME_SWITCH | LIMITS[direction > 0]):
            yield direction * self.fast
        while self.motor.velocity * direction > 1.0:  # which may lead beyond the switch
            yield 0.0
        while not self.motor.inputs & HOME_SWITCH:
            self._reject(-direction)
            yield -direction * self.fast
        return (yield from self._leave(HOME_SWITCH, -direction))

    def stop(self, direction: int) -> Steps:
        """Push against a hard stop until the current says so."""
        while self.motor.torque * direction < self.threshold or self.motor.velocity != 0.0:
            yield direction * self.fast
        yield None
        return self.motor.position

    def _leave(self, switch: int, direction: int) -> Steps:
        """Go slowly off a switch; return its edge."""
        while self.motor.inputs & switch:
            yield direction * self.slow
        return self.motor.edge(switch)

    def _reject(self, direction: int) -> None:
        if self.motor.inputs & LIMITS[direction > 0]:
            raise HomingFailed


SEARCHES = {
    37: (Search.here, 0), 35: (Search.here, 0), 34: (Search.index, 1), 33: (Search.index, -1),
    17: (Search.limit, -1), 18: (Search.limit, 1), 23: (Search.home_edge, 1),
    27: (Search.home_edge, -1), -3: (Search.stop, 1), -4: (Search.stop, -1)}
INDEXED = {1: 17, 2: 18, 7: 23, 11: 27, -1: -3, -2: -4}  # and the same without index pulse
METHODS = SEARCHES.keys() | INDEXED.keys()
