"""Late measurements go where their stamps belong."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.estimation.history import History, Measurement
from facade_manipulator.estimation.settings import ImuSettings
from facade_manipulator.estimation.state import COASTING, InertialInput, Innovation, Process, VX, X

STEP = 0.005
STAMPS = [0.0123, 0.05, 0.0777, 0.1011, 0.1999]


def correct(stamp, state, inertial, measurement):
    """Correct x by a measurement, and count how often it was decided upon."""
    if measurement.level is None:
        measurement.level = 0.0
    direction = np.zeros(len(state.mean))
    direction[X], direction[VX] = 1.0, measurement.stamp - stamp
    gain = state.covariance @ direction
    variance = float(gain @ direction) + measurement.variance
    residual = measurement.value - state.mean[X] - state.mean[VX] * (measurement.stamp - stamp)
    return Innovation(gain, variance, residual).applied(state)


def history():
    process = Process(ImuSettings(), [])
    made = History(process, correct)
    made.begin(0.0, process.unknown(), process.unknown_offsets())
    return made


def inertial(k):
    return InertialInput((0.0, 0.0, 0.01 * k), (np.sin(0.3 * k), 0.1, 9.81))


def end(arrivals):
    """Return the last state where each measurement comes after so many steps."""
    made, waiting = history(), sorted(arrivals)
    for k in range(1, 61):
        made.add_input(k * STEP, inertial(k))
        while waiting and waiting[0][0] <= k:
            _, stamp = waiting.pop(0)
            made.add_measurement(Measurement(0, stamp, 0.1 * stamp, 1e-4))
        _ = made.newest
    return made.newest.state


@given(st.lists(st.integers(0, 15), min_size=5, max_size=5))
def test_late_measurements_give_the_state_of_prompt_ones(delays):
    arrivals = [(int(stamp / STEP) + 1 + delay, stamp)
                for stamp, delay in zip(STAMPS, delays, strict=True)]
    prompt, late = end([(int(stamp / STEP) + 1, stamp) for stamp in STAMPS]), end(arrivals)
    assert late.mean == pytest.approx(prompt.mean, abs=1e-12)
    assert late.covariance == pytest.approx(prompt.covariance, abs=1e-12)


def test_two_inputs_between_queries_are_one_step():
    one, other = history(), history()
    for k in range(1, 41):
        one.add_input(k * STEP, inertial(k))
        other.add_input(k * STEP, inertial(k))
        _ = other.newest
    assert len(one._steps) == 21 and len(other._steps) == 41
    assert one.newest.state.mean == pytest.approx(other.newest.state.mean, abs=1e-4)


def test_measurement_ahead_of_the_inputs_waits():
    made = history()
    made.add_measurement(Measurement(0, 0.012, 1.0, 1e-4))
    assert made.newest.state.mean[X] == 0.0
    for k in range(1, 4):
        made.add_input(k * STEP, inertial(k))
    assert made.newest.state.mean[X] == pytest.approx(1.0, abs=0.01)


def test_late_inertial_input_replaces_coasting():
    one, other = history(), history()
    for k in range(1, 41):
        one.add_input(k * STEP, inertial(k))
        other.add_input(k * STEP, inertial(k) if k < 30 else COASTING)
        _ = one.newest, other.newest  # each input a step of its own
    other.add_measurement(Measurement(0, 0.18, 0.1, 1e-4))
    one.add_measurement(Measurement(0, 0.18, 0.1, 1e-4))
    assert other.newest.state.mean[X] != pytest.approx(one.newest.state.mean[X], abs=1e-6)
    for k in range(30, 41):
        other.add_input(k * STEP, inertial(k))
        _ = other.newest
    # the first step back from coasting gives the offsets their own uncertainty again
    assert other.newest.state.mean[X] == pytest.approx(one.newest.state.mean[X], abs=1e-6)


def test_measurement_is_decided_once():
    made, measurement = history(), Measurement(0, 0.012, 0.0, 1e-4)
    for k in range(1, 20):
        made.add_input(k * STEP, inertial(k))
    made.add_measurement(measurement)
    _ = made.newest
    measurement.level = 7.0
    made.add_measurement(Measurement(0, 0.006, 0.0, 1e-4))
    _ = made.newest
    assert measurement.level == 7.0


def test_history_keeps_0_4_s():
    made = history()
    for k in range(1, 1001):
        made.add_input(k * STEP, inertial(k))
    assert made.oldest == pytest.approx(5.0 - 0.4)
    assert len(made._steps) < 200
