"""
Command `stop-test`: measure how each carriage stops in each kind of stop.

The command compares the stopping distance, and the deceleration of a quick stop, with the stopping
analysis. A distance alone would hide a weak brake behind a short delay (`braking_curve`).

The stops are a quick stop, a silent master (1016h, 6007h), and a loss of power, as after STO. All
three carriages move together, so that a gap changes only by the difference between their stopping
distances.
"""

from __future__ import annotations

from collections.abc import Iterator
import math
from typing import NamedTuple

import numpy as np

from facade_manipulator.canopen import indices
from facade_manipulator.drives.snapshot import AxisSnapshot
from facade_manipulator.drives.states import (
    AxisCommand,
    Controlword,
    decode_state,
    describe_state,
    Mode,
    State,
)
from facade_manipulator.drives.stopping_distances import SCATTER
from facade_manipulator.errors import CommissioningError
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.kinematics.planar import MM
from facade_manipulator.tools.commissioning.braking_curve import (
    Deceleration,
    fit_deceleration,
)
from facade_manipulator.tools.commissioning.low_speed_motion import (
    Motion,
    powered,
    RAMP_ACCELERATION,
)
from facade_manipulator.tools.commissioning.procedure import Context
from facade_manipulator.tools.commissioning.tool_bus import ToolBus
from facade_manipulator.tools.stopping import COASTING_DECELERATION

QUICK_STOP = 'quick stop'
SILENT_MASTER = 'silent master'
POWER_OFF = 'power off'
REMEDIES = {
    QUICK_STOP: 'check 6085h, 605Ah, load and supply voltage',
    SILENT_MASTER: 'check 1016h and 6007h',
    POWER_OFF: 'pass the deceleration below to stopping',
}
_STEADY = 5  # cycles at the speed before the stop


class Track(NamedTuple):
    """Positions of the three carriages during a stop, at first at constant speed (`_STEADY`)."""

    times: np.ndarray  #: of the SYNCs, shape (n,) [s]
    positions: np.ndarray  #: shape (n, 3) [m]
    #: 6041h of each drive after a silent master, None without an answer; empty for other stops
    statuswords: list[int | None]
    uncertain: int  #: number of cycles that were late or lacked an answer, at least

    @property
    def distances(self) -> np.ndarray:
        """Return the maximum distances from the start of the stop, shape (3,) [m]."""
        return np.abs(self.positions - self.positions[_STEADY - 1]).max(axis=0)

    @property
    def speeds(self) -> np.ndarray:
        """Return the speeds before the stop, shape (3,) [m/s]."""
        steady = self.times[_STEADY - 1] - self.times[0]
        return np.abs(self.positions[_STEADY - 1] - self.positions[0]) / steady


_LEAST_COASTING = 0.01  # m/s², with two decimals: `stopping` rejects 0.00


def run_stop_test(context: Context) -> None:
    """Measure each kind of stop; fail if it is weaker than the stopping analysis assumes."""
    speed = context.options.speed
    # acceleration, deceleration with or without power, and a steady time
    window = speed * (speed / RAMP_ACCELERATION + speed / COASTING_DECELERATION + 0.1)
    problems: list[str] = []
    coasting = math.inf
    for direction, way in zip((1, -1, 1), REMEDIES, strict=True):
        action = f'back and forth, and stopped by {way}'
        with powered(context, 'stop-test', action, window, speed) as motion:
            track = _stopped(motion, direction * speed, way)
            bounds = _bounds(motion, track, way)
        found: list[str] = []  # problems of this stop
        lag = motion.controller.settings.drive_lag
        for number, axis in enumerate(motion.controller.axes):
            name = AXIS_NAMES[number]
            distance = track.distances[number]
            bound = f'{MM * bounds[number]:.1f} mm'
            shown = f'{name}: {way}, {MM * distance:.1f} of {bound}'
            if distance > bounds[number]:
                found.append(
                    f'{name}: {way} stops the carriage after {MM * distance:.1f} mm, above the '
                    f'limit {bound}; next: {REMEDIES[way]}'
                )
            # without SYNC there are no positions of the braking
            if way == SILENT_MASTER:
                print(shown)
                timeout = motion.controller.settings.heartbeat_timeout
                found += _obedience(name, track.statuswords[number], timeout)
                continue
            measured = fit_deceleration(
                track.times, track.positions[:, number], _STEADY, lag
            )
            print(f'{shown}, deceleration {measured}')
            if way == QUICK_STOP:
                found += _weakness(name, measured, axis.settings.stop_deceleration)
            else:
                # `stopping` subtracts SCATTER, so that it assumes at most the minimum
                highest = measured.least / (1.0 - SCATTER)
                coasting = min(coasting, measured.best, highest)
        # without SYNC, the positions after the braking are sufficient
        if track.uncertain and way != SILENT_MASTER:
            note = (
                f'{way}: {track.uncertain} of {len(track.times)} cycles were late or lacked an '
                'answer, so that the figures are uncertain; next: end other programs, and repeat '
                'commission stop-test'
            )
            if found:
                found.insert(0, note)  # the first remedy
            else:
                print(note)
        problems += found
    files = ' '.join(map(str, context.files))
    print(f'next: stopping {files} --coasting {max(coasting, _LEAST_COASTING):.2f}')
    context.record('stop-test', {}, problems)


def _obedience(name: str, statusword: int | None, timeout: float) -> Iterator[str]:
    """Yield a problem if a drive still obeys a silent master; its timeout is 1016h [s]."""
    if statusword is None:
        yield (
            f'{name}: {SILENT_MASTER}: the drive does not answer for its statusword (6041h) '
            f'{MASTER_SILENCE:g} s after the last heartbeat; next: check cable and 1029h'
        )
        return
    used = statusword & 0xFFFF  # some drives send four bytes
    if decode_state(used) is State.OPERATION_ENABLED:
        yield (
            f'{name}: {SILENT_MASTER} does not stop the drive, which is in '
            f'{describe_state(used)} {MASTER_SILENCE:g} s after the last heartbeat (limit '
            f'{timeout:g} s); next: {REMEDIES[SILENT_MASTER]}'
        )


_LEAST_SHARE = 0.8  # of stop_deceleration: certain minimum of a quick stop


def _weakness(name: str, measured: Deceleration, configured: float) -> Iterator[str]:
    """Yield a problem if a quick stop may be much weaker than configured [m/s²]."""
    least = _LEAST_SHARE * configured
    if measured.most < configured:
        yield (
            f'{name}: {QUICK_STOP} decelerates with {measured}, below axes.stop_deceleration = '
            f'{configured:g} m/s^2; next: {REMEDIES[QUICK_STOP]}, or reduce '
            'axes.stop_deceleration'
        )
    elif measured.least < least:
        yield (
            f'{name}: {QUICK_STOP} decelerates with {measured}, and its minimum is below '
            f'{least:g} m/s^2, {_LEAST_SHARE:g} of axes.stop_deceleration: the measurement is '
            'not accurate enough; next: repeat with commission stop-test --speed 300'
        )


_LONGEST = 5.0  # s


def _stopped(motion: Motion, speed: float, way: str) -> Track:
    """Move the carriages at a speed [m/s] and stop them; return their positions until rest."""
    times: list[float] = []
    positions: list[list[float]] = []

    def record(axes: dict[str, AxisSnapshot]) -> None:
        times.append(motion.sync_time)
        positions.append([axis.position or 0.0 for axis in axes.values()])

    cycles = motion.go(speed)
    while abs(motion.targets.speed) < abs(speed):
        next(cycles)
    for _ in range(_STEADY):
        record(next(cycles))
    counts = motion.cycles
    late = counts.late
    incomplete = counts.incomplete
    statuswords = _stop(motion, way)
    record(motion.turn())
    end = motion.controller.clock.monotonic() + _LONGEST
    while not _are_at_rest(positions):
        if motion.controller.clock.monotonic() > end:
            raise CommissioningError(
                f'{way}: a carriage still moves after {_LONGEST:g} s; '
                'next: use the emergency stop'
            )
        record(motion.turn())
    # a late cycle often also lacks an answer
    uncertain = max(counts.late - late, counts.incomplete - incomplete)
    return Track(np.array(times), np.array(positions), statuswords, uncertain)


_STANDING = 10  # cycles
_STANDSTILL = 5e-5  # m, maximum travel in them


def _are_at_rest(positions: list[list[float]]) -> bool:
    """Return whether the last positions of a stop are equal [m]."""
    if len(positions) <= _STEADY + _STANDING:
        return False
    last = np.array(positions[-_STANDING:])
    return bool(np.ptp(last, axis=0).max() <= _STANDSTILL)


# s without frames of the master, after which every drive must be at rest
MASTER_SILENCE = 1.0


def _stop(motion: Motion, way: str) -> list[int | None]:
    """Execute one kind of stop; after a silent master, return the statuswords of the drives."""
    controller = motion.controller
    exchange = controller.bus.exchange
    assert exchange is not None  # the bus is open while the drives have power
    motion.is_stopping = True
    if way == QUICK_STOP:
        motion.controller.stop('stop test')
    elif way == POWER_OFF:
        off = AxisCommand(Controlword.DISABLE_VOLTAGE, Mode.CYCLIC_SYNCHRONOUS_POSITION)
        for axis in controller.axes:
            for cob_id, data in axis.output.frames(off):
                # the last command before the SYNC counts
                exchange.bus.send(cob_id, data)
    else:
        exchange.bus.stop_sync()  # as the kernel does when the process ends
        controller.clock.sleep(MASTER_SILENCE)
        # The frames of the silence wait to be read. A slow computer ends its first cycle before
        # it has read them, and the next cycles contain the effect of its own commands.
        bus = ToolBus(exchange.bus, controller.clock)
        statuswords = [
            bus.number(axis.settings.node_id, indices.STATUSWORD)
            for axis in controller.axes
        ]
        if exchange.bus.has_kernel_sync:
            exchange.bus.start_sync(motion.period)
        return statuswords
    return []


_CYCLES = 3  # cycles from a command to the SYNC after its first effective SYNC
_HEARTBEATS = 1.2  # of the heartbeat time: each drive counts 1016h in its own ticks
_SLACK = 5e-4  # m, tolerance of positions read at rest


def _bounds(motion: Motion, track: Track, way: str) -> np.ndarray:
    """Return the stopping distances assumed by the stopping analysis, shape (3,) [m]."""
    controller = motion.controller
    settings = controller.settings
    silence = _HEARTBEATS * settings.heartbeat_timeout if way == SILENT_MASTER else 0.0
    delay = settings.drive_lag + _CYCLES * motion.period + silence
    assumed = np.array(
        [
            (1.0 - SCATTER) * COASTING_DECELERATION
            if way == POWER_OFF
            else axis.settings.stop_deceleration
            for axis in controller.axes
        ]
    )
    return track.speeds * (delay + 0.5 * track.speeds / assumed) + _SLACK
