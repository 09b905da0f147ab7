"""What can be predicted at best: the laws, the bound, and that nothing errs less."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import least_squares

from facade_manipulator.kinematics import Pose, ZERO_POSE
from facade_manipulator.lab.gondola import oracle
from facade_manipulator.lab.gondola.gondola import Gondola, GondolaSettings
from facade_manipulator.lab.gondola.motion import Sway, SwaySettings
from facade_manipulator.lab.gondola.scenario import load_scenario, MissionSettings, Scenario
from facade_manipulator.lab.gondola.wind import WindSettings
from facade_manipulator.prediction import DisturbancePredictor, PredictionSettings

INTERVAL, HORIZON, NOISE = 0.02, 0.12, 1e-3
VARIANCES = Pose(NOISE ** 2, NOISE ** 2, NOISE ** 2)


def errors(predictor, motion, duration=40.0, lost=0.0):
    random, found = np.random.default_rng(0), []
    for stamp in np.arange(0.0, duration, INTERVAL):
        values = np.array(motion(stamp)) + NOISE * random.standard_normal(3)
        if not found or random.random() >= lost:
            predictor.update(stamp, Pose(*values.tolist()), VARIANCES)
        found.append(np.subtract(predictor.predict(stamp + HORIZON).position,
                                 motion(stamp + HORIZON)))
    return np.sqrt((np.array(found)[len(found) // 2:] ** 2).mean(axis=0))


def limits_of(scenario):
    return oracle.limits(scenario, scenario.motion(), 0.0)


@pytest.mark.long
@pytest.mark.parametrize('name', ['breeze', 'three_tones', 'gusty'])
def test_no_other_prediction_errs_less(name):
    scenario = load_scenario(name)
    found = [errors(predictor, scenario.motion()) for predictor in (
        *limits_of(scenario).values(), DisturbancePredictor(PredictionSettings()))]
    assert (np.diff(found, axis=0) > 0.0).all()


def test_two_sines_are_known_to_a_tenth_of_the_noise():
    settings = SwaySettings()
    predictor = oracle.SinesPrediction(settings, 0.0, 0.0)
    assert (errors(predictor, Sway(settings).at, 60.0, lost=0.2) < 0.12 * NOISE).all()


def test_an_oracle_that_lost_estimates_predicts_the_mean_of_what_the_others_allow():
    law = np.array((0.1, 0.7)), np.array(((1e-2, 1e-4), (1e-4, 0.0), (1e-3, 1e-5)))
    predictor, random = oracle.GustsPrediction(*law, INTERVAL, VARIANCES), np.random.default_rng(0)
    places = np.delete(np.arange(61), (3, 17, 18, 19, 52))
    values = 0.1 * random.standard_normal((len(places), 3))
    for place, pose in zip(places, values, strict=True):
        predictor.update(100.0 + place * INTERVAL, Pose(*pose.tolist()), VARIANCES)
    used = places > 60 - max(size for size in predictor._solved if size <= 61)
    lags = INTERVAL * np.subtract.outer(places[used], places[used])
    known = oracle.covariance(*law, lags.ravel()).reshape(3, *lags.shape)
    known += VARIANCES.x * np.eye(len(lags))
    ahead = oracle.covariance(*law, INTERVAL * (66 - places[used]))
    weighed = np.linalg.solve(known, values[used].T[..., None])[..., 0]
    expected = (ahead * weighed).sum(axis=1)
    assert predictor.predict(100.0 + 66 * INTERVAL).position == pytest.approx(expected, rel=1e-6)


def test_before_an_estimate_a_sine_is_as_uncertain_as_it_is_strong():
    predictor = oracle.SinesPrediction(SwaySettings(), 0.0, oracle.FREQUENCY_DEVIATION)
    power = [np.square(SwaySettings().sines(axis)[0]).sum() / 2.0 for axis in ('x', 'y', 'yaw')]
    assert predictor.deviations(0.0) == pytest.approx(np.sqrt(power))


@pytest.mark.long
def test_least_squares_for_amplitude_phase_and_frequency_reach_the_bound():
    settings = SwaySettings(x_amplitude=(0.1,), x_frequency=(0.2,), x_phase=(0.3,))
    bound = oracle.SinesPrediction(settings, 0.0, oracle.FREQUENCY_DEVIATION)
    times, random = np.arange(0.0, 15.0, INTERVAL), np.random.default_rng(0)
    for time in times:
        bound.update(time, ZERO_POSE, VARIANCES)
    aim = times[-1] + HORIZON
    for axis, deviation in zip(('x', 'y', 'yaw'), bound.deviations(aim), strict=True):
        truth = np.array([part[0] for part in settings.sines(axis)])
        off = []
        for _ in range(200):
            seen = _sine(truth, times) + NOISE * random.standard_normal(len(times))
            found = least_squares(lambda sine, seen=seen: _sine(sine, times) - seen, truth)
            off.append(_sine(found.x, aim) - _sine(truth, aim))
        assert np.std(off) == pytest.approx(deviation, rel=0.12)


def _sine(sine, times):
    amplitude, frequency, phase = sine
    return amplitude * np.sin(math.tau * frequency * times + phase)


@pytest.mark.long
def test_the_law_of_gusts_has_the_variance_of_the_gondola():
    gondola, wind = GondolaSettings(damping_ratio=0.1), WindSettings(mean_speed=2.0)
    found = []
    for seed in range(1, 6):
        swaying = Gondola(gondola, WindSettings(mean_speed=2.0, seed=seed))
        found.append([swaying.at(time) for time in np.arange(0.0, 160.0, 0.5)])
    expected = np.sqrt(oracle.wind_law(gondola, wind)[1].sum(axis=1))
    assert np.std(found, axis=(0, 1)) == pytest.approx(expected, rel=0.3)


def test_a_recording_has_no_law():
    scenario = Scenario(mission=MissionSettings(motion='recording'))
    assert list(oracle.limits(scenario, Sway(SwaySettings()).at)) == ['known']


def test_where_the_head_pushes_the_gondola_there_is_no_law():
    assert limits_of(load_scenario('pressing')) == {}
