"""Jumps of the estimator, distinguished from pushes and from noise."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.prediction.jumps import (
    DECISION_TIME,
    JumpDecision,
    JumpDetector,
)

PERIOD = 0.02
DEVIATION = 1e-3
ACCELERATION = 0.5


class Detected:
    """Decisions about the errors of one axis, after half a second of noise."""

    def __init__(self, seed=0):
        self.detector = JumpDetector(ACCELERATION)
        self.random = np.random.default_rng(seed)
        self.stamp = 0.0
        self.is_wrong = []
        self.decisions = []
        self.add(25 * [0.0])
        self.is_wrong.clear()

    def add(self, errors, noise=0.5, is_followed=True):
        for error in errors:
            self.stamp += PERIOD
            value = error + noise * DEVIATION * self.random.standard_normal()
            decision = self.detector.evaluate(self.stamp, value, DEVIATION, is_followed)
            self.decisions.append(decision)
            self.is_wrong.append(self.detector.is_wrong)
        return self


seeds = st.integers(0, 10_000)
signs = st.sampled_from((-1.0, 1.0))


@given(seeds, st.floats(8.0, 1000.0), signs)
def test_large_jump_is_found_at_once(seed, size, sign):
    found = Detected(seed).add(8 * [sign * size * DEVIATION], is_followed=False)
    assert all(found.is_wrong[0 if size > 12.0 else 3 :])


@given(seeds, st.floats(0.1, 3.0 * ACCELERATION))
def test_push_of_any_strength_is_not_a_step(seed, acceleration):
    push = 0.5 * acceleration * (PERIOD * np.arange(1, 26)) ** 2
    found = Detected(seed).add(push, is_followed=False)
    assert JumpDecision.STEP not in found.decisions
    assert not found.is_wrong[-1]


@given(seeds, st.floats(50.0, 100.0), signs)
@pytest.mark.parametrize(
    'shape',
    [np.sin(np.pi * np.arange(1, 10) / 10.0), np.arange(1, 10) / 9.0],
    ids=['sine', 'ramp'],
)
def test_error_larger_than_any_push_is_detected(shape, seed, size, sign):
    found = Detected(seed).add(sign * size * DEVIATION * shape, is_followed=False)
    assert all(found.is_wrong[4:])


@given(seeds, st.floats(0.4, 0.8))
def test_lasting_motion_is_accepted(seed, speed):
    errors = speed * PERIOD * np.arange(1, 40)
    found = Detected(seed).add(errors, is_followed=False)
    assert any(found.is_wrong)
    assert not any(found.is_wrong[14:])
    assert JumpDecision.STEP not in found.decisions


def test_noise_rarely_counts_as_wrong():
    found = Detected().add(5000 * [0.0], noise=1.0)
    assert sum(found.is_wrong) < 10
    assert JumpDecision.STEP not in found.decisions


@given(seeds, st.floats(8.0, 100.0), st.integers(4, 10))
def test_jump_that_returns_is_marked_wrong(seed, size, count):
    found = Detected(seed).add(count * [size * DEVIATION], is_followed=False)
    assert JumpDecision.WRONG not in found.decisions
    found.add([0.0], noise=0.0)
    assert found.decisions[-1] is JumpDecision.WRONG
    assert not found.is_wrong[-1]
    assert not found.detector.is_doubted


@pytest.mark.parametrize('is_followed', [True, False])
def test_return_of_an_undetected_jump_is_noise_if_followed(is_followed):
    errors = [2.4 * DEVIATION, 2.1 * DEVIATION, 2.2 * DEVIATION]
    found = Detected().add(errors, noise=0.0, is_followed=False)
    assert {*found.decisions[-3:]} == {JumpDecision.UNDECIDED}
    assert not any(found.is_wrong)
    decision = found.add([0.0], 0.0, is_followed).decisions[-1]
    assert decision is (JumpDecision.NOISE if is_followed else JumpDecision.WRONG)


@given(seeds, st.floats(8.0, 100.0))
def test_lasting_jump_is_a_step(seed, size):
    count = math.ceil(DECISION_TIME / PERIOD) + 1
    found = Detected(seed).add(count * [size * DEVIATION], is_followed=False)
    assert found.decisions.count(JumpDecision.STEP) == 1
    assert found.decisions[-1] is JumpDecision.STEP


def test_end_of_an_undetected_jump_is_not_wrong():
    back = [-4.0 * DEVIATION] * 5
    believed = Detected().add(6 * [1.9 * DEVIATION], noise=0.0)
    assert not any(believed.add(back, noise=0.0).is_wrong)
    assert any(Detected().add(back, noise=0.0, is_followed=False).is_wrong)
