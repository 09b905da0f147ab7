"""
Hoist past transoms for an hour on raw sensors: ``make soak-estimator``.

Ends with exit status 1 if the estimator starts again, is off by ten of its standard deviations, or
gives itself wrong ones. With ``--picture`` it draws what it does without its fix of x.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
import sys

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent / 'helpers'))

from estimator_plant import BETTER, Day, LASERS, Run, run, Wall  # noqa: E402

AXES = ('x [mm]', 'y [mm]', 'yaw [deg]')
SETTLED = 10.0  # s
MOST, INSIDE = 10.0, (0.90, 0.995)  # standard deviations, share within two of them
LOST = (0.5, 2.0, 5.0, 20.0)  # s
SENSORS = {**LASERS, 'fix': BETTER}


def main() -> int:
    """Print the figures; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=3600.0, help='s (default %(default)g)')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--picture', type=Path, metavar='PNG', help='of the fix lost, instead')
    options = parser.parse_args()
    if options.picture is not None:
        draw(options.picture, options.seed)
        return 0
    outcome = run(Day(options.duration, options.seed, hoisting=0.2), SENSORS,
                  wall=Wall(options.seed, transom=0.03), every=2)
    errors, deviations = outcome.errors(SETTLED)
    normalised = np.abs(errors) / deviations
    inside = (normalised < 2.0).mean(axis=0)
    for axis, error, worst, share in zip(
            AXES, errors.T, normalised.max(axis=0), inside, strict=True):
        print(f'{axis:10s} RMS {error.std():.3f}, worst {np.abs(error).max():.3f} and {worst:.1f} '
              f'of its own standard deviations, within two {100.0 * share:.1f} %')
    squares = squared_errors(outcome)
    print('normalised squared error of the pose, 3 is right:', *(
        f'{part.mean():.2f}' for part in np.array_split(squares, 6)), 'by sixths')
    restarts = [event for event in outcome.estimator.events
                if event.stamp > 1000.0 + SETTLED and 'start' in event.reason]
    delay, deviation = outcome.estimator.delays()['fix']
    print(f'{len(restarts)} restarts', *restarts,
          f'; delay of the fix found {1e3 * delay:.1f} +- {1e3 * deviation:.1f} ms, true 0')
    low, high = INSIDE
    return int(bool(restarts) or normalised.max() > MOST or abs(delay) > 3.0 * deviation
               or not (low < inside.min() and inside.max() < high))


def squared_errors(outcome: Run) -> np.ndarray:
    """Return the squared errors of the pose by its covariance, constant offsets taken off."""
    since = np.array(outcome.stamps) >= SETTLED
    errors = (np.array(outcome.poses) - outcome.truth)[since]
    errors -= np.median(errors, axis=0)
    return np.einsum(
        'ki,kij,kj->k', errors, np.linalg.inv(np.array(outcome.covariances)[since]), errors)


def draw(path: Path, seed: int) -> None:
    """Draw the error of x and two of its standard deviations while the fix is lost."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 2.6), layout='constrained')
    for axes, lost in zip(figure.subplots(1, len(LOST)), LOST, strict=True):
        begin, end = 25.0, 25.0 + lost
        outcome = run(Day(end + 10.0, seed), {
            **SENSORS, 'fix': replace(BETTER, lost=((begin, end),))}, every=2)
        errors, deviations = outcome.errors(begin - 2.0, end + 2.0)
        stamps = np.array(outcome.stamps)
        times = stamps[(stamps >= begin - 2.0) & (stamps < end + 2.0)] - begin
        scale = 1.0 if np.abs(errors[:, 0]).max() < 100.0 else 1e-3
        axes.fill_between(times, -2.0 * scale * deviations[:, 0], 2.0 * scale * deviations[:, 0],
                          color='0.85', lw=0.0, label='±2 σ of its own')
        axes.plot(times, scale * errors[:, 0], color='C0', lw=1.0, label='error of x')
        axes.axvspan(0.0, lost, color='C3', alpha=0.1, lw=0.0)
        bound = 1.2 * scale * np.abs(errors[:, 0]).max()
        axes.set(title=f'lost for {lost:g} s', xlabel='s', ylim=(-bound, bound),
                 ylabel='mm' if scale == 1.0 else 'm')
    axes.legend(fontsize='small')
    figure.savefig(path, dpi=100)


if __name__ == '__main__':
    raise SystemExit(main())
