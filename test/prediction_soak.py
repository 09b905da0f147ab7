"""
Foretell an hour of gusts, and an hour of noise: ``make soak-prediction``.

Ends with exit status 1 if the prediction errs by more than a few millimetres anywhere in it, or an
opinion takes for an oscillation what no gondola does: what goes wrong here takes many minutes.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
import sys

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from facade_manipulator.control import oscillators  # noqa: E402
from facade_manipulator.kinematics import Pose  # noqa: E402
from facade_manipulator.prediction.predictor import (  # noqa: E402
    DisturbancePredictor,
    PredictionSettings,
)
from facade_manipulator.simulation.gondola import Gondola, GondolaSettings  # noqa: E402
from facade_manipulator.simulation.wind import WindSettings  # noqa: E402

RATE = 50.0  # Hz
HORIZON = 0.12  # s
DEVIATIONS = np.array((1e-3, 1e-3, 1.75e-3))  # m, m, rad: of the estimates' noise
STARTS = 10.0  # s
REPORT_EVERY = 600.0  # s
MOST_ERROR = 8.0  # mm, mrad
MOST_AMPLITUDE = 5.0  # m or rad; on 100 m of cable two of them reach the acceleration limit


def soak(motion: Callable[[float], Pose], seconds: float, seed: int) -> bool:
    """Foretell a motion; tell the worst errors as they come and return whether all was well."""
    random, good, worst, widest = np.random.default_rng(seed), True, np.zeros(3), 0.0
    predictor, variances = DisturbancePredictor(PredictionSettings()), Pose(*DEVIATIONS ** 2)
    told = 0.0
    for time in np.arange(0.0, seconds, 1.0 / RATE):
        measured = np.array(motion(time)) + DEVIATIONS * random.standard_normal(3)
        predictor.update(time, Pose(*measured), variances)
        if time < STARTS:
            continue
        error = np.subtract(predictor.predict(time + HORIZON).position, motion(time + HORIZON))
        worst = np.maximum(worst, 1e3 * np.abs(error))
        widest = max(widest, np.abs(oscillators.phasors(predictor._bank.states)).max())
        if time + 1.0 / RATE >= min(told + REPORT_EVERY, seconds):
            told += REPORT_EVERY
            good &= bool(worst.max() < MOST_ERROR and widest < MOST_AMPLITUDE)
            print(f'  {time:5.0f} s: errors up to {worst[0]:.1f} mm, {worst[1]:.1f} mm, '
                  f'{worst[2]:.1f} mrad; amplitudes up to {widest:.2f} m', flush=True)
            worst, widest = np.zeros(3), 0.0
    return good


def main() -> int:
    """Soak one gondola in noise alone and several in gusts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=3600.0, help='of each motion [s]')
    parser.add_argument('--seeds', type=int, default=2, help='of the gusts')
    options = parser.parse_args()
    print('at rest')
    good = soak(lambda _: Pose(0.0, 0.0, 0.0), options.duration, 0)
    for cable, wind in ((30.0, 4.0), (100.0, 4.0)):
        for seed in range(1, options.seeds + 1):
            print(f'{wind:g} m/s on {cable:g} m of cable, seed {seed}')
            gondola = Gondola(
                GondolaSettings(cable_length=cable), WindSettings(mean_speed=wind, seed=seed))
            good &= soak(gondola.at, options.duration, seed)
    print('good' if good else 'NOT GOOD')
    return 0 if good else 1


if __name__ == '__main__':
    sys.exit(main())
