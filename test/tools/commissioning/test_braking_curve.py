"""Deceleration of simulated stops with a known brake, delay and servo lag."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.tools.commissioning.braking_curve import fit_deceleration

STEADY = 5
PERIOD = 0.01
STEP = 1e-4


def stop(speed, deceleration, delay, lag, noise=0.0):
    """Return times [s] and positions [m] of a stop, integrated in steps of 0.1 ms."""
    demand = speed * lag
    position = 0.0
    demanded_speed = speed
    times = []
    positions = []
    for number in range(-400, 12_000):
        time = number * STEP
        if number % round(PERIOD / STEP) == 0:
            times.append(time)
            positions.append(position)
        if time >= delay:
            demanded_speed = max(0.0, demanded_speed - deceleration * STEP)
        demand += demanded_speed * STEP
        change = (demand - position) * -np.expm1(-STEP / lag) if lag else 0.0
        position = position + change if lag else demand
    errors = np.random.default_rng(1).uniform(-noise, noise, len(positions))
    return np.array(times), np.array(positions) + errors


@given(
    st.floats(0.5, 8.0),
    st.floats(0.15, 0.3),
    st.floats(0.0, 0.03),
    st.floats(0.0, 0.01),
    st.floats(0.7, 1.3),
)
def test_deceleration_is_inside_its_uncertainty(
    deceleration, speed, delay, lag, lag_error
):
    found = fit_deceleration(
        *stop(speed, deceleration, delay, lag), STEADY, lag * lag_error
    )
    assert 0.99 * found.least <= deceleration <= 1.01 * found.most


@pytest.mark.parametrize('direction', [-1.0, 1.0])
@pytest.mark.parametrize('deceleration', [1.0, 3.0, 6.0])
def test_deceleration_is_found_despite_noise_and_delay(direction, deceleration):
    times, positions = stop(0.3, deceleration, 0.02, 0.005, noise=1e-5)
    found = fit_deceleration(times, direction * positions, STEADY, 0.005)
    assert found.best == pytest.approx(deceleration, rel=0.1)
    assert found.least > 0.8 * deceleration


def test_overshoot_of_a_servo_counts_as_its_stop():
    times, positions = stop(0.3, 3.0, 0.01, 0.0)
    back = positions[-1] - 0.007
    reversing = np.maximum(back, positions[-1] - times + 0.15)
    returned = np.where(times > 0.15, reversing, positions)
    found = fit_deceleration(times, returned, STEADY, 0.0)
    assert found.most < 3.3


def test_carriage_that_stops_at_once_has_a_large_deceleration():
    times = np.arange(20) * PERIOD
    positions = 0.2 * np.minimum(times, times[STEADY - 1])
    assert fit_deceleration(times, positions, STEADY, 0.0).least >= 50.0
