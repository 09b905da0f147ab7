"""The model of one axis: its motion in time, its derivative, its noise."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.prediction import oscillators
from facade_manipulator.prediction.oscillators import ProcessNoise

# below that, products with a frequency have not all the digits of a double
displacements = st.floats(-0.2, 0.2).map(lambda value: value if abs(value) > 1e-290 else 0.0)
rates = st.floats(0.3, 30.0)
states = st.tuples(
    displacements, displacements, displacements, rates, displacements, displacements, rates,
).map(np.array)
intervals = st.floats(-0.5, 1.0)


@given(states, intervals, intervals)
def test_two_short_ways_are_one_long_way(state, first, second):
    once = oscillators.propagate(state, first + second)
    twice = oscillators.propagate(oscillators.propagate(state, first), second)
    assert twice == pytest.approx(once, abs=1e-12)


def transition(state, interval):
    bank = oscillators.Transition(state.shape)
    moved = bank.move(state, interval)
    assert np.array_equal(moved, oscillators.propagate(state, interval))
    return bank.matrix


@given(states, intervals)
def test_the_transition_is_the_derivative_of_the_motion(state, interval):
    matrix = transition(state, interval)
    step = 1e-6
    for k in range(oscillators.STATE_SIZE):
        change = np.zeros(oscillators.STATE_SIZE)
        change[k] = step
        difference = (
            oscillators.propagate(state + change, interval)
            - oscillators.propagate(state - change, interval)) / (2.0 * step)
        assert matrix[:, k] == pytest.approx(difference, abs=1e-5)


@given(states, states, intervals)
def test_a_transition_is_written_whole_over_an_earlier_one(earlier, state, interval):
    bank = oscillators.Transition(state.shape)
    bank.move(earlier, 0.3)
    bank.move(state, interval)
    assert np.array_equal(bank.matrix, transition(state, interval))


@given(states)
def test_no_time_changes_nothing(state):
    assert oscillators.propagate(state, 0.0) == pytest.approx(state, rel=1e-15, abs=0.0)
    assert np.allclose(transition(state, 0.0), np.eye(oscillators.STATE_SIZE))


def process_covariance(state, interval, noise):
    powers = np.array((interval, interval ** 2, interval ** 3))
    matrix = np.tensordot(powers, oscillators.process_covariance_by_power(noise), 1)
    matrix = np.broadcast_to(matrix, (*state.shape, oscillators.STATE_SIZE)).copy()
    oscillators.add_frequency_noise(matrix, state, interval, noise)
    return matrix


@given(states, st.floats(1e-3, 1.0))
def test_process_noise_is_a_covariance(state, interval):
    noise = ProcessNoise(np.array(0.01), 1e-6, 1e-4)
    matrix = process_covariance(state, interval, noise)
    assert np.array_equal(matrix, matrix.T)
    assert np.linalg.eigvalsh(matrix).min() >= -1e-15


@given(states, st.floats(1e-3, 1.0))
def test_process_noise_is_that_of_pushes_and_random_walks(state, interval):
    variance = process_covariance(
        state, interval, ProcessNoise(np.array(0.01), 1e-6, 1e-4)).diagonal()
    assert variance[oscillators.OFFSET] == pytest.approx(1e-6 * interval)
    assert variance[oscillators.PLACES] == pytest.approx(0.01 * interval ** 3 / 3.0)
    assert variance[oscillators.VELOCITIES] == pytest.approx(0.01 * interval)
    assert variance[oscillators.FREQUENCIES] == pytest.approx(
        1e-4 * interval * state[oscillators.FREQUENCIES] ** 2)


def test_each_opinion_has_its_own_noise_on_every_axis():
    noise = ProcessNoise(np.array([1.0, 2.0, 3.0]), 0.0, 0.0)
    batch = np.tile(oscillators.initial_state(0.0, (1.0, 2.0)), (3, 3, 1))
    velocities = process_covariance(batch, 0.1, noise)[..., 2, 2]
    assert velocities == pytest.approx(np.tile([0.1, 0.2, 0.3], (3, 1)))


@given(states, intervals)
def test_the_place_after_a_time_is_that_of_the_propagated_state(state, interval):
    expected = oscillators.propagate(state, interval) @ oscillators.MEASURED
    assert oscillators.place_after(state, interval) == pytest.approx(expected, abs=1e-12)


def test_a_batch_is_propagated_as_its_members_are():
    batch = np.random.default_rng(0).uniform(0.5, 1.0, (3, 2, oscillators.STATE_SIZE))
    moved = oscillators.propagate(batch, 0.3)
    steps = transition(batch, 0.3)
    for index in np.ndindex(3, 2):
        assert moved[index] == pytest.approx(oscillators.propagate(batch[index], 0.3))
        assert steps[index] == pytest.approx(transition(batch[index], 0.3))


@given(
    st.lists(states, min_size=3, max_size=3).map(np.array), st.floats(-0.2, 1.0),
    st.floats(-0.02, 0.02), st.floats(0.0, 1.0))
def test_the_series_of_an_oscillation_is_its_motion(batch, interval, elapsed, weight):
    coefficients = oscillators.taylor_coefficients(
        weight * oscillators.phasors(batch), batch[:, oscillators.FREQUENCIES], interval, 6)
    moved = oscillators.propagate(batch, interval + elapsed)
    expected = weight * moved[:, oscillators.PLACES].sum(axis=-1)
    fastest = np.abs(oscillators.phasors(batch)).sum(axis=-1) * 0.6 ** 7 / 5040.0
    assert np.polyval(coefficients[::-1], elapsed) == pytest.approx(
        expected, abs=2.0 * fastest.max() + 1e-15)
