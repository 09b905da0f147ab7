"""The motion of the state vector and the measurement equations, held against differences."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.estimation import model
from facade_manipulator.estimation.model import SENSORS, TILT_Y, VX, VY, X, YAW, YAW_RATE
from facade_manipulator.estimation.settings import (
    DistanceSettings,
    EstimatorSetup,
    FixSettings,
    ImuSettings,
    PoseFixSettings,
)

STEP, SHIFT = 0.005, 1e-6  # s, of differences
IMU_INPUT = (0.03, -0.02, 0.05, 0.2, -0.1, 9.7)
SETUP = EstimatorSetup(
    imu=ImuSettings(mounting=(0.2, -0.1, 0.3, 0.0, 0.0, 0.0)),
    distances={'left': DistanceSettings(mounting=(-0.5, 0.1, 0.2))},
    fixes={'fix': FixSettings(mounting=(0.1, 0.05, 0.0), feature=0.3, feature_known=True)},
    poses={'pose': PoseFixSettings()})
SENSORS_OF_WALL = model.make_sensors(SETUP, model.Wall(0.5))
LARGEST = np.array((
    0.1, 0.1, 0.5, 0.2, 0.2, 0.2, 0.2, 0.02, 0.02, 0.02, 0.01, 0.01, 0.01, 0.1, 0.1, 1e-3, 1e-3,
    3e-3))
states = st.lists(st.floats(-1.0, 1.0), min_size=18, max_size=18).map(
    lambda shares: LARGEST * shares)


def process(*sensor_states):
    return model.Process(ImuSettings(), sensor_states or [
        state for sensor in SENSORS_OF_WALL for state in sensor.states])


def slopes(function, mean):
    """Return the derivative of a function of the state, one row for each state."""
    return np.array([(np.array(function(mean + shift)) - function(mean - shift)) / (2.0 * SHIFT)
                     for shift in SHIFT * np.eye(len(mean))])


@pytest.mark.parametrize('imu', [IMU_INPUT, None])
@given(mean=states)
def test_transition_is_the_derivative_of_the_motion(imu, mean):
    moving = process()
    _, transition = moving.move(mean, imu, STEP)
    found = slopes(lambda state: moving.move(state, imu, STEP)[0], mean).T
    assert transition[:SENSORS, :SENSORS] == pytest.approx(
        found[:SENSORS, :SENSORS], abs=3e-4)  # half of g STEP² and the products of tilt and rate


@pytest.mark.parametrize('sensor', SENSORS_OF_WALL, ids=lambda sensor: sensor.name)
@given(mean=states, later=st.floats(-0.01, 0.01))
def test_jacobian_is_the_derivative_of_the_measurement(sensor, mean, later):
    _, jacobian = sensor.expect(mean.tolist(), later)
    found = slopes(lambda state: sensor.expect(state.tolist(), later)[0], mean)
    assert jacobian == pytest.approx(found, abs=1e-3)  # first order in `later` and the delay


def test_imu_turning_about_a_point_keeps_the_point_fixed():
    moving, turning = process(), 0.3  # rad/s at a lever of 1 m: ω² r towards the point
    state = moving.initial_state()
    state.mean[X], state.mean[VY] = 1.0, turning
    for _ in range(2000):
        state = moving.propagate(state, (0.0, 0.0, turning, -turning ** 2, 0.0, 9.81), STEP)
    pose, _, _ = model.pose_at(state.mean.tolist(), (-1.0, 0.0, 0.0))
    assert pose == pytest.approx((0.0, 0.0, turning * 10.0), abs=1e-4)


def test_gravity_on_a_tilted_imu_moves_nothing():
    moving = process()
    state = moving.initial_state()
    state.mean[TILT_Y] = 0.01
    for _ in range(200):
        state = moving.propagate(state, (0.0, 0.0, 0.0, -0.01 * 9.81, 0.0, 9.81), STEP)
    assert state.mean[X] == pytest.approx(0.0, abs=1e-9)
    assert state.covariance == pytest.approx(state.covariance.T, rel=1e-12)


def test_lost_imu_leaves_acceleration_and_yaw_rate():
    moving = process()
    state = moving.initial_state()
    state.mean[VX] = 0.2
    measured = moving.propagate(state, (0.0, 0.0, 0.05, 0.3, 0.0, 9.81), 1e-6)
    later = moving.propagate(measured, None, 0.1)
    assert later.mean[YAW] == pytest.approx(0.1 * 0.05, abs=1e-6)
    assert later.mean[VX] == pytest.approx(0.2 + 0.1 * 0.3, rel=0.02)
    assert later.mean[YAW_RATE] == pytest.approx(0.05)


@pytest.mark.parametrize(('kind', 'speed', 'time'), [
    (model.SensorState(1e-3, time=10.0), 0.0, 10.0), (model.SensorState(1e-3, 0.02), 0.1, 0.2)])
def test_sensor_state_decays_over_time_and_distance(kind, speed, time):
    moving = process(kind)
    state = moving.initial_state()
    state.mean[[VX, SENSORS]], state.covariance[:] = (speed, 1e-3), 0.0
    for _ in range(round(time / STEP)):
        state = moving.propagate(state, (0.0,) * 5 + (9.81,), STEP)
    assert state.mean[SENSORS] == pytest.approx(1e-3 * math.exp(-1.0))
    assert state.covariance[SENSORS, SENSORS] == pytest.approx(1e-6 * (1.0 - math.exp(-2.0)))
