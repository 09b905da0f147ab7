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

from collections.abc import Callable, Generator
from dataclasses import dataclass
from functools import partial
import math

from facade_manipulator.simulation.drives.motor import (
    HOME_SWITCH,
    NEGATIVE_LIMIT,
    POSITIVE_LIMIT,
    SimulatedMotor,
    STANDSTILL,
)

Search = Generator[float | None, None, float]

_LIMIT_SWITCHES = {-1: NEGATIVE_LIMIT, 1: POSITIVE_LIMIT}


class HomingFailed(Exception):
    """The switch, stop or index is not where the method looks for it."""


@dataclass(frozen=True)
class HomingSettings:
    """What a search takes from the objects of the drive."""

    fast: float  #: speed towards the switch, in counts/s
    slow: float  #: speed for finding the edge, in counts/s
    acceleration: float  #: in counts/s²
    threshold: float  #: torque that means a hard stop, in thousandths of the rated torque


def _here(motor: SimulatedMotor, settings: HomingSettings) -> Search:
    return motor.position
    yield


def _index(direction: int, motor: SimulatedMotor, settings: HomingSettings) -> Search:
    """Methods 33 and 34: the index pulse next to here."""
    return (yield from _pulse_after(motor.position, direction, motor, settings))


def _pulse_after(
    start: float, direction: int, motor: SimulatedMotor, settings: HomingSettings
) -> Search:
    """Go to the first index pulse beyond `start`; there is one per revolution of the motor."""
    revolution = motor.counts_per_revolution
    turns = start / revolution
    pulse = revolution * (math.floor(turns) + 1 if direction > 0 else math.ceil(turns) - 1)
    while (pulse - motor.position) * direction > 0.0:
        _reject(motor, _LIMIT_SWITCHES[direction])
        yield direction * settings.slow
    return pulse


def _reject(motor: SimulatedMotor, switch: int) -> None:
    if motor.inputs & switch:
        raise HomingFailed


def _leave(switch: int, direction: int, motor: SimulatedMotor, settings: HomingSettings) -> Search:
    """Go slowly off a switch; return its edge."""
    while motor.inputs & switch:
        yield direction * settings.slow
    return motor.edge(switch)


def _limit(direction: int, motor: SimulatedMotor, settings: HomingSettings) -> Search:
    """Methods 17 and 18: the inner edge of a limit switch."""
    switch = _LIMIT_SWITCHES[direction]
    while not motor.inputs & switch:
        yield direction * settings.fast
    return (yield from _leave(switch, -direction, motor, settings))


def _home_edge(direction: int, motor: SimulatedMotor, settings: HomingSettings) -> Search:
    """Methods 23 and 27: the edge of the home switch that faces away from `direction`."""
    while not motor.inputs & (HOME_SWITCH | _LIMIT_SWITCHES[direction]):
        yield direction * settings.fast
    while motor.velocity * direction > STANDSTILL:  # which may lead beyond the switch
        yield 0.0
    while not motor.inputs & HOME_SWITCH:
        _reject(motor, _LIMIT_SWITCHES[-direction])
        yield -direction * settings.fast
    return (yield from _leave(HOME_SWITCH, -direction, motor, settings))


def _stop(direction: int, motor: SimulatedMotor, settings: HomingSettings) -> Search:
    """Methods -3 and -4: push against a hard stop until the current says so."""
    while motor.torque * direction < settings.threshold or motor.velocity != 0.0:
        yield direction * settings.fast
    yield None
    return motor.position


def _with_index(
    search: Callable[..., Search], direction: int, motor: SimulatedMotor, settings: HomingSettings
) -> Search:
    """Search first, then take the next index pulse in `direction`."""
    start = yield from search(motor, settings)
    return (yield from _pulse_after(start, direction, motor, settings))


METHODS: dict[int, Callable[[SimulatedMotor, HomingSettings], Search]] = {
    37: _here,
    35: _here,
    34: partial(_index, 1),
    33: partial(_index, -1),
}
for _plain, _indexed, _search, _direction in (
    (17, 1, _limit, -1),
    (18, 2, _limit, 1),
    (23, 7, _home_edge, 1),
    (27, 11, _home_edge, -1),
    (-3, -1, _stop, 1),
    (-4, -2, _stop, -1),
):
    METHODS[_plain] = partial(_search, _direction)
    METHODS[_indexed] = partial(_with_index, METHODS[_plain], -_direction)
