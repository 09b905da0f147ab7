"""The bank of filters beside the textbook's extended Kalman filter, one filter at a time."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.prediction import oscillators
from facade_manipulator.prediction.filter_bank import FilterBank
from facade_manipulator.prediction.oscillators import ProcessNoise
from facade_manipulator.prediction.spectrum import Oscillations

FREQUENCIES = np.array([0.8, 2.2])
NOISE = ProcessNoise(np.array([1e-7, 1e-4, 0.02]), 2.5e-7, 1e-4)
values = st.tuples(*[st.floats(-0.1, 0.1)] * 3).map(np.array)
variances = st.tuples(*[st.floats(1e-8, 1e-4)] * 3).map(np.array)
steps = st.lists(st.tuples(st.floats(1e-3, 0.1), values, variances), min_size=1, max_size=5)


def textbook(state, covariance, acceleration, interval, value, variance):
    """Propagate one filter and correct it, in Joseph's form."""
    row = oscillators.MEASURED
    noise = ProcessNoise(np.array(acceleration), NOISE.offset, NOISE.frequency)
    transition = oscillators.Transition(state.shape)
    moved = transition.move(state, interval)
    by_power = oscillators.process_covariance_by_power(noise)
    covariance = transition.matrix @ covariance @ transition.matrix.T + sum(
        interval ** (k + 1) * part for k, part in enumerate(by_power))
    oscillators.add_frequency_noise(covariance, state, interval, noise)
    gain = covariance @ row / (row @ covariance @ row + variance)
    kept = np.eye(len(row)) - np.outer(gain, row)
    state = moved + gain * (value - moved @ row)
    state[oscillators.FREQUENCIES] = state[oscillators.FREQUENCIES].clip(
        oscillators.LOWEST_FREQUENCY, oscillators.HIGHEST_FREQUENCY)
    return state, kept @ covariance @ kept.T + variance * np.outer(gain, gain)


@given(values, steps)
def test_every_filter_of_the_bank_is_the_textbooks(first, sequence):
    bank = FilterBank(first, FREQUENCIES, NOISE)
    alone = {
        (axis, opinion): (bank.states[axis, opinion], bank.covariances[axis, opinion])
        for axis in range(3) for opinion in range(3)}
    for interval, measured, noise in sequence:
        bank.update(interval, measured, noise)
        for axis, opinion in alone:
            alone[axis, opinion] = textbook(
                *alone[axis, opinion], NOISE.acceleration[opinion], interval, measured[axis],
                noise[axis])
    for (axis, opinion), (state, covariance) in alone.items():
        assert bank.states[axis, opinion] == pytest.approx(state, rel=1e-9, abs=1e-12)
        assert bank.covariances[axis, opinion] == pytest.approx(
            covariance, rel=1e-6, abs=1e-12)


@given(values, steps)
def test_covariances_stay_symmetric_and_positive(first, sequence):
    bank = FilterBank(first, FREQUENCIES, NOISE)
    for step in sequence:
        bank.update(*step)
    assert np.array_equal(bank.covariances, bank.covariances.swapaxes(-1, -2))
    assert np.linalg.eigvalsh(bank.covariances).min() > -1e-12


def test_earlier_states_stay_as_they_were():
    bank = FilterBank(np.zeros(3), FREQUENCIES, NOISE)
    before, copy = bank.states, bank.states.copy()
    bank.update(0.02, np.full(3, 0.05), np.full(3, 1e-6))
    assert np.array_equal(before, copy)
    assert not np.array_equal(bank.states, copy)


def test_a_seed_changes_one_filter_alone():
    bank = FilterBank(np.zeros(3), FREQUENCIES, NOISE)
    before = bank.states.copy()
    bank.seed(1, 2, Oscillations(0.01, (3.0,), (0.02,), (0.03,), 1e-6, 0.99), 1e-6)
    changed = (bank.states != before).any(axis=-1)
    assert np.argwhere(changed).tolist() == [[1, 2]]
    seeded = bank.states[1, 2]
    assert seeded[oscillators.PLACES].tolist() == [0.02, 0.0]
    assert seeded[oscillators.VELOCITIES].tolist() == [0.03, 0.0]
    assert seeded[oscillators.FREQUENCIES].tolist() == [3.0, 2.2]
    assert seeded[oscillators.OFFSET] == 0.01


def test_a_restart_is_a_start_of_one_filter():
    bank = FilterBank(np.zeros(3), FREQUENCIES, NOISE)
    fresh = FilterBank(np.array([0.0, 0.03, 0.0]), FREQUENCIES, NOISE)
    bank.update(0.02, np.full(3, 0.05), np.full(3, 1e-6))
    before = bank.states.copy()
    bank.restart(1, 2, 0.03)
    assert np.array_equal(bank.states[1, 2], fresh.states[1, 2])
    assert np.array_equal(bank.covariances[1, 2], fresh.covariances[1, 2])
    assert np.argwhere((bank.states != before).any(axis=-1)).tolist() == [[1, 2]]
