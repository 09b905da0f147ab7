"""
Measure the control of the package on the simulated world: the tables of docs/results.md.

Figures count while a goal has been followed for 2.5 s, from 15 s after the first goal on. Force
and its peak count in the last 30 s. `--without` measures without a part of the control.
"""

import argparse
from contextlib import nullcontext
from dataclasses import replace
import math
from pathlib import Path
import sys
from unittest.mock import patch

import numpy as np

from facade_manipulator.compensation import correction
from facade_manipulator.motion.follower import SetpointFollower
from facade_manipulator.prediction import continuation, learning, reduction
from facade_manipulator.prediction.continuation import Continuation
from facade_manipulator.prediction.jumps import JumpDecision, JumpDetector
from facade_manipulator.prediction.tones import Tones
from facade_manipulator.simulation.world.scenario import load_scenario

sys.path.append(str(Path(__file__).resolve().parent / 'helpers'))
from closed_loop import ClosedLoop, ESTIMATOR_START, PERIOD, START  # noqa: E402

LEARNING_TIME = 15.0  # s, after the first goal
SETTLING_TIME = 2.5  # s, after each goal
FORCE_TIME = 30.0  # s, at the end
FIRST_TOUCH_TIME = 1.0  # s, from the first touch
FORCE = 30.0  # N, desired
TOUCH = 1.0  # N
SCALES = np.array([1e3, 1e3, math.degrees(1.0)])  # to mm, mm, °
# scenario and stiffness of the brush [N/mm]
ROWS = (
    'breeze',
    'three_tones',
    'gusts',
    'burst',
    'sensors',
    'pressing 0.6',
    'pressing 2',
    'pressing 5',
)
COLUMNS = (
    'without',
    'scenario',
    'attenuation x / y / θ [dB]',
    'RMS error [mm, mm, °]',
    'peak error [mm, mm, °]',
    'RMS jerk of the carriages [m/s³]',
    'within 2 σ [%]',
    'limited cycles',
    'rejections',
    'force RMS [N]',
    'force peak [N]',
    'first touch [N]',
)
solve = Continuation.solve


def do_nothing(*_):
    """Replace a method."""


def doubt_nothing(*_):
    """Accept all estimates."""
    return JumpDecision.UNDECIDED


def solve_and_trust(self, *arguments):
    """Trust all tones."""
    solve(self, *arguments)
    self.trust = np.ones_like(self.trust)


PARTS = {  # owner and name of each part of the control, and its replacement
    'tones': (Tones, 'fit', do_nothing),
    'doubt about tones': (Continuation, 'solve', solve_and_trust),
    'jump detector': (JumpDetector, 'evaluate', doubt_nothing),
    'prior': (
        continuation.Continuation,
        'PRIOR_WEIGHT',
        1e-5 * continuation.Continuation.PRIOR_WEIGHT,
    ),
    'weakening by growth': (learning.Learning, 'GROWTH', 1e9),
    'maximum acceleration': (
        reduction.Reduction,
        'MAX_ACCELERATION',
        1e3 * reduction.Reduction.MAX_ACCELERATION,
    ),
    'smoothing of the correction': (correction.Correction, 'SMOOTHING', 1e-4),
    'smoothing of the follower': (SetpointFollower, '_smooth', do_nothing),
}


def measure(row, seed, duration):
    """Return the figures of each column: three of x, y, θ, one, or none."""
    name, _, stiffness = row.partition(' ')
    scenario = replace(load_scenario(name), seed=seed)
    if stiffness:
        scaled = 1e3 * float(stiffness)
        wall = replace(scenario.wall, brush_stiffness=scaled)
        compensator = scenario.compensator | {'contact.stiffness': scaled}
        scenario = replace(scenario, wall=wall, compensator=compensator)
    loop = ClosedLoop(scenario)
    cycles = loop.mission(duration)
    times = np.array([one.time for one in cycles]) - START - ESTIMATOR_START
    since_goal = times % scenario.mission.goal_period
    is_counted = (times > LEARNING_TIME) & (since_goal > SETTLING_TIME)
    counted = [cycles[number] for number in np.flatnonzero(is_counted)]
    errors = np.array([one.error for one in counted])
    without = np.array([one.uncompensated for one in counted])
    rails = np.array([one.rail for one in counted])
    predicted = np.array([one.predicted for one in counted])
    deviations = np.array([one.deviations for one in counted])
    rms = np.sqrt((errors**2).mean(axis=0))
    disturbance = np.sqrt((without**2).mean(axis=0))
    # Where the head presses, the wall determines y.
    axes = [0, 2] if scenario.wall.is_touched else [0, 1, 2]
    learnt = cycles[round(LEARNING_TIME / PERIOD) :]
    commands = np.array([one.command for one in learnt])
    jerks = np.diff(commands, 3, axis=0) / PERIOD**3
    attenuation = 20.0 * np.log10(disturbance / rms)
    peaks = abs(errors).max(axis=0)
    is_within = abs(predicted - rails) < 2.0 * deviations
    limited = sum(one.is_limited for one in cycles) + loop.follower.limited_cycles
    return [
        attenuation[axes].tolist(),
        (rms * SCALES)[axes].tolist(),
        (peaks * SCALES)[axes].tolist(),
        [float(np.sqrt((jerks**2).mean()))],
        (100.0 * is_within.mean(axis=0)).tolist(),
        [limited],
        [len(loop.rejections)],
        *(forces(cycles) if scenario.wall.is_touched else [[], [], []]),
    ]


def forces(cycles):
    """Return RMS error of the force, its peak, and the peak at the first touch [N]."""
    times = np.array([one.time for one in cycles])
    heads = np.array([one.head for one in cycles])
    wrenches = np.array([one.wrench for one in cycles])
    along_x = np.sin(heads[:, 2]) * wrenches[:, 0]
    along_y = np.cos(heads[:, 2]) * wrenches[:, 1]
    values = -along_x - along_y
    late = values[times > times[-1] - FORCE_TIME]
    touch = times[np.argmax(values > TOUCH)]
    first = values[(times >= touch) & (times < touch + FIRST_TOUCH_TIME)]
    rms = float(np.sqrt(np.mean((late - FORCE) ** 2)))
    return [[rms], [float(late.max())], [float(first.max())]]


def cell(seeds):
    """Return the median over the seeds and the range of each figure."""
    texts = []
    for values in np.transpose(seeds):
        quantiles = np.quantile(values, (0.0, 0.5, 1.0))
        low, middle, high = (f'{value:.3g}' for value in quantiles)
        texts.append(middle if low == high else f'{middle} ({low}–{high})')
    return ' / '.join(texts)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(
        description='Measure the control on the simulated world'
    )
    parser.add_argument('--seeds', type=int, default=5)
    parser.add_argument(
        '--duration',
        type=float,
        default=60.0,
        help='s, at least 20: errors count after 15 s',
    )
    parser.add_argument(
        '--scenario', nargs='+', default=ROWS, help=f'{", ".join(ROWS)}, or a file'
    )
    parser.add_argument(
        '--without', nargs='+', default=['nothing'], choices=['nothing', *PARTS]
    )
    options = parser.parse_args()
    print(f'| {" | ".join(COLUMNS)} |\n|{"---|" * len(COLUMNS)}')
    for part in options.without:
        with patch.object(*PARTS[part]) if part in PARTS else nullcontext():
            for row in options.scenario:
                measured = [
                    measure(row, 1 + seed, options.duration)
                    for seed in range(options.seeds)
                ]
                cells = map(cell, zip(*measured, strict=True))
                print(f'| {" | ".join((part, row, *cells))} |', flush=True)


if __name__ == '__main__':
    main()
