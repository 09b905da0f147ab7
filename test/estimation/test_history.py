"""Late measurements apply at their stamps."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.estimation.estimator_settings import ImuSettings
from facade_manipulator.estimation.history import History, Measurement
from facade_manipulator.estimation.rail_pose_model import AX, Process, update, VX, X

STEP = 0.005
STEPS = 60
STAMPS = [0.0123, 0.05, 0.0777, 0.1011, 0.1999]


class Played:
    """History of x with inputs; measurements of x arrive with some inputs or after them."""

    def __init__(self, arrivals=(), is_coasting=lambda k: False, steps=STEPS, query=1):
        self.decided = 0
        self.history = History(Process(ImuSettings(), []), self.correct, 0.0)
        for k in range(1, steps + 1):
            self.add_input(k, is_coasting(k))
            for _, stamp in [one for one in arrivals if one[0] == k]:
                self.history.add_measurement(Measurement('', stamp, 0.1 * stamp, 1e-4))
            if k % query == 0:
                self.history.update()

    def add_input(self, k, is_coasting=False):
        values = (0.0, 0.0, 0.01 * k, np.sin(0.3 * k), 0.1, 9.81)
        self.history.add_input(k * STEP, None if is_coasting else values)

    def correct(self, step, measurement):
        """Return x after a past measurement, with its level decided once."""
        if np.isnan(measurement.level):
            measurement.level = 0.0
            self.decided += 1
        mean, covariance = step.state
        jacobian = np.zeros(len(mean))
        jacobian[X] = 1.0
        jacobian[VX] = measurement.stamp - step.stamp
        cross = covariance @ jacobian
        variance = float(cross @ jacobian) + measurement.variance
        error = measurement.value - float(jacobian @ mean)
        return update(step.state, cross, variance, error)


def same_state(one):
    return pytest.approx(np.vstack(one.history.update().state), abs=1e-12)


@given(st.lists(st.integers(0, 15), min_size=5, max_size=5))
def test_late_and_prompt_measurements_give_the_same_state(delays):
    prompt = [(int(stamp / STEP) + 1, stamp) for stamp in STAMPS]
    delayed = []
    for (k, stamp), delay in zip(prompt, delays, strict=True):
        delayed.append((k + delay, stamp))
    late = Played(delayed)
    assert np.vstack(late.history.update().state) == same_state(Played(prompt))
    assert late.decided == len(STAMPS)


def test_measurement_newer_than_the_inputs_waits():
    made = Played([(1, 0.0123)], steps=2)
    assert made.decided == 0
    made.add_input(3)
    later = Played([(3, 0.0123)], steps=3)
    assert np.vstack(made.history.update().state) == same_state(later)


def test_late_imu_input_replaces_coasting():
    measured = Played([(41, 0.18)], steps=41)
    coasting = Played([(41, 0.18)], lambda k: k >= 30, steps=41)
    assert np.vstack(coasting.history.update().state) != same_state(measured)
    for k in range(30, 42):
        coasting.add_input(k)
        coasting.history.update()
    assert np.vstack(coasting.history.update().state) == same_state(measured)


def test_first_input_at_the_initial_time_keeps_the_pose():
    made = Played(steps=0)
    made.add_input(0)
    assert not made.history.update().state.mean[:AX].any()


def test_inputs_between_two_queries_share_one_step():
    rare = Played(query=STEPS)
    frequent = Played()
    expected = frequent.history.update().state.mean[:AX]
    found = rare.history.update().state.mean[:AX]
    assert found == pytest.approx(expected, abs=1e-4)
    assert len(frequent.history._steps) == 1 + STEPS
    assert len(rare.history._steps) == 1 + STEPS / 2


def test_history_keeps_its_configured_span():
    history = Played([(900, 4.49)], steps=1000).history
    assert (
        5.0 - History.HISTORY_SPAN - STEP
        <= history.oldest
        <= 5.0 - History.HISTORY_SPAN
    )
    assert not history._measurements
