"""
Command `lag`: sines in still air; gain, lag, bandwidth, friction and backlash of each axis.

The fits are pure: target, position and force by time in, numbers out. A sine is fitted by linear
least squares; a gain of 1/√2 is the bandwidth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math
from typing import Any, NamedTuple

import numpy as np

from facade_manipulator.drives.axis_settings import AXIS_NAMES
from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning import moving
from facade_manipulator.tools.commissioning.context import Context
from facade_manipulator.tools.commissioning.motion import AxisSample, Motion, PERIOD, TORQUE

FREQUENCIES = (1.0, 2.0, 5.0, 10.0, 20.0)  # Hz
_AMPLITUDE = 0.003  # m, where the speed permits it
_PERIODS, _SETTLING = 4, 1
_DELAY = 2  # cycles from a target's sending to the SYNC at which the drive shall be there
_TRIANGLE_SPEED, _TRIANGLE = 0.005, 0.005  # m/s, m
_ALIKE = 0.3
_CLEAR = 0.75
_MM, _MS = 1e3, 1e3


class Response(NamedTuple):
    """Answer to a sine: frequency [Hz], gain, lag [s], largest following error [m]."""

    frequency: float
    gain: float
    lag: float
    error: float


class AxisDynamics(NamedTuple):
    """What was found of an axis; forces in N, backlash in m; bandwidth None above the sines."""

    responses: tuple[Response, ...]
    coulomb: float
    viscous: float
    backlash: float

    @property
    def lag(self) -> float:
        """Median lag of the slow sines, or of the slowest [s]: what `drive_lag` is."""
        slow = max(2.0, min(one.frequency for one in self.responses))
        return float(np.median([one.lag for one in self.responses if one.frequency <= slow]))

    @property
    def bandwidth(self) -> float | None:
        """Frequency at which the gain falls to 1/√2 [Hz], interpolated; None if it does not."""
        for low, high in zip(self.responses, self.responses[1:], strict=False):
            if low.gain >= math.sqrt(0.5) > high.gain:
                share = (low.gain - math.sqrt(0.5)) / (low.gain - high.gain)
                return low.frequency * (high.frequency / low.frequency) ** share
        return None


def fit_sine(values: np.ndarray, frequency: float) -> complex:
    """Return amplitude and phase of a sine in values with an offset, as one complex number."""
    angle = 2.0 * np.pi * frequency * PERIOD * np.arange(len(values))
    basis = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(angle)])
    sine, cosine, _ = np.linalg.lstsq(basis, values, rcond=None)[0]
    return complex(sine, cosine)


def response(frequency: float, targets: np.ndarray, positions: np.ndarray) -> Response:
    """Compare targets with the positions when they were due, shape (n,)."""
    ratio = fit_sine(positions, frequency) / fit_sine(targets, frequency)
    return Response(frequency, abs(ratio), -np.angle(ratio) / (2.0 * np.pi * frequency),
                    float(np.abs(targets - positions).max()))


def fit_friction(sines: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[float, float]:
    """
    Return Coulomb [N] and viscous [N s/m] friction from velocities and forces of some motions.

    Only what is near the largest speed of each counts: after a reversal the backlash carries
    nothing, and a slow carriage may stick.
    """
    rows, forces = [], []
    for velocity, force in sines:
        clear = (np.abs(velocity) > _CLEAR * np.abs(velocity).max()) & (
            np.abs(force) > 0.5 * np.median(np.abs(force)))
        rows.append(np.column_stack(
            [np.sign(velocity), velocity, np.gradient(velocity, PERIOD)])[clear])
        forces.append(force[clear])
    coulomb, viscous, _ = np.linalg.lstsq(
        np.concatenate(rows), np.concatenate(forces), rcond=None)[0]
    return max(0.0, float(coulomb)), max(0.0, float(viscous))


def find_backlash(positions: np.ndarray, forces: np.ndarray) -> float:
    """
    Return the travel after a reversal in which the carriage does not resist [m], shape (n,).

    From the farthest position to where the force has risen to half of what the carriage resists
    with, between two samples. What the force needs to rise anyway, by the friction and by a filter
    of some 5 ms, makes it 0.05 mm more at the speed of the triangle.
    """
    steps, half = np.diff(positions), 0.5 * np.median(np.abs(forces))
    gaps = []
    for turn in np.flatnonzero(steps[1:] * steps[:-1] < 0.0) + 1:
        along = np.sign(steps[turn]) * forces[turn:]
        loaded = np.flatnonzero((along[1:] > half) & (along[:-1] <= half))
        if len(loaded):
            number = loaded[0]
            share = (half - along[number]) / (along[number + 1] - along[number])
            reached = positions[turn + number] + share * steps[turn + number]
            gaps.append(abs(reached - positions[turn]))
    return float(np.median(gaps)) if gaps else 0.0


def add_commands(add: Callable[..., Any]) -> None:
    """Add the command to the tool."""
    command = add('lag', run_lag, 'Lag, bandwidth, friction and backlash, by small sines.')
    command.add_argument('axes', nargs='*', metavar='AXIS',
                         help='default: all, one after the other')
    command.add_argument('--frequencies', type=float, nargs='+', default=FREQUENCIES,
                         metavar='HZ')
    moving.add_motion_options(command, speed=30.0)


def run_lag(context: Context) -> None:
    """Measure, draw, and offer to write `drive_lag`."""
    options, operator = context.options, context.operator
    speed, _ = moving.motion_bounds(context)
    found: dict[str, AxisDynamics] = {}
    for frequency in options.frequencies:
        if not 0.1 <= frequency <= 0.25 / PERIOD:
            raise CommissioningError(
                f'--frequencies {frequency:g} Hz is not between 0.1 and {0.25 / PERIOD:g} Hz')
    for name in options.axes or AXIS_NAMES:
        with moving.powered(context, name, 'sines of a few millimetres') as motion:
            motion.require(TORQUE, 'which shows friction and backlash')
            recording = record(motion, speed, options.frequencies)
        found[name] = analyse(recording)
    operator.table(
        ('axis', 'lag', 'bandwidth', 'following error', 'Coulomb', 'viscous', 'backlash'),
        [_row(name, one) for name, one in found.items()])
    for warning in unlike(found):
        operator.say(f'! {warning}')
    lag = round(float(np.mean([one.lag for one in found.values()])), 4)
    context.offer('controller', drive_lag=lag)


class AxisRecord(NamedTuple):
    """Sines by frequency [Hz] and a triangle: what was commanded, what the axis answered."""

    sines: dict[float, tuple[np.ndarray, list[AxisSample]]]
    triangle: list[AxisSample]


def record(motion: Motion, speed: float, frequencies: Sequence[float]) -> AxisRecord:
    """Move and record; nothing is computed here, for each cycle feeds the drives' watchdog."""
    sines = {}
    for frequency in frequencies:
        targets = sine(frequency, speed, motion.window)
        sines[frequency] = targets, follow(motion, targets)
        follow(motion, np.linspace(targets[-1], 0.0, 20))
    return AxisRecord(sines, follow(motion, triangle()))


def sine(frequency: float, speed: float, window: float) -> np.ndarray:
    """Return displacements [m] of some periods, within a speed, begun without a jump of it."""
    amplitude = min(_AMPLITUDE, speed / (2.0 * math.pi * frequency), window)
    angle = 2.0 * math.pi * frequency * PERIOD * np.arange(
        round((_PERIODS + _SETTLING) / frequency / PERIOD))
    return amplitude * np.minimum(1.0, angle / (2.0 * math.pi)) * np.sin(angle)


def analyse(recording: AxisRecord) -> AxisDynamics:
    """Return what a recording shows of an axis."""
    responses, motions = [], []
    for frequency, (targets, samples) in recording.sines.items():
        first = round(_SETTLING / frequency / PERIOD)
        positions, velocities, forces, _ = np.array(samples).T
        responses.append(response(frequency, targets[first:-_DELAY], positions[first + _DELAY:]))
        motions.append((velocities[first:], forces[first:]))
    positions, velocities, forces, _ = np.array(recording.triangle).T
    friction = fit_friction([*motions, (velocities, forces)])
    return AxisDynamics(tuple(responses), *friction, find_backlash(positions, forces))


def triangle() -> np.ndarray:
    """Return displacements to and fro at a constant speed [m]."""
    count = round(_TRIANGLE / _TRIANGLE_SPEED / PERIOD)
    rise = np.linspace(0.0, _TRIANGLE, count)
    return np.concatenate([rise, rise[::-1], rise, rise[::-1]])


def follow(motion: Motion, displacements: np.ndarray) -> list[AxisSample]:
    """Command displacements [m], one a cycle; return what the axis answered."""
    return [motion.step(value) for value in displacements.tolist()]


def unlike(found: dict[str, AxisDynamics]) -> list[str]:
    """Return in what the axes differ by more than can be expected of three of one kind."""
    warnings = []
    for what, unit, values in (
            ('lag', 'ms', {name: _MS * one.lag for name, one in found.items()}),
            ('Coulomb friction', 'N', {name: one.coulomb for name, one in found.items()}),
            ('backlash', 'mm', {name: _MM * one.backlash for name, one in found.items()})):
        middle = float(np.median(list(values.values())))
        bound = max(_ALIKE * abs(middle), {'ms': 2.0, 'N': 2.0, 'mm': 0.05}[unit])
        warnings += [f'{name}: {what} {value:.2f} {unit}, the others {middle:.2f} {unit}'
                     for name, value in values.items() if abs(value - middle) > bound]
    return warnings


def _row(name: str, one: AxisDynamics) -> tuple[str, ...]:
    bandwidth = one.bandwidth
    above = f'above {one.responses[-1].frequency:g} Hz'
    return (name, f'{_MS * one.lag:.1f} ms', f'{bandwidth:.1f} Hz' if bandwidth else above,
            f'{_MM * max(each.error for each in one.responses):.2f} mm', f'{one.coulomb:.1f} N',
            f'{one.viscous:.0f} N s/m', f'{_MM * one.backlash:.2f} mm')
