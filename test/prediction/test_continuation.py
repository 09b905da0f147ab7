"""Filters, prior and regression, compared with textbook formulas."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from facade_manipulator.prediction.continuation import Continuation, Sample
from facade_manipulator.prediction.filters import (
    BANDWIDTHS,
    FEATURES,
    features,
    FilterBank,
    response,
)
from facade_manipulator.prediction.positions import Positions
from facade_manipulator.prediction.prior import HORIZONS, noise_moments, sway_moments

NEAR = slice(0, 4)
NO_NOISE = np.full(1, 1e-9)
NO_TONES = np.zeros(1)


def textbook_response(bandwidth, frequency):
    """Return p, v/ω, a/ω² of the steady Kalman-Bucy filter for white jerk."""
    motion = np.diag([1.0, 1.0], 1)
    seen = np.array([[1.0, 0.0, 0.0]])
    jerk = np.diag([0.0, 0.0, bandwidth**6])
    covariance = solve_continuous_are(motion.T, seen.T, jerk, np.eye(1))
    gain = covariance @ seen.T
    derivative = 2j * np.pi * frequency * np.eye(3)
    state = np.linalg.solve(derivative - motion + gain @ seen, gain)
    return state[:, 0] / bandwidth ** np.arange(3.0)


@pytest.mark.parametrize('frequency', [0.03, 0.3, 1.0, 4.0])
def test_response_matches_the_kalman_bucy_filter(frequency):
    expected = [textbook_response(bandwidth, frequency) for bandwidth in BANDWIDTHS]
    (found,) = response(np.array([frequency]))
    assert found == pytest.approx(np.array(expected), abs=1e-9)


def test_filter_bank_passes_a_sine_with_its_response():
    bank = FilterBank(1)
    interval = 0.002
    frequency = 0.3
    for time in interval * np.arange(1, 8001):
        bank.update(interval, np.array([np.cos(2.0 * np.pi * frequency * time)]))
    between = time + 0.5 * interval  # each estimate holds before its time
    wave = np.exp(2j * np.pi * frequency * between)
    sine = response(np.array([frequency])) * wave
    expected = features(sine.real)
    for found, wanted in zip(bank.features(), expected, strict=True):
        assert found == pytest.approx(wanted, abs=5e-3)


def test_many_short_intervals_equal_one_long_interval():
    once = FilterBank(1)
    often = FilterBank(1)
    once.update(0.5, np.ones(1))
    for _ in range(50):
        often.update(0.01, np.ones(1))
    assert once.modes == pytest.approx(often.modes, abs=1e-12)


@pytest.mark.parametrize('moments', [sway_moments, noise_moments])
def test_prior_moments_are_covariances(moments):
    matrix = moments().features
    assert matrix == pytest.approx(matrix.T)
    assert np.linalg.eigvalsh(matrix).min() > 0.0


def test_weights_before_learning_follow_the_prior():
    continuation = Continuation(1, NEAR)
    sway = sway_moments()
    continuation.solve(np.ones(1), NO_NOISE, NO_TONES)
    moves = sway.moves[:, NEAR]
    expected, *_ = np.linalg.lstsq(sway.features, moves, rcond=None)
    products = sway.features @ continuation.weights[0]
    same = pytest.approx(sway.features @ expected, rel=1e-2, abs=1e-4)
    assert products == same


def only_noise():
    """Return a continuation whose variances of 1000 times the noise gain exceed UNKNOWN."""
    continuation = Continuation(1, NEAR)
    continuation.solve(np.full(1, 1e6), np.full(1, 1e3), NO_TONES)
    return continuation


def test_noise_gains_match_white_noise():
    continuation = only_noise()
    bank = FilterBank(500)
    random = np.random.default_rng(2)
    seen = []
    errors = []
    for k in range(1000):
        bank.update(0.02, random.standard_normal(500))
        if k > 500 and k % 20 == 0:
            newest, error = bank.features()
            seen.append(newest)
            errors.append(error[:, None] + newest @ continuation.weights[0])
    moments = np.square(seen).mean(axis=(0, 1))
    assert moments == pytest.approx(0.02 * np.diag(noise_moments().features), rel=0.15)
    found = np.square(errors).mean(axis=(0, 1))
    assert found == pytest.approx(0.02e-3 * continuation.variances[0], rel=0.15)


def learnt(seconds, weights, noise=0.0):
    """Return a continuation that has learnt moves of 0.2 s given by weights of the features."""
    random = np.random.default_rng(0)
    continuation = Continuation(1, NEAR)
    past = []
    positions = Positions()
    continuation.solve(NO_NOISE, NO_NOISE, NO_TONES)
    for stamp in 0.05 * np.arange(1, 20 * seconds):
        past.append(random.standard_normal((1, FEATURES)))
        value = noise * random.standard_normal(1)
        if len(past) > 4:
            value += past[-5][0] @ weights
        forecast, zero = np.zeros((2, 1, len(HORIZONS)))
        moves = past[-1][:, None] @ continuation.weights
        forecast[:, NEAR] = moves[:, 0]
        positions.add(stamp, value, np.zeros(1), False)
        forecasts = np.stack((zero, forecast, zero))
        sample = Sample(stamp, 0.05, np.zeros(1), past[-1], forecasts)
        continuation.add(sample)
        continuation.learn(np.full(1, noise**2), positions)
    continuation.solve(NO_NOISE, NO_NOISE, NO_TONES)
    return continuation


@pytest.mark.long
def test_moves_that_follow_from_the_features_are_learnt():
    weights = np.random.default_rng(1).standard_normal((FEATURES, 1))
    found = learnt(60, weights)
    assert found.weights[0, :, 3] == pytest.approx(weights[:, 0], abs=1e-3)
    assert np.abs(found.weights[0, :, 0]).max() < 0.5
    variance = (weights**2).sum()
    assert found.variances[0, 3] == pytest.approx(variance, rel=0.5)


@pytest.mark.long
def test_estimate_noise_does_not_count_as_forecast_error():
    found = learnt(200, np.zeros((FEATURES, 1)), 0.1)
    assert found.variances.max() < 0.4 * 0.1**2


@pytest.mark.long
@pytest.mark.parametrize('share', [0.0, 0.4, 1.0])
def test_trust_is_the_correct_share_of_the_step(share):
    wave = np.random.default_rng(3).standard_normal(520)
    continuation = Continuation(1, NEAR)
    noise = np.full(1, 1e-3)
    tones = np.full(1, 5.0)
    positions = Positions()
    for k in range(500):
        steps, zero = np.zeros((2, 1, len(HORIZONS)))
        steps[:, NEAR] = wave[k + 1 : k + 5]  # the next values, 0.05 s apart
        value = share * wave[k : k + 1]
        positions.add(0.05 * k, value, np.zeros(1), False)
        forecasts = np.stack((zero, zero, steps))
        seen = np.zeros((1, FEATURES))
        continuation.add(Sample(0.05 * k, 0.05, np.zeros(1), seen, forecasts))
        continuation.learn(noise, positions)
    continuation.solve(np.ones(1), noise, tones)
    expected = np.full((1, 4), share)
    assert continuation.trust == pytest.approx(expected, abs=1e-3)
    gain_of_noise = 1e-3 * only_noise().variances
    gain = (1.0 - share) ** 2 * gain_of_noise + share**2 * tones
    assert (continuation.variances >= 0.99e-3 * gain).all()
