"""Tones, found close to the Cramér-Rao bound and only if they exist."""

import math

import numpy as np
import pytest

from facade_manipulator.prediction.tones import MOST_TONES, Tones

pytestmark = pytest.mark.long

AHEAD = np.array((0.0, 0.1, 0.4))
NOISE = 1e-3


def fitted(motion, seconds, noise=NOISE, seed=0, stamps=None):
    """Return tones of one axis, fitted twice a second, and the last stamp."""
    random = np.random.default_rng(seed)
    tones = Tones(1, AHEAD)
    stamps = np.arange(0.0, seconds, 0.02) if stamps is None else stamps
    for k, stamp in enumerate(stamps):
        tones.add(stamp, motion(stamp) + noise * random.standard_normal(1))
        if k % 25 == 0:
            tones.fit(0, max(noise, 1e-4) ** 2)
    return tones, stamps[-1]


def sum_of(*parts):
    """Return a motion of 0.3 with sines of these amplitudes and frequencies [Hz]."""

    def motion(time):
        value = 0.3
        for amplitude, frequency in parts:
            value = value + amplitude * np.sin(math.tau * frequency * time)
        return value

    return motion


TWO = sum_of((0.1, 0.11), (0.02, 0.3))
CLOSE = sum_of((0.1, 0.1), (0.09, 0.118))
FOUR = sum_of((0.08, 0.1), (0.03, 0.23), (0.01, 0.41), (0.005, 0.77))


@pytest.mark.parametrize(('motion', 'count'), [(TWO, 2), (CLOSE, 2), (FOUR, 4)])
def test_tones_are_found_within_twice_the_bound(motion, count):
    errors = []
    for seed in range(5):
        tones, stamp = fitted(motion, 50.0, seed=seed)
        errors.append(tones.at(stamp)[0] - motion(stamp + AHEAD))
    bound = NOISE * math.sqrt(5.0 * count * 0.02 / 50.0)
    assert np.sqrt(np.square(errors).mean()) < 2.0 * bound


def test_repeated_fit_without_new_estimates_changes_nothing():
    tones, stamp = fitted(TWO, 10.0)
    tones.fit(0, NOISE**2)
    before = tones.at(stamp)[0].tolist()
    tones.fit(0, NOISE**2)
    assert tones.at(stamp)[0].tolist() == before


@pytest.mark.parametrize('rate', [20.0, 200.0])
@pytest.mark.parametrize('frequency', [0.2, 1.0])
def test_mean_of_estimates_does_not_reduce_an_amplitude(rate, frequency):
    motion = sum_of((0.1, frequency))
    stamps = np.arange(0.0, 30.0, 1.0 / rate)
    tones, stamp = fitted(motion, 30.0, 1e-6, stamps=stamps)
    (found,) = tones.at(stamp)
    assert found == pytest.approx(motion(stamp + AHEAD), abs=2e-5)


@pytest.mark.parametrize('gap', [0.0, 0.5])
def test_tones_are_found_despite_jitter_and_gaps(gap):
    stamps = np.cumsum(np.random.default_rng(1).uniform(0.01, 0.03, 2000))
    stamps[1500:] += gap
    tones, stamp = fitted(TWO, 0.0, stamps=stamps)
    (found,) = tones.at(stamp)
    assert found == pytest.approx(TWO(stamp + AHEAD), abs=0.3 * NOISE)


@pytest.mark.parametrize(
    ('motion', 'seconds'),
    [
        (lambda time: 0.3, 30.0),
        (lambda time: TWO(time) if time < 20.0 else 0.3, 28.0 + 0.2 * Tones.BLOCKS),
    ],
    ids=['none', 'ended'],
)
def test_constant_window_has_no_tones(motion, seconds):
    tones, stamp = fitted(motion, seconds)
    constant = np.full((1, 3), 0.3)
    assert tones.at(stamp) == pytest.approx(constant, abs=0.2 * NOISE)


def test_random_motion_gives_few_finite_tones():
    random = np.random.default_rng(0)
    tones, stamp = fitted(lambda time: random.uniform(-0.5, 0.5), 20.0)
    assert np.isfinite(tones.at(stamp)).all()
    assert np.count_nonzero(tones._amplitudes) <= MOST_TONES
