"""
Measure the control of the package on the simulated world: the reference table of docs/results.md.

Figures count while a goal has been followed for 2.5 s, from 15 s after the first goal on. Force
and its peak count in the last 30 s.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import replace
import math

from closed_loop import ClosedLoop, Cycle, ESTIMATOR_START, PERIOD, START
import numpy as np

from facade_manipulator.simulation.world.scenario import load_scenario, Scenario

LEARNING_TIME, SETTLING_TIME = 15.0, 2.5  # s, after the first and after each goal
FORCE_TIME, FIRST_TOUCH_TIME = 30.0, 1.0  # s, at the end and from the first touch
FORCE, TOUCH = 30.0, 1.0  # N, desired force and touch
SCALES = np.array([1e3, 1e3, math.degrees(1.0)])  # to mm, mm, °
ROWS = ('breeze', 'three_tones', 'gusts', 'burst', 'sensors', 'pressing 0.6', 'pressing 2',
        'pressing 5')  # scenario and stiffness of the brush [N/mm]
COLUMNS = ('attenuation x / y / θ [dB]', 'RMS error [mm, mm, °]', 'peak error [mm, mm, °]',
           'RMS jerk of the carriages [m/s³]', 'within 2 σ [%]', 'limited cycles', 'rejections',
           'force RMS [N]', 'force peak [N]', 'first touch [N]')


def measure(row: str, seed: int, duration: float) -> list[list[float]]:
    """Return the figures of each column: three of x, y, θ, one, or none."""
    scenario = scenario_of(row, seed)
    loop = ClosedLoop(scenario)
    cycles = loop.mission(duration)
    times = np.array([one.time for one in cycles]) - START - ESTIMATOR_START
    is_counted = (times > LEARNING_TIME) & (times % scenario.mission.goal_period > SETTLING_TIME)
    errors, without, rails, predicted, deviations = (np.array([
        getattr(cycles[number], name) for number in np.flatnonzero(is_counted)]) for name in (
            'error', 'uncompensated', 'rail', 'predicted', 'deviations'))
    rms, disturbance = (np.sqrt((values ** 2).mean(axis=0)) for values in (errors, without))
    # Where the head presses, the wall determines y.
    axes = [0, 2] if scenario.wall.is_touched else [0, 1, 2]
    commands = np.array([one.command for one in cycles[round(LEARNING_TIME / PERIOD):]])
    limited = sum(one.is_limited for one in cycles) + loop.follower.limited_cycles
    figures = [20.0 * np.log10(disturbance / rms), rms * SCALES, abs(errors).max(axis=0) * SCALES]
    return [*(values[axes].tolist() for values in figures),
            [float(np.sqrt((np.diff(commands, 3, axis=0) ** 2).mean())) / PERIOD ** 3],
            (100.0 * (abs(predicted - rails) < 2.0 * deviations).mean(axis=0)).tolist(),
            [limited], [len(loop.rejections)],
            *(forces(cycles) if scenario.wall.is_touched else [[], [], []])]


def scenario_of(row: str, seed: int) -> Scenario:
    """Return the scenario of a row."""
    name, _, stiffness = row.partition(' ')
    scenario = replace(load_scenario(name), seed=seed)
    if not stiffness:
        return scenario
    return replace(
        scenario, wall=replace(scenario.wall, brush_stiffness=1e3 * float(stiffness)),
        compensator={**scenario.compensator, 'contact.stiffness': 1e3 * float(stiffness)})


def forces(cycles: Sequence[Cycle]) -> list[list[float]]:
    """Return RMS error of the force, its peak, and the peak at the first touch [N]."""
    times = np.array([one.time for one in cycles])
    values = np.array([-math.sin(one.head.theta) * one.wrench.fx - math.cos(
        one.head.theta) * one.wrench.fy for one in cycles])
    late = values[times > times[-1] - FORCE_TIME]
    touch = times[np.argmax(values > TOUCH)]
    first = values[(times >= touch) & (times < touch + FIRST_TOUCH_TIME)]
    return [[float(np.sqrt(np.mean((late - FORCE) ** 2)))], [float(late.max())],
            [float(first.max())]]


def cell(seeds: Iterable[Sequence[float]]) -> str:
    """Return the median over the seeds and the range of each figure."""
    texts = []
    for values in np.transpose(list(seeds)):
        low, middle, high = (f'{value:.3g}' for value in np.quantile(values, (0.0, 0.5, 1.0)))
        texts.append(middle if low == high else f'{middle} ({low}–{high})')
    return ' / '.join(texts)


def print_head(*names: str) -> None:
    """Print the head of a table whose first columns have names."""
    columns = (*names, *COLUMNS)
    print(f'| {" | ".join(columns)} |\n|{"---|" * len(columns)}')


def print_row(*names: str, seeds: int, duration: float) -> None:
    """Measure the scenario that is named last; print the names and the figures."""
    measured = [measure(names[-1], 1 + number, duration) for number in range(seeds)]
    cells = map(cell, zip(*measured, strict=True))
    print(f'| {" | ".join((*names, *cells))} |', flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description='Measure the control on the simulated world')
    parser.add_argument('--seeds', type=int, default=5)
    parser.add_argument(
        '--duration', type=float, default=60.0, help='s, at least 20: errors count after 15 s')
    parser.add_argument(
        '--scenario', action='append', help=f'{", ".join(ROWS)}, or a file; repeatable')
    options = parser.parse_args()
    print_head('scenario')
    for row in options.scenario or ROWS:
        print_row(row, seeds=options.seeds, duration=options.duration)


if __name__ == '__main__':
    main()
