"""
Predict an hour of every motion that nobody tuned for: ``make soak-prediction``.

Ends with exit status 1 if in any of them the prediction is worse than its bound, if it is worse
than no compensation, or if the standard deviation that it gives itself is wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
import math
from pathlib import Path
import sys
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from facade_manipulator.kinematics import Pose  # noqa: E402
from facade_manipulator.prediction import (  # noqa: E402
    DisturbancePredictor,
    Estimate,
    EstimateMean,
    PredictionSettings,
    Variances,
)
from facade_manipulator.simulation.gondola import Gondola, GondolaSettings  # noqa: E402
from facade_manipulator.simulation.sway import Sway, SwaySettings  # noqa: E402
from facade_manipulator.simulation.wind import Wind, WindSettings  # noqa: E402

DEVIATIONS = np.array((1e-3, 1e-3, 1.75e-3))  # m, m, rad: of the estimates' noise
STARTS = 20.0  # s
FLOOR = 0.5  # of the noise, that may be passed on whatever comes
INSIDE = (0.90, 0.995)  # share of errors within two standard deviations: at rest noise hides them
STEP = 0.01  # s
PERIOD = 0.09  # s, in which errors change little
Motion = Callable[[float], Pose]


class Case(NamedTuple):
    """A motion, an estimator, and the RMS error that is allowed, by the estimates' noise."""

    motion: Callable[[int], Motion]
    bound: float
    rate: float = 50.0  # Hz
    latency: float = 0.05  # s
    noise: float = 1.0  # by the usual one
    jitter: float = 0.0  # s
    dropouts: float = 0.0  # s, every 5 s
    outliers: float = 0.0  # share, of 30 mm


def gusts(speed: float, cable: float = 30.0, spectrum: str = 'kaimal') -> Callable:
    """Return a double pendulum in gusts, by seed."""
    return lambda seed: Gondola(
        GondolaSettings(cable_length=cable),
        WindSettings(mean_speed=speed, spectrum=spectrum, seed=seed)).at


def tones(frequencies: tuple[float, ...]) -> Callable:
    """Return sines that get weaker with their frequency, by seed."""
    def motion(seed: int) -> Motion:
        random = np.random.default_rng(seed)
        settings = {}
        for axis, amplitude in (('x', 0.08), ('y', 0.012), ('yaw', 0.03)):
            settings[f'{axis}_frequency'] = tuple(random.uniform(0.9, 1.1, len(frequencies))
                                                  * frequencies)
            settings[f'{axis}_amplitude'] = tuple(
                amplitude * (frequencies[0] / f) ** 1.5 for f in frequencies)
            settings[f'{axis}_phase'] = tuple(random.uniform(0.0, math.tau, len(frequencies)))
        return Sway(SwaySettings(**settings)).at

    return motion


def winch(seed: int) -> Motion:
    """Return a pendulum whose cable goes from 10 m to 70 m and back at 1 m/s, in gusts."""
    wind, place, velocity, poses = Wind(WindSettings(seed=seed)), np.zeros(3), np.zeros(3), []

    def at(time: float) -> Pose:
        nonlocal place, velocity
        while len(poses) * STEP <= time:
            now = len(poses) * STEP
            block = wind.gusts(now + STEP * np.arange(500)) * (0.02, 0.005, 0.01)
            for k, push in enumerate(block):
                length = 40.0 + 30.0 * (2.0 * abs((now + STEP * k) / 60.0 % 2.0 - 1.0) - 1.0)
                velocity = velocity + STEP * (push - 9.81 / length * place - 0.02 * velocity)
                place = place + STEP * velocity
                poses.append(Pose(*place.tolist()))
        return poses[int(time / STEP)]

    return at


def blows(seed: int) -> Motion:
    """Return a bump every half minute and its free decay."""
    tone = math.tau * np.array((0.12, 0.25, 0.2))

    def at(time: float) -> Pose:
        since = time % 30.0
        swing = np.exp(-0.03 * tone * since) * np.sin(tone * since)
        return Pose(*((0.05, 0.012, 0.03) * swing).tolist())

    return at


def steps(seed: int) -> Motion:
    """Return a step to and fro every ten seconds."""
    return lambda time: Pose(*(3 * [0.02 * (time % 20.0 > 10.0)]))


def creep(seed: int) -> Motion:
    """Return gusts whose estimates creep away and come back."""
    gondola = gusts(4.0)(seed)
    return lambda time: Pose(*np.add(gondola(time), 0.1 * math.sin(time / 100.0)).tolist())


CASES = {
    'rest': Case(lambda seed: lambda time: Pose(0.0, 0.0, 0.0), 0.25),
    'two tones': Case(tones((0.11, 0.3)), 0.6),
    'three tones': Case(tones((0.12, 0.31, 0.83)), 0.8),
    'five tones': Case(tones((0.1, 0.23, 0.41, 0.77, 1.3)), 2.0),
    'gusts': Case(gusts(4.0), 0.8),
    'a light wind': Case(gusts(1.5), 0.5),
    'a long cable': Case(gusts(4.0, 100.0), 0.8),
    'von Kármán 5 m/s, 10 m': Case(gusts(5.0, 10.0, 'von_karman'), 1.2),
    'von Kármán 5 m/s, 100 m': Case(gusts(5.0, 100.0, 'von_karman'), 1.2),
    'von Kármán 10 m/s, 10 m': Case(gusts(10.0, 10.0, 'von_karman'), 2.2),
    'von Kármán 10 m/s, 30 m': Case(gusts(10.0, 30.0, 'von_karman'), 2.2),
    'cable of 10 to 70 m': Case(winch, 1.0),
    'bumps': Case(blows, 2.5),
    'steps': Case(steps, 8.0),
    'a bias that creeps': Case(creep, 0.8),
    'estimator of 20 Hz': Case(gusts(4.0), 1.0, rate=20.0, latency=0.1, noise=3.0),
    'estimator of 200 Hz': Case(gusts(4.0), 0.8, rate=200.0, latency=0.03),
    'dropouts of 0.3 s': Case(gusts(4.0), 1.1, dropouts=0.3),
    '1 % outliers': Case(gusts(4.0), 1.0, outliers=0.01),
    'stamps with 5 ms of jitter': Case(gusts(4.0), 0.8, jitter=0.005),
}


def estimates(case: Case, motion: Motion, seconds: float, seed: int) -> Iterator[tuple]:
    """Yield stamps and estimates, None for one that does not come."""
    random = np.random.default_rng(seed)
    for k in range(int(seconds * case.rate)):
        stamp = k / case.rate + case.jitter * random.uniform(0.0, 1.0)
        noise = case.noise * DEVIATIONS * random.standard_normal(3)
        noise += 0.03 * (random.random(3) < case.outliers) * random.choice((-1.0, 1.0), 3)
        lost = case.dropouts and stamp > 1.0 and stamp % 5.0 < case.dropouts
        yield stamp, None if lost else np.add(motion(stamp), noise)


def soak(case: Case, seconds: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return errors by noise, errors by standard deviation, and the motion by noise."""
    motion, mean = case.motion(seed), EstimateMean()
    predictor = DisturbancePredictor(PredictionSettings())
    noise, found, aims = case.noise * DEVIATIONS, [], STARTS
    variances = Variances(*(noise ** 2).tolist())
    for stamp, values in estimates(case, motion, seconds, seed):
        estimate = None if values is None else mean.add(
            Estimate(stamp, Pose(*values.tolist()), variances))
        if estimate is not None:
            predictor.update(*estimate)
        if stamp > aims:
            aims += PERIOD
            aim = stamp + case.latency + 0.07
            there = np.array(motion(aim))
            error = predictor.predict(aim).position - there
            found.append((error / noise, error / predictor.deviations(aim), there / noise))
    return tuple(np.array(found).swapaxes(0, 1))


def judge(name: str, case: Case, seconds: float, seed: int) -> bool:
    """Soak one case, print what came of it and return whether it is as it should be."""
    errors, scores, truths = soak(case, seconds, seed)
    rms, without = (np.sqrt((part ** 2).mean(axis=0)) for part in (errors, truths))
    inside = (np.abs(scores) < 2.0).mean()
    good = bool((rms < case.bound).all() and (rms < np.hypot(without, FLOOR)).all()
                and INSIDE[0] < inside < INSIDE[1])
    figures = '  '.join(
        f'{axis} {error:5.2f} of {part:6.1f}'
        for axis, error, part in zip(Pose._fields, rms, without, strict=True))
    print(f'{name:28} {figures}  worst {np.abs(errors).max():5.1f}  '
          f'{100.0 * inside:.1f} % inside{"" if good else "  NOT GOOD"}', flush=True)
    return good


def main() -> int:
    """Soak all cases."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=3600.0, help='of each case [s]')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--case', action='append', choices=CASES, help='all without it')
    options = parser.parse_args()
    good = [judge(name, CASES[name], options.duration, options.seed)
            for name in options.case or CASES]
    print('good' if all(good) else 'NOT GOOD')
    return 0 if all(good) else 1


if __name__ == '__main__':
    sys.exit(main())
