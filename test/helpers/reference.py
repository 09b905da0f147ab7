"""
Measure the control of the package on the simulated world: the reference table of docs/results.md.

Attenuation is RMS without compensation over RMS with it. Figures count while a goal has stood for
2.5 s, from 15 s after the first goal on; force and its peak count in the last 30 s.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import replace
import math

from closed_loop import ClosedLoop, Cycle, ESTIMATOR_START, START
import numpy as np

from facade_manipulator.simulation.world.scenario import load_scenario, Scenario

LEARNING_TIME = 15.0  # s, of the predictor, after the first goal
SETTLING_TIME = 2.5  # s
FORCE_TIME = 30.0  # s, at the end
FORCE = 30.0  # N, desired
TOUCH = 1.0  # N
FIRST_TOUCH_TIME = 1.0  # s, from the first touch
SCALES = np.array([1e3, 1e3, math.degrees(1.0)])  # to mm, mm, °
ROWS = (  # scenario, stiffness of the brush [N/m]
    ('breeze', None), ('three_tones', None), ('gusts', None), ('burst', None), ('sensors', None),
    ('pressing', 600.0), ('pressing', 2000.0), ('pressing', 5000.0))
COLUMNS = ('attenuation x / y / θ [dB]', 'RMS error [mm, mm, °]', 'peak error [mm, mm, °]',
           'limited cycles', 'rejections', 'force RMS [N]', 'force peak [N]', 'first touch [N]')


def run(scenario: Scenario, duration: float) -> list[list[float]]:
    """Return the figures of each column: one of each axis, or one."""
    loop = ClosedLoop(scenario)
    cycles = list(loop.mission(duration))
    counted = [one for one in cycles if is_settled(one, scenario)]
    errors, without = (np.array([getattr(one, name) for one in counted])
                       for name in ('error', 'uncompensated'))
    rms, disturbance = (np.sqrt((values ** 2).mean(axis=0)) for values in (errors, without))
    # where the head presses, y is where the wall is
    axes = [0, 2] if scenario.wall.is_touched else [0, 1, 2]
    figures = [values[axes].tolist() for values in (
        20.0 * np.log10(disturbance / rms), rms * SCALES, abs(errors).max(axis=0) * SCALES)]
    return [*figures, [sum(one.is_limited for one in cycles)], [len(loop.rejections)],
            *(forces(cycles) if scenario.wall.is_touched else [[], [], []])]


def is_settled(cycle: Cycle, scenario: Scenario) -> bool:
    """Return whether the goal has stood for long enough."""
    elapsed = cycle.time - START - ESTIMATOR_START
    return elapsed > LEARNING_TIME and elapsed % scenario.mission.goal_period > SETTLING_TIME


def forces(cycles: Sequence[Cycle]) -> list[list[float]]:
    """Return RMS of the force's error, its peak, and the peak at the first touch [N]."""
    times = np.array([one.time for one in cycles])
    values = np.array([force_on_wall(one) for one in cycles])
    late = values[times > times[-1] - FORCE_TIME]
    touch = times[np.argmax(values > TOUCH)]
    first = values[(times >= touch) & (times < touch + FIRST_TOUCH_TIME)]
    return [[float(np.sqrt(np.mean((late - FORCE) ** 2)))], [float(late.max())],
            [float(first.max())]]


def force_on_wall(cycle: Cycle) -> float:
    """Return with what force the brush presses on the wall [N]."""
    theta = cycle.head.theta
    return -(math.sin(theta) * cycle.wrench.fx + math.cos(theta) * cycle.wrench.fy)


def cell(seeds: Iterable[Sequence[float]]) -> str:
    """Return the median over the seeds and the range of each figure."""
    texts = []
    for values in np.transpose(list(seeds)):
        low, middle, high = (f'{value:.3g}' for value in (
            values.min(), np.median(values), values.max()))
        texts.append(middle if low == high else f'{middle} ({low}–{high})')
    return ' / '.join(texts)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description='Measure the control on the simulated world')
    parser.add_argument('--seeds', type=int, default=5)
    parser.add_argument(
        '--duration', type=float, default=60.0, help='s, at least 20: errors count from 15 s on')
    parser.add_argument(
        '--scenario', action='append', help='only this name or file; may be repeated')
    options = parser.parse_args()
    if options.duration < 20.0:
        parser.error(f'--duration {options.duration:g} rejected: below 20 s; next: use 20')
    known = {name for name, _ in ROWS}
    rows = [row for row in ROWS if not options.scenario or row[0] in options.scenario]
    rows += [(name, None) for name in options.scenario or () if name not in known]
    print(f'| scenario | {" | ".join(COLUMNS)} |\n|{"---|" * (len(COLUMNS) + 1)}')
    for name, stiffness in rows:
        scenario = load_scenario(name)
        if stiffness:
            scenario = replace(
                scenario, wall=replace(scenario.wall, brush_stiffness=stiffness),
                compensator={**scenario.compensator, 'contact.stiffness': stiffness})
        seeds = [run(replace(scenario, seed=seed), options.duration)
                 for seed in range(1, options.seeds + 1)]
        title = f'{name}, {stiffness / 1e3:g} N/mm' if stiffness else name
        print(f'| {title} | {" | ".join(map(cell, zip(*seeds, strict=True)))} |', flush=True)


if __name__ == '__main__':
    main()
