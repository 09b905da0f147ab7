"""
Command `stop-test`: how far each carriage goes on when something stops it.

By a quick stop, by a master that falls silent (1016h, 6007h), and without power, which is what STO
does: all three move alike, so that no gap changes but by what their ways differ. What the stopping
analysis counts with is held beside.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from facade_manipulator.drives.axis_settings import AXIS_NAMES
from facade_manipulator.drives.states import State
from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning import moving
from facade_manipulator.tools.commissioning.context import Context
from facade_manipulator.tools.commissioning.motion import (
    ACCELERATION,
    HEARTBEAT_TIMEOUT,
    Motion,
    PERIOD,
    StopWay,
)
from facade_manipulator.tools.emergency_stop import COASTING, SCATTER

FASTEST = 0.3  # m/s: with 1 m/s² and coasting it stays within the largest window
_STEADY = 5  # cycles at the speed before the stop
_CYCLES = 3  # from a command to the SYNC after the one at which it is in force
_HEARTBEATS = 1.2 * HEARTBEAT_TIMEOUT  # s: drives count 1016h in ticks of their own
_SLACK = 5e-4  # m, of reading positions at rest
_LEAST_COASTING = 0.5 * COASTING  # m/s²: farther no carriage may coast within the window
_LONGEST = 5.0  # s
_MM = 1e3


class Way(NamedTuple):
    """How far an axis went [m] from a speed [m/s], and how far it may; its mean deceleration."""

    speed: float
    distance: float
    allowed: float
    deceleration: float
    state: State | None  #: before anything was commanded after it

    @property
    def passed(self) -> bool:
        """Whether it stopped soon enough."""
        return self.distance <= self.allowed

    def __str__(self) -> str:
        return f'{_MM * self.distance:.1f} mm of {_MM * self.allowed:.1f}'


def add_commands(add: Callable[..., Any]) -> None:
    """Add the command to the tool."""
    command = add('stop-test', run_stop_test, 'Stop moving carriages by a quick stop, by silence '
                  'and without power, and measure how far each goes on.')
    moving.add_motion_options(command, speed=200.0, window=150.0, fastest=FASTEST)
    command.set_defaults(links='coupled')  # all three, in either case


def run_stop_test(context: Context) -> int:
    """Measure each way of stopping; report what the analysis does not cover."""
    operator, machine = context.operator, context.machine
    speed, window = moving.motion_bounds(context)
    if (needed := _room(speed)) > window:
        raise CommissioningError(
            f'--window {_MM * window:.0f} mm is less than the {_MM * needed:.0f} mm that '
            f'{_MM * speed:g} mm/s need: move slower, or more room')
    lag = machine.controller.drive_lag
    decelerations = [machine.axis(name).stop_deceleration for name in AXIS_NAMES]
    found: dict[StopWay, tuple[Way, ...]] = {}
    for number, way in enumerate(StopWay):
        direction = 1 - number % 2 * 2
        with moving.powered(
                context, AXIS_NAMES[0], f'towards {"+" if direction > 0 else "-"}q, then '
                f'{way.value}, standing {_MM * needed:.0f} mm or more apart') as motion:
            found[way] = measured(motion, direction * speed, way, [
                allowed(way, speed, lag, one) for one in decelerations])
    operator.table(('stopped by', *AXIS_NAMES, 'within'), [
        (way.value, *map(str, ways), 'yes' if all(one.passed for one in ways) else 'NO')
        for way, ways in found.items()])
    problems = _problems(found)
    for problem in problems:
        operator.say(f'! {problem}')
    coasting = min(one.deceleration for one in found[StopWay.POWER_OFF])
    if coasting < (least := (1.0 - SCATTER) * COASTING):
        operator.say(f'! without power a carriage brakes by {coasting:.2f} m/s^2 alone; stopping '
                     f'counts with {least:.2f} m/s^2 or more unless it gets --coasting')
    operator.say(f'next: stopping {machine.path} --coasting {coasting:.2f}')
    return 1 if problems else 0


def measured(
    motion: Motion, speed: float, way: StopWay, bounds: list[float]
) -> tuple[Way, ...]:
    """Bring the carriages to a speed [m/s] and stop them; return each one's way."""
    while abs(motion.ramp.speed) < abs(speed):
        motion.go(speed)
    before = []
    for _ in range(_STEADY):
        motion.go(speed)
        before.append(motion.positions)
    stop = motion.stop_by(way, _LONGEST)
    first, last, end = np.array(before[0]), np.array(before[-1]), np.array(stop.positions[-1])
    speeds = np.abs(last - first) / ((_STEADY - 1) * PERIOD)
    return tuple(map(Way, speeds.tolist(), np.abs(end - last).tolist(), bounds,
                     deceleration(np.array(stop.positions)).tolist(), stop.states))


def deceleration(positions: np.ndarray) -> np.ndarray:
    """Return mean decelerations [m/s²] once the stop is in force, of positions (n, axes) [m]."""
    before, begin, after = positions[_CYCLES - 1:_CYCLES + 2]
    speeds = (after - before) / (2.0 * PERIOD)
    return 0.5 * speeds**2 / np.maximum(np.abs(positions[-1] - begin), _SLACK)


def allowed(way: StopWay, speed: float, lag: float, deceleration: float) -> float:
    """Return how far a carriage may go on [m] from a speed [m/s]."""
    waits = {StopWay.SILENCE: _HEARTBEATS}
    slowest = (1.0 - SCATTER) * COASTING if way is StopWay.POWER_OFF else deceleration
    delay = lag + _CYCLES * PERIOD + waits.get(way, 0.0)
    return speed * (delay + 0.5 * speed / slowest) + _SLACK


def _room(speed: float) -> float:
    """Return the way of a whole test [m]: up to speed, steady, and the longest way to stop."""
    return speed * (0.5 * speed / ACCELERATION + (_STEADY + _CYCLES) * PERIOD
                    + max(_HEARTBEATS, 0.5 * speed / _LEAST_COASTING))


def _problems(found: dict[StopWay, tuple[Way, ...]]) -> list[str]:
    """Return who stops late under power, and who did not notice that the master was gone."""
    cures = {StopWay.QUICK_STOP: 'look at 6085h and 605Ah, load and supply voltage',
             StopWay.SILENCE: 'look at 1016h and 6007h'}
    lines = [
        f'{name}: {way.value} took {one} mm from {_MM * one.speed:.0f} mm/s: {cures[way]}'
        for way in cures for name, one in zip(AXIS_NAMES, found[way], strict=True)
        if not one.passed]
    return lines + [
        f'{name}: would still follow targets after a silent master: {cures[StopWay.SILENCE]}'
        for name, one in zip(AXIS_NAMES, found[StopWay.SILENCE], strict=True)
        if one.state is State.OPERATION_ENABLED]
