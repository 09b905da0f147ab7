"""
Vary numbers of the control by half: the table of constants in docs/results.md.

`prediction` runs only the predictor, `estimation` only the estimator of raw sensors, in gusts.
`control` presses with 2 N/mm: errors of x and θ, jerk and force while the head holds the force.

A number is a constant of a module or of a class. Values that a module computes from a constant
when it is imported do not change with it. Each printed figure is divided by the usual one.
"""

import argparse
from contextlib import ExitStack
from pathlib import Path
from pkgutil import resolve_name
import sys
from unittest.mock import patch

import measure_control
import numpy as np

from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction.predictor import DisturbancePredictor

sys.path.append(str(Path(__file__).resolve().parent / 'helpers'))
from gusts import gusts  # noqa: E402
from sensor_record import record, Run  # noqa: E402

INTERVAL = 0.02  # s
NOISE = 1e-3  # m, m and rad
AHEAD = 0.12  # s
PRESSING_TIME = (
    45.0  # s: the head holds the force from 13 s on, the figures count from 15 s on
)
PRESSING_COLUMNS = (
    'RMS error [mm, mm, °]',
    'peak error [mm, mm, °]',
    'RMS jerk of the carriages [m/s³]',
    'within 2 σ [%]',
    'limited cycles',
    'force RMS [N]',
    'force peak [N]',
    'first touch [N]',
)


def prediction():
    """Return errors and share within 2 σ in gusts, with wrong estimates for 0.1 s every 5 s."""
    predictor = DisturbancePredictor()
    signal = gusts(1, INTERVAL)[:1500]
    errors = []
    noise = NOISE * np.random.default_rng(1).standard_normal(signal.shape)
    for number, truth in enumerate(signal[:-6]):
        stamp = number * INTERVAL
        wrong = 0.03 * (number % 250 < 5 < number)
        values = truth + noise[number] + wrong
        predictor.update(stamp, Pose(*values), 3 * [NOISE**2])
        error = predictor.predict(stamp + AHEAD).position - signal[number + 6]
        errors.append((error, error / predictor.deviations(stamp + AHEAD)))
    return figures(*np.transpose(errors[500:], (1, 0, 2)))


def estimation():
    """Return errors and share within 2 σ of the estimator of raw sensors in gusts."""
    errors, deviations = Run(record(20.0)).errors(5.0)
    return figures(errors, errors / deviations)


def control():
    """Return the figures of `PRESSING_COLUMNS`, pressing with 2 N/mm in gusts."""
    measured = measure_control.measure('pressing 2', 1, PRESSING_TIME)
    by_column = dict(zip(measure_control.COLUMNS[2:], measured, strict=True))
    return np.concatenate([by_column[column] for column in PRESSING_COLUMNS])


def figures(errors, ratios):
    """Return RMS errors of each axis and the share of the ratios within 2."""
    rms = np.sqrt((errors**2).mean(axis=0))
    return np.append(rms, (abs(ratios) < 2.0).mean())


def scaled(value, factor):
    """Return a number, a tuple or an array of numbers multiplied by a factor."""
    if isinstance(value, tuple):
        return tuple(factor * one for one in value)
    if isinstance(value, np.ndarray):
        return factor * value
    return type(value)(factor * value)


def main():
    """Print the figures by half and by one and a half of each number."""
    parser = argparse.ArgumentParser(description='Vary numbers of the control by half')
    parser.add_argument('measure', choices=('prediction', 'estimation', 'control'))
    parser.add_argument('names', nargs='+', help='such as prediction.tones.Tones.BLOCK')
    options = parser.parse_args()
    measure = globals()[options.measure]
    usual = measure()
    print('usual', usual)
    for place in options.names:
        owner, _, name = f'facade_manipulator.{place}'.rpartition('.')
        value = getattr(resolve_name(owner), name)
        for factor in (0.5, 1.5):
            changed = scaled(value, factor)
            with ExitStack() as stack:
                for place_of_name in (resolve_name(owner), *sys.modules.values()):
                    if vars(place_of_name).get(name) is value:
                        stack.enter_context(patch.object(place_of_name, name, changed))
                print(place, factor, (measure() / usual).round(3), flush=True)


if __name__ == '__main__':
    main()
