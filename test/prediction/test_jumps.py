"""What a jump of the estimates is told from: pushes, noise, and its own end."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.prediction.jumps import DISBELIEF, JumpDetector

PERIOD = 0.02
DEVIATION = 1e-3
ACCELERATION = 0.5


class Evaluated:
    """A doubt about one axis, fed with errors after half a second of noise."""

    def __init__(self, seed=0):
        self.detector = JumpDetector(np.array([ACCELERATION]))
        self.random = np.random.default_rng(seed)
        self.stamp, self.lies, self.wrong, self.stepped = 0.0, [], [], []
        self.go(25 * [0.0])
        self.lies.clear()

    def go(self, errors, noise=0.5, is_led=True):
        for error in errors:
            self.stamp += PERIOD
            verdict = self.detector.evaluate(
                self.stamp, np.array([error + noise * DEVIATION * self.random.standard_normal()]),
                np.array([DEVIATION]), np.array([is_led]))
            self.lies.append(self.detector.lies.item())
            self.wrong.append(verdict.wrong.item())
            self.stepped.append(verdict.stepped.item())
        return self


def push(acceleration, count):
    return [0.5 * acceleration * (k * PERIOD) ** 2 for k in range(1, count + 1)]


seeds = st.integers(0, 10_000)


@given(seeds, st.floats(8.0, 1000.0), st.sampled_from((-1.0, 1.0)))
def test_a_jump_is_found_the_sooner_the_larger_it_is(seed, size, side):
    lies = Evaluated(seed).go(8 * [side * size * DEVIATION], is_led=False).lies
    assert all(lies[0 if size > 12.0 else 3:])


@given(seeds, st.floats(0.05, 3.0 * ACCELERATION))
def test_a_push_is_no_step_of_the_estimator_however_strong(seed, acceleration):
    found = Evaluated(seed).go(push(acceleration, 25), is_led=False)
    assert not any(found.stepped) and not found.lies[-1]


@given(seeds, st.floats(50.0, 100.0), st.sampled_from((-1.0, 1.0)))
def test_what_no_push_is_strong_enough_for_lies_whatever_its_shape(seed, size, side):
    for shape in (np.sin(np.pi * np.arange(1, 10) / 10.0), np.arange(1, 10) / 9.0):
        errors = side * size * DEVIATION * shape
        assert all(Evaluated(seed).go(errors, is_led=False).lies[4:])


@given(seeds, st.floats(0.4, 0.8))
def test_what_goes_on_for_long_is_a_motion(seed, speed):
    found = Evaluated(seed).go([speed * k * PERIOD for k in range(1, 40)], is_led=False)
    assert any(found.lies) and not any(found.lies[14:]) and not any(found.stepped)


def test_noise_alone_hardly_ever_lies():
    found = Evaluated().go(5000 * [0.0], noise=1.0)
    assert sum(found.lies) < 10 and not any(found.stepped)


@given(seeds, st.floats(8.0, 100.0), st.integers(4, 10))
def test_what_comes_back_was_wrong_all_the_time(seed, size, count):
    found = Evaluated(seed).go(count * [size * DEVIATION], is_led=False)
    assert not any(found.wrong)
    found.go([0.0], noise=0.0)
    assert found.wrong[-1] and not found.lies[-1] and not found.detector.is_open.any()


def test_who_was_followed_by_mistake_is_known_by_the_return():
    """Too small to be found, it ends where the filters that it led do not expect it."""
    errors = [2.4 * DEVIATION, 2.1 * DEVIATION, 2.2 * DEVIATION]
    for is_led in (True, False):
        found = Evaluated().go(errors, noise=0.0, is_led=False)
        assert not any(found.lies)
        assert found.go([0.0], noise=0.0, is_led=is_led).wrong[-1] is not is_led


@given(seeds, st.floats(8.0, 100.0))
def test_what_lasts_is_a_step(seed, size):
    count = math.ceil(DISBELIEF / PERIOD) + 1
    found = Evaluated(seed).go(count * [size * DEVIATION], is_led=False)
    assert found.stepped.count(True) == 1 and found.stepped[-1]


def test_the_end_of_a_lie_that_was_not_found_is_none():
    back = [-4.0 * DEVIATION] * 5
    believed = Evaluated()
    believed.go(6 * [1.9 * DEVIATION], noise=0.0)
    assert not any(believed.go(back, noise=0.0).lies)
    assert any(Evaluated().go(back, noise=0.0, is_led=False).lies)


@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_axes_are_judged_apart(side):
    detector = JumpDetector(np.full(2, ACCELERATION))
    for k in range(5):
        detector.evaluate(k * PERIOD, np.array((0.0, side * 0.03)), np.full(2, DEVIATION),
                    np.array((True, False)))
    assert detector.lies.tolist() == detector.is_open.tolist() == [False, True]
