"""How well the disturbance is foretold, and what happens where it cannot be."""

import copy
from dataclasses import replace
import math

import numpy as np
import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction import oscillators
from facade_manipulator.prediction.estimate import Estimate, EstimateMean
from facade_manipulator.prediction.predictor import DisturbancePredictor, PredictionSettings
from facade_manipulator.simulation.gondola import Gondola, GondolaSettings
from facade_manipulator.simulation.wind import WindSettings

HORIZON = 0.13
NOISE = 1e-3
VARIANCES = Pose(NOISE ** 2, NOISE ** 2, NOISE ** 2)
SETTINGS = PredictionSettings()


def sines(*parts):
    return lambda time: sum(
        amplitude * math.sin(math.tau * frequency * time + phase)
        for amplitude, frequency, phase in parts)


def still(_):
    return 0.0


BREEZE = (
    sines((0.1, 0.11, 0.3), (0.02, 0.3, 1.0)), sines((0.015, 0.2, 0.5)),
    sines((math.radians(2.0), 0.15, 0.0)))


def learn(motions, duration, settings=SETTINGS, noise=NOISE, variances=VARIANCES, seed=0):
    """Return the predictor and, for each estimate, how far it errs one horizon ahead."""
    random = np.random.default_rng(seed)
    predictor, errors = DisturbancePredictor(settings), []
    for stamp in np.arange(1000.0, 1000.0 + duration, 0.02):
        measured = [motion(stamp) + noise * random.standard_normal() for motion in motions]
        predictor.update(stamp, Pose(*measured), variances)
        place = predictor.predict(stamp + HORIZON).position
        errors.append([p - motion(stamp + HORIZON)
                       for p, motion in zip(place, motions, strict=True)])
    return predictor, np.array(errors)


def rms(errors, begin, end):
    return np.sqrt((errors[int(begin * 50):int(end * 50)] ** 2).mean(axis=0))


def test_a_breeze_is_foretold_to_a_few_percent():
    _, errors = learn(BREEZE, 30.0)
    disturbance = np.array([0.072, 0.0106, 0.0247])
    assert (rms(errors, 2.0, 10.0) < [0.02, 0.12, 0.08] * disturbance).all()
    assert (rms(errors, 10.0, 30.0) < [0.01, 0.06, 0.04] * disturbance).all()


def test_prediction_beats_the_estimate_as_it_comes():
    _, errors = learn(BREEZE, 20.0)
    late = np.array([[m(t + HORIZON) - m(t) for m in BREEZE] for t in np.arange(0, 20, 0.02)])
    assert (rms(errors, 5.0, 20.0) < 0.4 * rms(late, 5.0, 20.0)).all()


def test_the_frequencies_follow_the_data():
    predictor, _ = learn(BREEZE, 25.0)
    x, y, theta = predictor.frequencies
    assert sorted(x) == pytest.approx([0.11, 0.3], abs=0.01)
    assert min(abs(y - 0.2)) < 0.01
    assert min(abs(theta - 0.15)) < 0.01


@pytest.mark.parametrize('frequency', [0.05, 0.1, 0.5, 1.0, 2.0, 3.0, 5.0])
def test_no_frequency_is_amplified(frequency):
    motion = sines((0.01, frequency, 0.0))
    _, errors = learn((motion, still, still), 15.0)
    assert rms(errors, 7.0, 15.0)[0] < 0.01 / math.sqrt(2.0)


def test_fast_oscillations_are_compensated_in_part_and_in_phase():
    motion = sines((0.02, 2.0, 0.0))
    predictor, errors = learn((motion, still, still), 15.0)
    share = 1.0 / (0.02 * (math.tau * 2.0) ** 2)
    assert rms(errors, 8.0, 15.0)[0] == pytest.approx(
        (1.0 - share) * 0.02 / math.sqrt(2.0), rel=0.15)


def test_an_acceleration_beyond_the_limit_is_never_foretold():
    motion = sines((0.1, 2.5, 0.0))
    predictor, room = DisturbancePredictor(SETTINGS), SETTINGS.acceleration[0]
    for stamp in np.arange(1000.0, 1002.0, 0.02):
        predictor.update(stamp, Pose(motion(stamp), 0.0, 0.0), VARIANCES)
        places = [predictor.predict(stamp + HORIZON + k * 1e-3).position.x for k in (-1, 0, 1)]
        assert abs(places[0] - 2.0 * places[1] + places[2]) * 1e6 < 1.01 * room


@pytest.mark.parametrize(('noise', 'share'), [(0.0, 0.005), (5e-4, 0.01), (3e-3, 0.06)])
def test_a_wrong_variance_does_no_great_harm(noise, share):
    _, errors = learn(BREEZE, 20.0, noise=noise)
    assert rms(errors, 10.0, 20.0)[0] < share * 0.072


def rms_of_means(rate):
    """Return the errors of learning each estimate, and of learning means."""
    random, mean = np.random.default_rng(0), EstimateMean()
    single, averaged = DisturbancePredictor(SETTINGS), DisturbancePredictor(SETTINGS)
    errors = []
    for stamp in np.arange(1000.0, 1012.0, 1.0 / rate):
        noise = NOISE * random.standard_normal(3)
        measured = Pose(*(m(stamp) + n for m, n in zip(BREEZE, noise, strict=True)))
        single.update(stamp, measured, VARIANCES)
        estimate = mean.add(Estimate(stamp, measured, VARIANCES))
        if estimate is not None:
            averaged.update(*estimate)
        truth = [motion(stamp + HORIZON) for motion in BREEZE]
        errors.append([np.subtract(predictor.predict(stamp + HORIZON).position, truth)
                       for predictor in (single, averaged)])
    return np.sqrt((np.array(errors[len(errors) // 2:]) ** 2).mean(axis=0))


@pytest.mark.parametrize('rate', [100.0, 200.0])
def test_means_of_fast_estimates_teach_what_each_of_them_would(rate):
    single, averaged = rms_of_means(rate)
    assert (averaged < 1.15 * single).all()


def test_at_50_hz_every_estimate_is_learnt_as_it_is():
    single, averaged = rms_of_means(50.0)
    assert (averaged == single).all()


def test_a_standing_gondola_gives_its_place_and_little_noise():
    motions = (lambda _: 0.05, still, still)
    predictor, errors = learn(motions, 10.0)
    assert rms(errors, 5.0, 10.0) == pytest.approx(0.0, abs=0.6 * NOISE)


def gusts(seed):
    gondola = Gondola(GondolaSettings(), WindSettings(mean_speed=4.0, seed=seed))
    return [lambda time, axis=axis: getattr(gondola.at(time - 1000.0), axis)
            for axis in Pose._fields]


@pytest.mark.parametrize('motions', [(still,) * 3, gusts(1), gusts(2)])
def test_nothing_grows_in_minutes(motions):
    predictor, errors = learn(motions, 200.0)
    assert np.abs(errors[500:]).max() < 5e-3
    assert np.abs(oscillators.phasors(predictor._bank.states)).max() < 1.0


def test_an_opinion_whose_oscillations_grow_in_opposition_is_started_anew():
    """Two oscillations that meet at one frequency are seen as their sum alone."""
    predictor, _ = learn(BREEZE, 30.0)
    stamp, random, errors = 1030.0, np.random.default_rng(1), []
    states = predictor._bank.states[0, 0]
    states[oscillators.FREQUENCIES] = 0.69
    states[oscillators.PLACES] += 10.0, -10.0
    before = predictor._bank.states.copy()
    for k in range(150):
        now = stamp + 0.02 * k
        measured = [motion(now) + NOISE * random.standard_normal() for motion in BREEZE]
        predictor.update(now, Pose(*measured), VARIANCES)
        amplitudes = np.abs(oscillators.phasors(predictor._bank.states)).max(axis=-1)
        errors.append(predictor.predict(now + HORIZON).position.x - BREEZE[0](now + HORIZON))
    assert np.abs(oscillators.phasors(before)).max() > 5.0
    assert amplitudes.max() < 1.0
    assert np.abs(errors[25:]).max() < 5e-3


def test_the_velocity_is_the_derivative_of_the_place():
    predictor, _ = learn(BREEZE, 10.0)
    time = predictor.stamp + HORIZON
    before, after = (predictor.predict(time + step).position for step in (-1e-4, 1e-4))
    expected = [(b - a) / 2e-4 for a, b in zip(before, after, strict=True)]
    assert predictor.predict(time).velocity == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize('frequency', [0.3, 2.0, 5.5])
def test_a_prediction_does_not_depend_on_what_was_asked_before(frequency):
    asked, _ = learn((sines((0.02, frequency, 0.0)), *BREEZE[1:]), 5.0)
    for time in asked.stamp + np.arange(0.0, 0.3, 0.0013):
        course, afresh = asked.predict(time), copy.deepcopy(asked)
        afresh.predict(time + 1.0)
        expected = afresh.predict(time)
        assert course.position == pytest.approx(tuple(expected.position), abs=1e-7)
        assert course.velocity == pytest.approx(tuple(expected.velocity), abs=2e-5)


def test_the_first_estimate_is_believed_as_it_is():
    predictor = DisturbancePredictor(SETTINGS)
    predictor.update(1000.0, Pose(0.1, -0.05, 0.02), VARIANCES)
    course = predictor.predict(1000.1)
    assert course.position == pytest.approx((0.1, -0.05, 0.02), abs=1e-3)


def test_a_prediction_without_estimates_stays_bounded():
    predictor, _ = learn(BREEZE, 10.0)
    places = [predictor.predict(predictor.stamp + ahead).position.x
              for ahead in np.arange(0, 30, 1)]
    assert max(map(abs, places)) < 0.3


def test_after_a_long_gap_it_learns_anew():
    predictor, _ = learn(BREEZE, 10.0)
    later = predictor.stamp + SETTINGS.longest_gap + 0.1
    predictor.update(later, Pose(0.3, 0.0, 0.0), VARIANCES)
    assert predictor.since == later
    assert predictor.predict(later).position.x == pytest.approx(0.3, abs=1e-6)


def test_a_short_gap_is_bridged():
    predictor, _ = learn(BREEZE, 10.0)
    later = predictor.stamp + 1.0
    predictor.update(later, Pose(*(motion(later) for motion in BREEZE)), VARIANCES)
    ahead = predictor.predict(later + HORIZON).position
    assert ahead.x == pytest.approx(BREEZE[0](later + HORIZON), abs=0.008)


def test_the_cable_length_sets_the_first_frequency():
    start = PredictionSettings(cable_length=30.0).initial_frequencies()
    assert start[0] == pytest.approx(math.sqrt(9.81 / 30.0))


@pytest.mark.parametrize('change', [
    {'frequencies': (0.1,)}, {'acceleration': (1.0, 1.0)}, {'gusts': ()}, {'gusts': (math.nan,)},
    {'bandwidth': 0.0}, {'cable_length': -1.0}])
def test_settings_that_make_no_sense_are_rejected(change):
    with pytest.raises(ParameterError, match=next(iter(change))):
        replace(SETTINGS, **change)
