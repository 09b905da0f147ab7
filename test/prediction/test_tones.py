"""Tones: found to the bound of Cramér and Rao, and not where there are none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from facade_manipulator.prediction.tones import _Window, BLOCKS, MOST, Tones

AHEAD = np.array((0.0, 0.1, 0.4))
NOISE = 1e-3


def fitted(motion, seconds, noise=NOISE, seed=0, stamps=None):
    """Return tones of one axis, fitted twice a second, and the last stamp."""
    random, tones = np.random.default_rng(seed), Tones(1)
    stamps = np.arange(0.0, seconds, 0.02) if stamps is None else stamps
    for k, stamp in enumerate(stamps):
        tones.add(stamp, motion(stamp) + noise * random.standard_normal(1))
        if k % 25 == 0:
            tones.fit(0, max(noise, 1e-4) ** 2)
    return tones, stamps[-1]


def sum_of(*parts):
    return lambda time: 0.3 + sum(
        amplitude * np.sin(math.tau * frequency * time) for amplitude, frequency in parts)


TWO = sum_of((0.1, 0.11), (0.02, 0.3))
CLOSE = sum_of((0.1, 0.1), (0.09, 0.118))
FOUR = sum_of((0.08, 0.1), (0.03, 0.23), (0.01, 0.41), (0.005, 0.77))


@pytest.mark.parametrize(('motion', 'count'), [(TWO, 2), (CLOSE, 2), (FOUR, 4)])
def test_tones_are_known_as_well_as_anybody_can_know_them(motion, count):
    errors = []
    for seed in range(5):
        tones, stamp = fitted(motion, 50.0, seed=seed)
        errors.append(tones.at(stamp, AHEAD)[0] - motion(stamp + AHEAD))
    bound = NOISE * math.sqrt(5.0 * count * 0.02 / 50.0)
    assert np.sqrt(np.square(errors).mean()) < 2.0 * bound


def test_the_longer_tones_have_been_averaged_the_less_often_they_are_fitted():
    tones, gains = Tones(1), {}
    for stamp in np.arange(0.0, 50.0, 0.02).tolist():
        tones.add(stamp, TWO(stamp) * np.ones(1))
        tones.fit(0, NOISE ** 2)
        gains.setdefault(int(stamp), set()).add(*tones.noise_gain)
    assert len(gains[9]) == pytest.approx(10, abs=1)  # as often as a mean of 0.1 s has come
    assert [len(gains[second]) for second in range(43, 48)] == pytest.approx([3] * 5, abs=1)


@pytest.mark.parametrize('rate', [20.0, 50.0, 200.0])
@pytest.mark.parametrize('frequency', [0.2, 0.5, 1.0])
def test_averaging_takes_nothing_of_an_amplitude(rate, frequency):
    """A mean of 0.1 s has 0.4 % less than a sine of 0.5 Hz."""
    motion = sum_of((0.1, frequency))
    tones, stamp = fitted(motion, 30.0, 1e-6, stamps=np.arange(0.0, 30.0, 1.0 / rate))
    assert tones.at(stamp, AHEAD)[0] == pytest.approx(motion(stamp + AHEAD), abs=2e-5)


def test_what_is_no_tone_is_taken_for_none():
    tones, stamp = fitted(lambda time: 0.3, 30.0)
    assert tones.at(stamp, AHEAD) == pytest.approx(np.full((1, 3), 0.3), abs=0.2 * NOISE)


@pytest.mark.parametrize('jump', [0.0, 0.5])
def test_stamps_may_jitter_and_gap(jump):
    stamps = np.cumsum(np.random.default_rng(1).uniform(0.01, 0.03, 2000))
    stamps[1500:] += jump
    tones, stamp = fitted(TWO, 0.0, stamps=stamps)
    assert tones.at(stamp, AHEAD)[0] == pytest.approx(TWO(stamp + AHEAD), abs=0.3 * NOISE)


def test_tones_that_ended_are_forgotten_after_the_window():
    def ended(time):
        return TWO(time) if time < 20.0 else 0.3

    tones, stamp = fitted(ended, 28.0 + 0.1 * BLOCKS)
    assert tones.at(stamp, AHEAD) == pytest.approx(np.full((1, 3), 0.3), abs=0.2 * NOISE)


def test_a_tone_too_close_to_a_stronger_one_or_within_the_noise_is_none():
    times = np.linspace(-60.0, 0.0, 600)
    window = _Window(times, np.zeros(600), noise=1e-6, block=0.1, size=5.0)
    frequencies, power = np.array((1.0, 1.01, 3.0, 5.0)), np.array((4.0, 1.0, 1.0, 1e-9))
    assert window._distinct(frequencies, power).tolist() == [True, False, True, False]


def test_whatever_comes_there_are_a_few_finite_tones():
    random = np.random.default_rng(0)
    tones, stamp = fitted(lambda time: random.uniform(-0.5, 0.5), 20.0)
    assert np.isfinite(tones.at(stamp, AHEAD)).all()
    assert np.count_nonzero(tones._amplitudes) <= MOST
