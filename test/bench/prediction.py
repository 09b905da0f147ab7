"""P1 and P2: the prediction, compared with tuned Kalman filters and the information bound."""

from functools import partial
import math
import time

from filterpy.common import kinematic_kf, Q_continuous_white_noise
from gusts import bound, gusts
import numpy as np
from rows import in_turns, row

from facade_manipulator.compensation.correction import Correction, CorrectionSettings
from facade_manipulator.kinematics import MotionState, Pose, ZERO_TWIST
from facade_manipulator.prediction.estimate import Estimate
from facade_manipulator.prediction.predictor import DisturbancePredictor

INTERVAL = 0.02  # s
NOISE = 1e-3  # m, m and rad
AHEAD = 0.12  # s
LEAD = 0.06  # s, of a corrected pose over its publication
JERK_DENSITIES = 10.0 ** np.arange(-6.0, 2.0, 0.5)  # m²/s⁵ or rad²/s⁵
TUNING_SEED = 1000
TONES = (  # of x, y and yaw: amplitude [m, m, rad] and frequency [Hz]
    ((0.085, 0.127), (0.018, 0.311), (0.003, 0.83)),
    ((0.012, 0.173), (0.005, 0.412), (0.001, 0.91)),
    ((0.03, 0.15), (0.008, 0.37), (0.0015, 0.7)),
)


class KalmanFilters:
    """Filterpy's filter of position, velocity and acceleration for each axis, by white jerk."""

    def __init__(self, densities):
        self._filters = [kinematic_kf(1, 2, INTERVAL) for _ in densities]
        for one, density in zip(self._filters, densities, strict=True):
            one.R *= NOISE**2
            one.Q = Q_continuous_white_noise(3, INTERVAL, density)

    def update(self, stamp, pose, _):
        self._stamp = stamp
        for one, value in zip(self._filters, pose, strict=True):
            one.predict()
            one.update(value)

    def predict(self, at):
        ahead = at - self._stamp
        powers = np.array([1.0, ahead, 0.5 * ahead**2])
        position = [(powers @ one.x).item() for one in self._filters]
        return MotionState(Pose(*position), ZERO_TWIST)


class Corrected:
    """The correction of the compensator, which smooths the prediction for the head."""

    def __init__(self):
        self._correction = Correction(CorrectionSettings())

    def update(self, stamp, pose, variances):
        self._correction.add_estimate(Estimate(stamp, pose, tuple(variances)))

    def predict(self, at):
        return self._correction.at(at - LEAD, at)


def tones(seed, interval):
    """Return three tones along each axis for two minutes, phases by the seed, shape (n, 3)."""
    phase = np.random.default_rng(seed).random
    times = interval * np.arange(round(120.0 / interval))
    signals = []
    for axis in TONES:
        signal = np.zeros(len(times))
        for amplitude, frequency in axis:
            signal += amplitude * np.sin(math.tau * (frequency * times + phase()))
        signals.append(signal)
    return np.transpose(signals)


def errors(make, source, quick, seed, noise=NOISE):
    """Return RMS errors of x, y and yaw by the noise, and the time [s] for an estimate."""
    settled, end = (500, 750) if quick else (1000, 3500)
    predictor = make()
    signal = source(seed, INTERVAL)
    random = np.random.default_rng(seed)
    measured = signal[:end] + noise * random.standard_normal((end, 3))
    squares = []
    cost = 0.0
    for number, values in enumerate(measured.tolist()):
        stamp = number * INTERVAL
        pose = Pose(*values)
        begin = time.process_time()
        predictor.update(stamp, pose, 3 * [noise**2])
        expected = predictor.predict(stamp + AHEAD).position
        predictor.predict(stamp + AHEAD + 0.01)  # as the compensator does at 100 Hz
        if number >= settled:
            cost += time.process_time() - begin
            error = np.subtract(expected, signal[number + round(AHEAD / INTERVAL)])
            squares.append(error**2)
    rms = np.sqrt(np.mean(squares, axis=0))
    return *rms / noise, cost / len(squares)


def rows(quick):
    """Compare cost and errors on the same samples of both signals."""
    ours = DisturbancePredictor
    for source, goal in ((gusts, '<= 0.85'), (tones, '<= 0.3')):
        found = []
        for density in JERK_DENSITIES:
            filters = partial(KalmanFilters, 3 * [density])
            *of_axes, _ = errors(filters, source, quick, TUNING_SEED)
            found.append(of_axes)
        tuned = partial(KalmanFilters, JERK_DENSITIES[np.argmin(found, axis=0)])
        sides = [partial(errors, make, source, quick) for make in (ours, tuned)]
        (*our_errors, our_cost), (*their_errors, their_cost) = in_turns(
            sides, 1 if quick else 7
        )
        error = np.linalg.norm(our_errors)
        name = f'error 0.12 s ahead in {source.__name__}'
        yield row(
            f'P1 {name} / tuned filters of filterpy',
            'sigma',
            goal,
            error,
            np.linalg.norm(their_errors),
        )
        if source is gusts:
            least = np.linalg.norm(bound(INTERVAL, NOISE, AHEAD)) / NOISE
            yield row(
                f'P2 {name} / information bound', 'sigma', '<= 1.15', error, least
            )
    for noise, goal in ((0.4 * NOISE, '<= 1.1'), (NOISE, '<= 1.3')):
        found = []
        for seed in range(1 if quick else 7):
            *of_axes, _ = errors(Corrected, gusts, quick, seed, noise)
            found.append(np.linalg.norm(of_axes))
        name = f'P2 error of the correction, noise {1e3 * noise:g} mm'
        least = np.linalg.norm(bound(INTERVAL, noise, AHEAD)) / noise
        yield row(f'{name} / information bound', 'sigma', goal, np.median(found), least)
    yield row(
        'P1 estimate learnt and two predictions / three filters of filterpy',
        'us',
        '<= 2.2',
        our_cost,
        their_cost,
    )
