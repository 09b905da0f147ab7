"""The parts of the prediction beside the textbook: filters, prior, regression."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are, solve_discrete_are

from facade_manipulator.prediction.continuation import Continuation, Sample
from facade_manipulator.prediction.filters import (
    BANDWIDTHS,
    FEATURES,
    features,
    FilterBank,
    mode_states,
    response,
)
from facade_manipulator.prediction.prior import HORIZONS, noise_moments, sway_moments

MOTION = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
SEEN = np.array([[1.0, 0.0, 0.0]])


def textbook_response(bandwidth, frequency):
    """Return p, v/ω, a/ω² of the steady Kalman-Bucy filter for white jerk."""
    density = np.diag([0.0, 0.0, bandwidth ** 6])
    covariance = solve_continuous_are(MOTION.T, SEEN.T, density, np.eye(1))
    gain = covariance @ SEEN.T
    tone = 2j * np.pi * frequency * np.eye(3)
    state = np.linalg.solve(tone - MOTION + gain @ SEEN, gain)[:, 0]
    return state / bandwidth ** np.arange(3.0)


@pytest.mark.parametrize('frequency', [0.03, 0.3, 1.0, 4.0])
def test_the_filters_are_the_textbook_s_in_steady_state(frequency):
    expected = [textbook_response(bandwidth, frequency) for bandwidth in BANDWIDTHS]
    assert response(np.array([frequency]))[0] == pytest.approx(np.array(expected), abs=1e-9)


def textbook_states(bandwidth, interval, values):
    """Return what the steady discrete Kalman filter makes of estimates."""
    t = interval
    step = np.array([[1.0, t, t * t / 2.0], [0.0, 1.0, t], [0.0, 0.0, 1.0]])
    noise = bandwidth ** 6 * np.array([
        [t ** 5 / 20.0, t ** 4 / 8.0, t ** 3 / 6.0], [t ** 4 / 8.0, t ** 3 / 3.0, t * t / 2.0],
        [t ** 3 / 6.0, t * t / 2.0, t]])
    covariance = solve_discrete_are(step.T, SEEN.T, noise, np.eye(1) / t)
    gain = covariance[:, 0] / (covariance[0, 0] + 1.0 / t)
    state = np.array([values[0], 0.0, 0.0])
    for value in values[1:]:
        state = step @ state
        state = state + gain * (value - state[0])
    return state / bandwidth ** np.arange(3.0)


def test_step_by_step_they_are_the_discrete_filter_of_fast_estimates():
    times = np.arange(0.0, 6.0, 0.002)
    values = 0.1 * np.sin(0.9 * times) + 0.02 * np.sin(3.1 * times + 1.0)
    bank = FilterBank(1)
    for value in values[1:] - values[0]:
        bank.update(0.002, np.array([value]))
    expected = [textbook_states(bandwidth, 0.002, values - values[0]) for bandwidth in BANDWIDTHS]
    assert mode_states(bank.modes)[0] == pytest.approx(np.array(expected), abs=5e-4)


def test_an_interval_may_be_of_any_length():
    """Many short steps towards one value are one long step."""
    once, often = FilterBank(1), FilterBank(1)
    once.update(0.5, np.ones(1))
    for _ in range(50):
        often.update(0.01, np.ones(1))
    assert once.modes == pytest.approx(often.modes, abs=1e-12)


def test_a_constant_added_to_the_motion_is_in_the_level_alone():
    random = np.random.default_rng(0)
    states = random.standard_normal((5, len(BANDWIDTHS), 3))
    moved = states + np.array((0.7, 0.0, 0.0))
    (first, level), (second, moved_level) = features(states), features(moved)
    assert second == pytest.approx(first, abs=1e-12)
    assert moved_level == pytest.approx(level + 0.7)


def test_the_moments_of_noise_are_those_of_noise():
    interval, random = 0.02, np.random.default_rng(1)
    bank, seen = FilterBank(400), []
    for k in range(1500):
        bank.update(interval, random.standard_normal(400))
        if k > 900 and k % 20 == 0:
            seen.append(bank.features()[0])
    seen = np.concatenate(seen)
    found = np.diag(seen.T @ seen / len(seen))
    assert found == pytest.approx(interval * np.diag(noise_moments().features), rel=0.15)


@pytest.mark.parametrize('moments', [sway_moments, noise_moments])
def test_moments_are_covariances(moments):
    matrix = moments().features
    assert matrix == pytest.approx(matrix.T)
    assert np.linalg.eigvalsh(matrix).min() > 0.0


def learnt(seconds, weights, random, gap=None, noise=0.0):
    """Let moves that follow from the features be learnt; return what is found."""
    near = slice(0, 4)
    continuation = Continuation(1, near, 1e3)
    continuation.solve(np.full(1, 1e-9), np.full(1, 1e-9), np.zeros(1))
    level, stamp, past = np.zeros(1), 0.0, []
    while stamp < seconds:
        stamp += 0.05
        state = random.standard_normal((1, FEATURES))
        past.append(state)
        came = np.zeros(1)
        if len(past) > 4:
            came = past[-5][0] @ weights + noise * random.standard_normal(1)
        continued, still = np.zeros((2, 1, len(HORIZONS)))
        continued[:, near] = (state[:, None] @ continuation.weights)[:, 0]
        continuation.add(Sample(
            stamp, 0.05, came, level, state, (continued, still, still, continued, still)))
        continuation.learn(np.full(1, noise ** 2))
    continuation.solve(np.full(1, 1e-9), np.full(1, 1e-9), np.zeros(1))
    return continuation


def test_moves_that_follow_from_the_features_are_learnt():
    random = np.random.default_rng(0)
    weights = random.standard_normal((FEATURES, 1))
    found = learnt(60.0, weights, random)
    assert found.weights[0, :, 3] == pytest.approx(weights[:, 0], abs=1e-3)
    assert np.abs(found.weights[0, :, 0]).max() < 0.5
    assert found.variances[0, 3] == pytest.approx((weights ** 2).sum(), rel=0.5)


def test_noise_in_what_came_is_no_error_of_the_forecasts():
    found = learnt(200.0, np.zeros((FEATURES, 1)), np.random.default_rng(0), noise=0.1)
    assert found.variances.max() < 0.4 * 0.1 ** 2


def test_what_nothing_was_learnt_of_is_as_the_prior_says():
    continuation = Continuation(1, slice(0, 4), 20.0)
    continuation.solve(np.ones(1), np.full(1, 1e-12), np.zeros(1))
    sway = sway_moments()
    expected = np.linalg.lstsq(sway.features, sway.moves[:, :4], rcond=None)[0]
    assert sway.features @ continuation.weights[0] == pytest.approx(
        sway.features @ expected, rel=1e-2, abs=1e-4)


def test_the_gain_of_noise_is_that_of_the_weights():
    continuation = Continuation(1, slice(0, 4), 20.0)
    continuation.solve(np.ones(1), np.full(1, 1e-3), np.zeros(1))
    random, bank, errors = np.random.default_rng(2), FilterBank(500), []
    for k in range(800):
        bank.update(0.02, random.standard_normal(500))
        if k > 500 and k % 20 == 0:
            seen, level = bank.features()
            errors.append(level[:, None] + seen @ continuation.weights[0])
    found = np.square(errors).mean(axis=(0, 1))
    assert found == pytest.approx(0.02 * continuation.noise_gain()[0], rel=0.15)


NOISE, TONES = np.full(1, 1e-3), np.full(1, 5.0)


def stepped(share):
    """Return what has learnt how much of the steps towards tones is right."""
    random, near = np.random.default_rng(3), slice(0, 4)
    wave, continuation = random.standard_normal(520), Continuation(1, near, 1e3)
    for k in range(500):
        steps, still = np.zeros((2, 1, len(HORIZONS)))
        steps[:, near] = wave[k + 1:k + 5]  # what comes, at horizons 0.05 s apart
        continuation.add(Sample(0.05 * k, 0.05, share * wave[k:k + 1], np.zeros(1),
                                np.zeros((1, FEATURES)), (still, still, still, still, steps)))
        continuation.learn(NOISE)
    return continuation


@pytest.mark.parametrize('share', [0.0, 0.4, 1.0])
def test_right_part_of_the_steps_is_trusted(share):
    continuation = stepped(share)
    continuation.solve(np.ones(1), NOISE, TONES)
    assert continuation.trust == pytest.approx(np.full((1, 4), share), abs=1e-3)
    of_both = (1.0 - share) ** 2 * continuation.noise_gain() + share ** 2 * TONES
    assert (continuation.variances >= 0.99e-3 * of_both).all()
