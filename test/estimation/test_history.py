"""Late measurements apply at their stamps."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.estimation.history import History, Measurement, SPAN
from facade_manipulator.estimation.model import AX, Process, update, VX, X
from facade_manipulator.estimation.settings import ImuSettings

STEP = 0.005
STAMPS = [0.0123, 0.05, 0.0777, 0.1011, 0.1999]


def correct(step, measurement):
    """Correct x by a measurement of a little later, and decide on its level once."""
    if measurement.level is None:
        measurement.level = 0.0
    later = measurement.stamp - step.stamp
    mean, covariance = step.state
    jacobian = np.zeros(len(mean))
    jacobian[X], jacobian[VX] = 1.0, later
    cross = covariance @ jacobian
    return update(step.state, cross, float(cross @ jacobian) + measurement.variance,
                  measurement.value - mean[X] - mean[VX] * later)


def history():
    return History(Process(ImuSettings(), []), correct, 0.0)


def imu(k):
    return 0.0, 0.0, 0.01 * k, np.sin(0.3 * k), 0.1, 9.81


def measurement(stamp, value=0.1):
    return Measurement('', stamp, value, 1e-4)


def end(arrivals):
    """Return the last state if each measurement arrives after a number of steps."""
    made, waiting = history(), sorted(arrivals)
    for k in range(1, 61):
        made.add_input(k * STEP, imu(k))
        while waiting and waiting[0][0] <= k:
            _, stamp = waiting.pop(0)
            made.add_measurement(measurement(stamp, 0.1 * stamp))
        _ = made.newest
    return made.newest.state


@given(st.lists(st.integers(0, 15), min_size=5, max_size=5))
def test_late_measurements_give_the_state_of_prompt_ones(delays):
    arrivals = [(int(stamp / STEP) + 1 + delay, stamp)
                for stamp, delay in zip(STAMPS, delays, strict=True)]
    prompt, late = end([(int(stamp / STEP) + 1, stamp) for stamp in STAMPS]), end(arrivals)
    assert late.mean == pytest.approx(prompt.mean, abs=1e-12)
    assert late.covariance == pytest.approx(prompt.covariance, abs=1e-12)


def test_inputs_between_two_queries_share_a_step():
    rare, frequent = history(), history()
    for k in range(1, 41):
        rare.add_input(k * STEP, imu(k))
        frequent.add_input(k * STEP, imu(k))
        _ = frequent.newest
    assert rare.newest.state.mean[:AX] == pytest.approx(
        frequent.newest.state.mean[:AX], abs=1e-4)
    assert len(rare._steps) == 21 and len(frequent._steps) == 41


def test_measurement_newer_than_the_inputs_waits():
    made = history()
    made.add_measurement(measurement(0.012, 1.0))
    assert made.newest.state.mean[X] == 0.0
    for k in range(1, 4):
        made.add_input(k * STEP, imu(k))
    assert made.newest.state.mean[X] > 0.5


def test_late_input_of_the_imu_replaces_coasting():
    measured, coasting = history(), history()
    for k in range(1, 41):
        measured.add_input(k * STEP, imu(k))
        coasting.add_input(k * STEP, imu(k) if k < 30 else None)
        _ = measured.newest, coasting.newest
    for one in (measured, coasting):
        one.add_measurement(measurement(0.18))
    assert coasting.newest.state.mean[X] != pytest.approx(measured.newest.state.mean[X], abs=1e-6)
    for k in range(30, 41):
        coasting.add_input(k * STEP, imu(k))
        _ = coasting.newest
    assert coasting.newest.state.mean == pytest.approx(measured.newest.state.mean, abs=1e-12)


def test_measurement_is_decided_once():
    made, first = history(), measurement(0.012)
    for k in range(1, 20):
        made.add_input(k * STEP, imu(k))
    made.add_measurement(first)
    _ = made.newest
    first.level = 7.0
    made.add_measurement(measurement(0.006))
    _ = made.newest
    assert first.level == 7.0


def test_history_keeps_its_span():
    made = history()
    for k in range(1, 1001):
        made.add_input(k * STEP, imu(k))
        _ = made.newest
    assert made.oldest == pytest.approx(5.0 - SPAN)
    assert len(made._steps) < 90
