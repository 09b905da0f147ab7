"""
What the emergency stop leaves between the carriages: sampled, and as a matrix of the worst.

STO, stop category 0, takes the power away at once and the carriages coast. SS1-t, stop category
1 (IEC 60204-1, IEC 61800-5-2), lets all three drives brake by their quick-stop inputs first, and
takes the power away after a time. Carriages are where the driver lets them be, and as fast as
it allows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np

from facade_manipulator.control_loop.stopping_analysis import StoppingAnalysis
from facade_manipulator.errors import ParameterError
from facade_manipulator.motion.braking import displacements, starting_distances

COASTING = 1.87  # m/s²: 67 mm from 0.5 m/s, by friction and masses of the simulated axis
SCATTER = 0.2  # of the coasting deceleration, either way: friction varies along the rail
INPUT_SPREAD = 0.005  # s, by which the inputs of three drives may differ, filters and all
RELAY_SPREAD = 0.01  # s, the same of STO inputs
SAMPLES, TIMES = 20_000, 65
AT_LIMITS = 1.5  # of the speed limit, up to which speeds are drawn: a third is at the limit
TAIL = 0.1  # percent: 99.9 % of the samples are above
SPEEDS = (0.1, 0.2, 0.3, 0.4, 0.5)  # m/s
HEADS = (0.13, 0.2, 0.26, 0.32)  # m, y of the head, at θ = 0
LOADS = (1.0, 0.7)  # of the deceleration that an empty machine has


@dataclass(frozen=True)
class EmergencyStop:
    """
    How each carriage stops: after its own lag and delay, with a deceleration in between two.

    `delays` and `decelerations` are ranges in s and m/s².
    """

    name: str
    delays: tuple[float, float]
    decelerations: tuple[float, float]


def emergency_stops(
    analysis: StoppingAnalysis, coasting: float = COASTING
) -> tuple[EmergencyStop, ...]:
    """
    Return what may stop the carriages, the machine's own ways first.

    Raises a ParameterError for a coasting [m/s²] that stops nothing.
    """
    if not 0.0 < coasting < math.inf:
        raise ParameterError(
            f'coasting = {coasting:g} m/s^2 is no deceleration: a number above 0 m/s^2 is')
    brake, late = (analysis.separation.deceleration,) * 2, 2.0 * analysis.controller.period
    return (
        EmergencyStop('all three brake at once', (0.0, 0.0), brake),
        EmergencyStop('one brakes by itself and reports it', (0.0, late), brake),
        EmergencyStop('quick-stop inputs, then STO (SS1-t)', (0.0, INPUT_SPREAD), brake),
        EmergencyStop('power off (STO)', (0.0, RELAY_SPREAD), (
            (1.0 - SCATTER) * coasting, (1.0 + SCATTER) * coasting)))


def sto_delay(analysis: StoppingAnalysis) -> float:
    """Return when STO may follow the quick-stop inputs [s]: all stand, with the worst load."""
    slowest = analysis.limits.speed / (min(LOADS) * analysis.separation.deceleration)
    return math.ceil(100.0 * (slowest + analysis.controller.drive_lag + INPUT_SPREAD)) / 100.0


def sampled_gaps(analysis: StoppingAnalysis, stop: EmergencyStop) -> np.ndarray:
    """
    Return what is left between neighbours that stop [m], a value for each sample.

    Speeds, each drive's lag, delay (its jitter and the phase in the cycle) and deceleration are
    drawn; the distance is the least at which the driver allows the speeds.
    """
    chance, limits, geometry = np.random.default_rng(0), analysis.limits, analysis.geometry
    one, two = limits.speed * np.clip(
        chance.uniform(-AT_LIMITS, AT_LIMITS, (2, SAMPLES)), -1.0, 1.0)
    start = np.maximum(
        starting_distances(geometry.carriage_gap, limits, one, two),
        [analysis.separation.distance(speed) for speed in np.maximum(np.abs(one), np.abs(two))])
    delay = (chance.uniform(0.0, analysis.controller.drive_lag, (2, SAMPLES))
             + chance.uniform(*stop.delays, (2, SAMPLES)))
    deceleration = chance.uniform(*stop.decelerations, (2, SAMPLES))
    times = np.linspace(0.0, delay.max() + limits.speed / deceleration.min(), TIMES)
    way1, way2 = (
        displacements(speed[:, None], times, waits[:, None], slows[:, None])
        for speed, waits, slows in zip((one, two), delay, deceleration, strict=True))
    return (start[:, None] + way2 - way1).min(axis=1) - geometry.carriage_length


def matrix(
    analysis: StoppingAnalysis, stop: EmergencyStop, distance_of: Callable[[float], float],
) -> list[tuple[float, list[float]]]:
    """
    Return for each speed what is left [m], at each pose of the head with each load.

    Two neighbours run towards each other as fast as they may at their distance, both with the
    longest lag and delay, and with the least deceleration.
    """
    geometry, limits = analysis.geometry, analysis.limits
    delay = stop.delays[1] + analysis.controller.drive_lag

    def left(speed: float, head: float, load: float) -> float:
        distance, deceleration = distance_of(head), load * stop.decelerations[0]
        room = max(0.0, distance - geometry.carriage_gap)
        fastest = min(speed, analysis.separation.speed(distance),
                      math.sqrt(limits.acceleration * room))
        return (distance - fastest * (2.0 * delay + fastest / deceleration)
                - geometry.carriage_length)

    return [(speed, [left(speed, head, load) for head in HEADS for load in LOADS])
            for speed in SPEEDS if speed <= limits.speed]
