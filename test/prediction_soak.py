"""
Predict an hour of every motion that nobody tuned for: ``make soak-prediction``.

Ends with exit status 1 if in any of them the prediction is worse than what is allowed, if it is
worse than no compensation, or if the standard deviation that it gives itself is wrong. With
``--beside`` plainer and ideal predictions run beside it, as in ``make bench-compensation``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
import json
import math
from pathlib import Path
import sys
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from facade_manipulator.kinematics import Pose  # noqa: E402
from facade_manipulator.lab.gondola import load_scenario, Scenario  # noqa: E402
from facade_manipulator.lab.gondola.bench.__main__ import PLAIN  # noqa: E402
from facade_manipulator.lab.gondola.bench.comparison import (  # noqa: E402
    comparison,
    draw_comparison,
    figures,
    LEARNT,
    put_beside,
    WITHOUT_ANY,
)
from facade_manipulator.lab.gondola.gondola import GondolaSettings  # noqa: E402
from facade_manipulator.lab.gondola.motion import Motion, SwaySettings  # noqa: E402
from facade_manipulator.lab.gondola.oracle import limits  # noqa: E402
from facade_manipulator.lab.gondola.scenario import MissionSettings  # noqa: E402
from facade_manipulator.lab.gondola.sensors import EstimatorSettings  # noqa: E402
from facade_manipulator.lab.gondola.wind import Wind, WindSettings  # noqa: E402
from facade_manipulator.prediction import (  # noqa: E402
    DisturbancePredictor,
    Estimate,
    EstimateMean,
    PredictionSettings,
    Variances,
)

DEVIATIONS = np.array((1e-3, 1e-3, 1.75e-3))  # m, m, rad: of the estimates' noise
STARTS = 20.0  # s
FLOOR = 0.5  # of the noise, that may be passed on whatever comes
MOST_INSIDE = 0.995  # share of errors within two standard deviations
HIDDEN = 0.2  # of the noise, below which it hides for long how small the errors are
STEP = 0.01  # s
PERIOD = 0.09  # s, in which errors change little
UNBOUNDED = PredictionSettings(  # of motions over metres, most of which is drawn towards the mean
    acceleration=(100.0, 100.0, 100.0), speed=(100.0, 100.0, 100.0))
ONES = (1.0, 1.0, 1.0)
TITLES = tuple(f'{axis} [σ of the estimates]' for axis in ('x', 'y', 'θ'))


class Case(NamedTuple):
    """A motion by seed, an estimator, and the RMS error that is allowed, by its noise."""

    made: Callable[[int], Motion | Scenario]
    allowed: float
    rate: float = 50.0  # Hz
    latency: float = 0.05  # s
    noise: float = 1.0  # by the usual one
    jitter: float = 0.0  # s
    dropouts: float = 0.0  # s, every 5 s
    outliers: float = 0.0  # share, of 30 mm
    inside: float = 0.9  # share of errors within two standard deviations, at least
    settings: PredictionSettings = PredictionSettings()


def gusts(speed: float, cable: float = 30.0, spectrum: str = 'kaimal') -> Callable:
    """Return a double pendulum in gusts, by seed."""
    return lambda seed: Scenario(
        MissionSettings(motion='wind'), gondola=GondolaSettings(cable_length=cable),
        wind=WindSettings(mean_speed=speed, spectrum=spectrum, seed=seed))


def tones(frequencies: tuple[float, ...]) -> Callable:
    """Return sines that get weaker with their frequency, by seed."""
    def made(seed: int) -> Scenario:
        random = np.random.default_rng(seed)
        settings = {}
        for axis, amplitude in (('x', 0.08), ('y', 0.012), ('yaw', 0.03)):
            settings[f'{axis}_frequency'] = tuple(random.uniform(0.9, 1.1, len(frequencies))
                                                  * frequencies)
            settings[f'{axis}_amplitude'] = tuple(
                amplitude * (frequencies[0] / f) ** 1.5 for f in frequencies)
            settings[f'{axis}_phase'] = tuple(random.uniform(0.0, math.tau, len(frequencies)))
        return Scenario(sway=SwaySettings(**settings))

    return made


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
    gondola = gusts(4.0)(seed).motion()
    return lambda time: Pose(*np.add(gondola(time), 0.1 * math.sin(time / 100.0)).tolist())


def scenario(name: str) -> Callable[[int], Scenario]:
    """Return a scenario, by seed."""
    return load_scenario(name).with_seed


CASES = {
    **{name: Case(scenario(name), 0.8) for name in (
        'breeze', 'resonance', 'three_tones', 'gusty', 'high_cable', 'calm')},
    'rest': Case(lambda seed: lambda time: Pose(0.0, 0.0, 0.0), 0.25),
    'two tones': Case(tones((0.11, 0.3)), 0.6),
    'three tones': Case(tones((0.12, 0.31, 0.83)), 0.8),
    'five tones': Case(tones((0.1, 0.23, 0.41, 0.77, 1.3)), 2.0),
    'seven tones': Case(tones((0.1, 0.17, 0.29, 0.41, 0.6, 0.83, 1.2)), 2.0),
    'gusts': Case(gusts(4.0), 0.8),
    'a light wind': Case(gusts(1.5), 0.5),
    'a long cable': Case(gusts(4.0, 100.0), 0.8),
    **{f'von Kármán {speed:g} m/s, {cable:g} m': Case(
        gusts(speed, cable, 'von_karman'), allowed, settings=settings)
       for speed, allowed, settings in (
           (5.0, 1.2, PredictionSettings()), (10.0, 2.2, UNBOUNDED), (15.0, 3.0, UNBOUNDED))
       for cable in (10.0, 30.0, 100.0)},
    'cable of 10 to 70 m': Case(winch, 1.0),
    'bumps': Case(blows, 3.0),
    'steps': Case(steps, 8.0, inside=0.85),  # for a quarter of a second nobody believes them
    'a bias that creeps': Case(creep, 0.8),
    'estimator of 20 Hz': Case(gusts(4.0), 1.0, rate=20.0, latency=0.1, noise=3.0),
    'estimator of 200 Hz': Case(gusts(4.0), 0.8, rate=200.0, latency=0.03),
    'dropouts of 0.3 s': Case(gusts(4.0), 1.1, dropouts=0.3),
    '1 % outliers': Case(gusts(4.0), 1.0, outliers=0.01),
    'stamps with 5 ms of jitter': Case(gusts(4.0), 0.8, jitter=0.005),
}


def estimates(
    case: Case, motion: Motion, seconds: float, seed: int
) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """Yield stamps, estimates and which of their axes are outliers; some estimates are lost."""
    random = np.random.default_rng(seed)
    for k in range(int(seconds * case.rate)):
        stamp = k / case.rate + case.jitter * random.uniform(0.0, 1.0)
        noise = case.noise * DEVIATIONS * random.standard_normal(3)
        outliers = random.random(3) < case.outliers
        noise += 0.03 * outliers * random.choice((-1.0, 1.0), 3)
        if not (case.dropouts and stamp > 1.0 and stamp % 5.0 < case.dropouts):
            yield stamp, np.add(motion(stamp), noise), outliers


class Others:
    """Predictions beside the learnt one: plainer ones, and the best if the motion has a law."""

    def __init__(self, case: Case, made: Motion | Scenario, motion: Motion) -> None:
        self._predictors = {name: plain() for name, plain in PLAIN.items()}
        self._best = {}
        if isinstance(made, Scenario):
            x, _, yaw = case.noise * DEVIATIONS
            estimator = EstimatorSettings(rate=case.rate, position_noise=x, yaw_noise=yaw)
            self._best = limits(made._replace(estimator=estimator), motion, 0.0)
            del self._best['known']

    def update(self, estimate: Estimate, outliers: np.ndarray) -> None:
        """Give all of them an estimate; the best know an outlier when they see it."""
        for predictor in self._predictors.values():
            predictor.update(*estimate[:3])
        if not outliers.any():
            for predictor in self._best.values():
                predictor.update(*estimate[:3])

    def predict(self, time: float) -> dict[str, Pose]:
        """Return what each predicts for a time [s]."""
        return {name: predictor.predict(time).position
                for name, predictor in (self._predictors | self._best).items()}


class Found(NamedTuple):
    """What came of a case: mean squares by prediction and noise, share inside, largest error."""

    squares: dict[str, np.ndarray]
    inside: np.ndarray
    worst: float


def soak(case: Case, seconds: float, seed: int, beside: bool) -> Found:
    """Predict a case."""
    made, mean = case.made(seed), EstimateMean()
    motion = made.motion() if isinstance(made, Scenario) else made
    predictor = DisturbancePredictor(case.settings)
    others = Others(case, made, motion) if beside else None
    noise, aims, scores = case.noise * DEVIATIONS, STARTS, []
    errors: dict[str, list[np.ndarray]] = {WITHOUT_ANY: [], LEARNT: []}
    variances = Variances(*(noise ** 2).tolist())
    for stamp, values, outliers in estimates(case, motion, seconds, seed):
        estimate = Estimate(stamp, Pose(*values.tolist()), variances)
        if others:
            others.update(estimate, outliers)
        averaged = mean.add(estimate)
        if averaged is not None:
            predictor.update(*averaged[:3])
        if stamp > aims:
            aims += PERIOD
            aim = stamp + case.latency + 0.07
            there = np.array(motion(aim))
            predicted = {WITHOUT_ANY: np.zeros(3), LEARNT: predictor.predict(aim).position}
            for name, position in (predicted | (others.predict(aim) if others else {})).items():
                errors.setdefault(name, []).append((position - there) / noise)
            scores.append(errors[LEARNT][-1] * noise / predictor.deviations(aim))
    return Found(
        {name: np.square(found).mean(axis=0) for name, found in errors.items()},
        (np.abs(scores) < 2.0).mean(axis=0), float(np.abs(errors[LEARNT]).max()))


def is_good(case: Case, found: Found) -> bool:
    """Return whether it is as it should be."""
    learnt, without = found.squares[LEARNT], found.squares[WITHOUT_ANY]
    most = MOST_INSIDE if (learnt > HIDDEN ** 2).any() else 1.0
    return bool((learnt < case.allowed ** 2).all() and (learnt < without + FLOOR ** 2).all()
                and case.inside < found.inside.mean() <= most)


def judge(name: str, options: argparse.Namespace) -> dict:
    """Soak one case by all seeds; return what the report says of it."""
    case, seeds = CASES[name], range(options.seed, options.seed + options.seeds)
    trials = [soak(case, options.duration, seed, options.beside) for seed in seeds]
    found = {
        'good': all(is_good(case, found) for found in trials),
        'worst': max(found.worst for found in trials),
        'rms': {key: np.sqrt(np.mean([found.squares[key] for found in trials], axis=0)).tolist()
                for key in trials[0].squares},
        'within_two_deviations': np.mean([found.inside for found in trials], axis=0).tolist()}
    print(f'{name:28} {figures(found["rms"][LEARNT], ONES):22} worst {found["worst"]:.1f}'
          f'{"" if found["good"] else "  NOT GOOD"}', flush=True)
    return found


def write(folder: Path, cases: dict[str, dict], before: Path | None) -> None:
    """Write the report, and print it as a table."""
    if before:
        put_beside(cases, json.loads(before.read_text()))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / 'prediction.json').write_text(json.dumps(cases, indent=2) + '\n')
    draw_comparison(folder / 'prediction.png', cases, ONES, TITLES,
                    'Error of the prediction, one horizon ahead (RMS)')
    print('\nRMS by standard deviation of the estimates, x / y / theta',
          *comparison(cases, ONES, in_percent=False), sep='\n')


def main() -> int:
    """Soak all cases."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--duration', type=float, default=3600.0, help='of each case [s]')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--seeds', type=int, default=1, help='how many, from that one on')
    parser.add_argument('--case', action='append', choices=CASES, help='all without it')
    parser.add_argument('--beside', action='store_true', help='other predictions run, too')
    parser.add_argument('--before', type=Path, help='a prediction.json to be put beside')
    parser.add_argument('--output', type=Path, default=Path('soak_report'))
    options = parser.parse_args()
    found = {name: judge(name, options) for name in options.case or CASES}
    write(options.output, found, options.before)
    good = all(case['good'] for case in found.values())
    print('good' if good else 'NOT GOOD')
    return 0 if good else 1


if __name__ == '__main__':
    sys.exit(main())
