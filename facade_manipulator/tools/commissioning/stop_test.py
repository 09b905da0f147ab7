"""
Command `stop-test`: measure the stopping distance of each carriage for each kind of stop.

The stops are a quick stop, a silent master (1016h, 6007h), and a loss of power, as after STO. All
three carriages move together, so that a gap changes only by the difference of their distances.
"""

from __future__ import annotations

from threading import Event

import numpy as np

from facade_manipulator.drives.axis_settings import AXIS_NAMES
from facade_manipulator.drives.snapshot import AxisSnapshot
from facade_manipulator.drives.states import AxisCommand, Controlword, Mode, State
from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning.context import Context
from facade_manipulator.tools.commissioning.motion import ACCELERATION, Motion, powered
from facade_manipulator.tools.stopping import COASTING, SCATTER

QUICK_STOP, SILENT_MASTER, POWER_OFF = 'quick stop', 'silent master', 'power off'
REMEDIES = {
    QUICK_STOP: 'check 6085h, 605Ah, load and supply voltage',
    SILENT_MASTER: 'check 1016h and 6007h',
    POWER_OFF: 'give the deceleration below to stopping',
}
SILENCE = 1.0  # s without frames of the master, after which every drive must be at rest
_STEADY = 5  # cycles at the speed before the stop
_CYCLES = 3  # cycles from a command to the SYNC after its first effective SYNC
_HEARTBEATS = 1.2  # of the heartbeat time: each drive counts 1016h in its own ticks
_SLACK = 5e-4  # m, tolerance of positions read at rest
_STANDING, _STANDSTILL = 10, 5e-5  # cycles, and maximum travel in them [m]
_LONGEST = 5.0  # s
_MM = 1e3


def run_stop_test(context: Context) -> None:
    """Measure each kind of stop; fail if a distance exceeds the stopping analysis."""
    speed = context.options.speed
    # acceleration, deceleration with or without power, and a steady time
    window = speed * (speed / ACCELERATION + speed / COASTING + 0.1)
    problems = []
    for direction, way in zip((1, -1, 1), REMEDIES, strict=True):
        with powered(
            context, f'forth and back and stopped by {way}', window, speed
        ) as motion:
            track, does_follow = _stopped(motion, direction * speed, way)
            bounds = _bounds(motion, track, way)
        distances = np.abs(track[-1] - track[_STEADY - 1])
        for name, *one in zip(AXIS_NAMES, distances, bounds, does_follow, strict=True):
            distance, bound, follows = one
            print(f'{name}: {way}, {_MM * distance:.1f} of {_MM * bound:.1f} mm')
            if distance > bound or (follows and way == SILENT_MASTER):
                problems.append(
                    f'{name}: {way} does not stop it in time; next: {REMEDIES[way]}'
                )
    coasting = deceleration(
        track[_STEADY:], motion.period
    ).min()  # the last stop is without power
    print(
        f'next: stopping {" ".join(map(str, context.files))} --coasting {coasting:.2f}'
    )
    context.record('stop-test', {}, problems)


def _stopped(motion: Motion, speed: float, way: str) -> tuple[np.ndarray, list[bool]]:
    """
    Bring the carriages to a speed [m/s], stop them, and return their positions until rest [m].

    The positions of each cycle have the shape (n, 3); their first `_STEADY` rows are at the speed.
    The second array marks drives that would still follow targets after the stop.
    """
    cycles = motion.go(speed)
    while abs(motion.targets.speed) < abs(speed):
        next(cycles)
    track = [_positions(next(cycles)) for _ in range(_STEADY)]
    stopped = _stop(motion, way)
    track.append(_positions(stopped))
    end = motion.controller.clock.monotonic() + _LONGEST
    while (
        len(track) <= _STEADY + _STANDING
        or np.abs(track[-1] - track[-_STANDING]).max() > _STANDSTILL
    ):
        if motion.controller.clock.monotonic() > end:
            raise CommissioningError(
                f'{way}: a carriage still moves after {_LONGEST:g} s; '
                'next: use the emergency stop'
            )
        track.append(_positions(motion.turn()))
    return np.array(track), [
        axis.state is State.OPERATION_ENABLED for axis in stopped.values()
    ]


def _stop(motion: Motion, way: str) -> dict[str, AxisSnapshot]:
    """Execute a kind of stop; return the drives before the first command after the stop."""
    exchange, controller = motion.controller.exchange, motion.controller
    assert exchange is not None  # the bus is open while the drives have power
    motion.is_stopping = True
    if way == QUICK_STOP:
        motion.controller.stop('stop test')
    elif way == POWER_OFF:
        off = AxisCommand(Controlword.DISABLE_VOLTAGE, Mode.CYCLIC_SYNCHRONOUS_POSITION)
        for monitor, counts in zip(
            controller.monitors, controller.targets.counts, strict=True
        ):
            for cob_id, data in monitor.encode(off, counts):
                exchange.bus.send(
                    cob_id, data
                )  # the last command before the SYNC counts
    else:
        exchange.bus.stop_sync()  # as the kernel does when the process ends
        controller.clock.wait(Event(), SILENCE)
        if exchange.bus.has_kernel_sync:
            exchange.bus.start_sync(motion.period)
    return motion.turn()


def _positions(axes: dict[str, AxisSnapshot]) -> np.ndarray:
    return np.array([axis.position for axis in axes.values()], float)


def _bounds(motion: Motion, track: np.ndarray, way: str) -> np.ndarray:
    """Return the stopping distances that the stopping analysis assumes, shape (3,) [m]."""
    controller, settings = motion.controller, motion.controller.settings
    speeds = np.abs(track[_STEADY - 1] - track[0]) / ((_STEADY - 1) * motion.period)
    silence = _HEARTBEATS * settings.heartbeat_timeout if way == SILENT_MASTER else 0.0
    delay = settings.drive_lag + _CYCLES * motion.period + silence
    assumed = np.array(
        [
            (1.0 - SCATTER) * COASTING if way == POWER_OFF else axis.stop_deceleration
            for axis in controller.axes
        ]
    )
    return speeds * (delay + 0.5 * speeds / assumed) + _SLACK


def deceleration(positions: np.ndarray, period: float) -> np.ndarray:
    """Return mean decelerations [m/s²] after a stop has begun, from positions (n, axes) [m]."""
    before, begin, after = positions[_CYCLES - 1 : _CYCLES + 2]
    speeds = (after - before) / (2.0 * period)
    return 0.5 * speeds**2 / np.maximum(np.abs(positions[-1] - begin), _SLACK)
