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
    measurement.innovation = Innovation(direction, gain, variance, residual)
    return measurement.innovation.applied(state)


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
def test_it_does_not_matter_how_late_measurements_come(delays):
    arrivals = [(int(stamp / STEP) + 1 + delay, stamp)
                for stamp, delay in zip(STAMPS, delays, strict=True)]
    prompt, late = end([(int(stamp / STEP) + 1, stamp) for stamp in STAMPS]), end(arrivals)
    assert late.mean == pytest.approx(prompt.mean, abs=2e-6)  # by the turning, to first order
    assert late.covariance == pytest.approx(prompt.covariance, abs=2e-5)  # of 1 m and 0.3 rad


def test_inputs_that_nobody_asks_between_are_one_step_to_the_same_state():
    one, other = history(), history()
    for k in range(1, 41):
        one.add_input(k * STEP, inertial(k))
        other.add_input(k * STEP, inertial(k))
        _ = other.newest
    assert len(one._steps) == 21 and len(other._steps) == 41
    assert one.newest.state.mean == pytest.approx(other.newest.state.mean, abs=1e-4)


def test_what_comes_before_its_time_waits():
    made = history()
    made.add_measurement(Measurement(0, 0.012, 1.0, 1e-4))
    assert made.newest.state.mean[X] == 0.0
    for k in range(1, 4):
        made.add_input(k * STEP, inertial(k))
    assert made.newest.state.mean[X] == pytest.approx(1.0, abs=0.01)


def test_an_imu_that_is_late_takes_the_place_of_coasting():
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


def test_a_measurement_is_decided_upon_once_however_often_it_is_used_again():
    made, measurement = history(), Measurement(0, 0.012, 0.0, 1e-4)
    for k in range(1, 20):
        made.add_input(k * STEP, inertial(k))
    made.add_measurement(measurement)
    _ = made.newest
    measurement.level = 7.0
    made.add_measurement(Measurement(0, 0.006, 0.0, 1e-4))
    _ = made.newest
    assert measurement.level == 7.0


def test_the_past_is_forgotten_but_not_what_may_still_come():
    made = history()
    for k in range(1, 1001):
        made.add_input(k * STEP, inertial(k))
    assert made.oldest == pytest.approx(5.0 - 0.4)
    assert len(made._steps) < 200
