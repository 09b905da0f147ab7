"""Motion of the state vector and measurement equations, compared with finite differences."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.estimation import estimator_settings, rail_pose_model
from facade_manipulator.estimation.estimator_settings import ImuSettings
from facade_manipulator.estimation.rail_pose_model import SENSORS

INDICES = {**vars(rail_pose_model), 'DELAY': SENSORS + 1}  # place in the state vector
PROCESS = rail_pose_model.Process
STEP = 0.005  # s
SHIFT = 1e-6  # of the finite differences
IMU_INPUT = (0.03, -0.02, 0.05, 0.2, -0.1, 9.7)
IMU = ImuSettings(mounting=(0.2, -0.1, 0.3, 0.0, 0.0, 0.0))
SETUP = estimator_settings.EstimatorSetup(
    IMU,
    estimator_settings.ProfileSettings(distance=0.5),
    {'left': estimator_settings.DistanceSettings(mounting=(-0.5, 0.1, 0.2))},
    {'fix': estimator_settings.FixSettings(mounting=(0.1, 0.05, 0.0), feature=0.3)},
    {'pose': estimator_settings.PoseFixSettings()},
)
SENSORS_OF_WALL = rail_pose_model.make_sensors(SETUP)
LARGEST = np.array(
    (
        0.1,
        0.1,
        0.5,
        0.2,
        0.2,
        0.2,
        0.2,
        0.02,
        0.02,
        0.02,
        0.01,
        0.01,
        0.01,
        0.1,
        0.1,
        0.02,
        1e-3,
        1e-3,
        3e-3,
    )
)
states = st.lists(st.floats(-1.0, 1.0), min_size=19, max_size=19).map(
    lambda shares: LARGEST * shares
)


def slopes(function, mean):
    """Return the derivative of a function by the state, one row for each state."""
    rows = []
    for shift in SHIFT * np.eye(len(mean)):
        change = np.subtract(function(mean + shift), function(mean - shift))
        rows.append(change / (2.0 * SHIFT))
    return np.array(rows)


@pytest.mark.parametrize('imu', [IMU_INPUT, None])
@given(mean=states)
def test_transition_matrix_is_the_derivative_of_the_motion(imu, mean):
    sensor_states = []
    for sensor in SENSORS_OF_WALL:
        sensor_states += sensor.states
    process = rail_pose_model.Process(IMU, sensor_states)
    _, transition, _ = process.move(mean, imu, STEP)
    found = slopes(lambda state: process.move(state, imu, STEP)[0], mean).T
    of_rail = transition[:SENSORS, :SENSORS]
    # half of g STEP² and the products of tilt and rate
    assert of_rail == pytest.approx(found[:SENSORS, :SENSORS], abs=3e-4)


@pytest.mark.parametrize('sensor', SENSORS_OF_WALL, ids=lambda sensor: sensor.name)
@given(mean=states, later=st.floats(-0.01, 0.01))
def test_jacobian_is_the_derivative_of_the_measurement(sensor, mean, later):
    _, jacobian = sensor.expect(mean.tolist(), later)
    found = slopes(lambda state: sensor.expect(state.tolist(), later)[0], mean)
    # first order in `later` and the delay
    assert jacobian == pytest.approx(found, abs=1e-3)


# turning about a point at a distance of 1 m
RATE = 0.3  # rad/s
ACCELERATION = 0.3**2  # m/s²
REST = (*5 * [0.0], 9.81)


@pytest.mark.parametrize(
    ('biases', 'at_start', 'walk'),
    [
        (PROCESS.GYROSCOPES, PROCESS.GYROSCOPE_BIAS_ON_START, PROCESS.GYROSCOPE_WALK),
        (
            PROCESS.ACCELEROMETERS,
            PROCESS.ACCELEROMETER_BIAS_ON_START,
            PROCESS.ACCELEROMETER_WALK,
        ),
    ],
    ids=['gyroscope', 'accelerometer'],
)
def test_variance_of_a_bias_grows_as_a_random_walk(biases, at_start, walk):
    process = PROCESS(IMU, [])
    state = process.initial_state()
    for _ in range(round(10.0 / STEP)):
        state = process.propagate(state, REST, STEP)
    grown = np.diag(state.covariance)[biases] - at_start**2
    assert grown == pytest.approx(10.0 * walk**2, rel=1e-3)


@pytest.mark.parametrize('sensor', SENSORS_OF_WALL, ids=lambda sensor: sensor.name)
@given(mean=states)
def test_shift_of_a_moving_rail_explains_the_measurement(sensor, mean):
    measured = sensor.expect(mean.tolist(), 0.0)[0] + 1e-4
    shifted = mean.copy()
    shifted[sensor.axes[0]] += sensor.shift(mean, measured)
    expected, *_ = sensor.expect(shifted.tolist(), 0.0)
    assert expected == pytest.approx(measured, abs=1e-6)


def test_rail_that_tilts_in_a_cone_does_not_yaw():
    process = rail_pose_model.Process(IMU, [])
    tilt = 0.1  # rad
    turn = 3.0  # rad/s
    state = process.initial_state()
    state.mean[rail_pose_model.TILT_X] = tilt
    for phase in turn * STEP * (np.arange(400) + 0.5):
        x = math.cos(phase)
        y = math.sin(phase)
        sine = math.sin(tilt)
        directions = np.array((-sine * y, sine * x, math.cos(tilt) - 1.0))
        rates = turn * directions
        forces = 9.81 * np.array((-tilt * y, tilt * x, 1.0))
        state = process.propagate(state, (*rates, *forces), STEP)
    assert state.mean[rail_pose_model.YAW] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    ('seconds', 'imu', 'begin', 'end'),
    [
        (
            10.0,
            (0.0, 0.0, RATE, -ACCELERATION, 0.0, 9.81),
            {'X': 1.0, 'VY': RATE},
            {
                'X': math.cos(3.0),
                'Y': math.sin(3.0),
                'YAW': 3.0,
                'AX': -ACCELERATION,
                'YAW_RATE': RATE,
            },
        ),
        (
            1.0,
            (0.0, 0.0, 0.0, -0.01 * 9.81, 0.0, 9.81),
            {'TILT_Y': 0.01},
            {'X': 0.0, 'TILT_Y': 0.01},
        ),
        (
            0.1,
            None,
            {'VX': 0.2, 'AX': 0.03, 'YAW_RATE': 0.05},
            {'X': 0.02014, 'VX': 0.20276, 'VY': 0.0, 'YAW': 0.005, 'YAW_RATE': 0.05},
        ),
        (0.2, REST, {'VX': 0.1, 'SENSORS': 1.0}, {'SENSORS': math.exp(-1.0)}),
        (2.0, REST, {'DELAY': 1.0}, {'DELAY': math.exp(-1.0)}),
    ],
    ids=['turning', 'tilted', 'coasting', 'place', 'delay'],
)
def test_state_follows_mechanics_and_keeps_its_variance(seconds, imu, begin, end):
    place = rail_pose_model.SensorState(1e-3, length=0.02)
    delay = rail_pose_model.SensorState(1e-3, time=2.0)
    process = rail_pose_model.Process(ImuSettings(), [place, delay])
    state = process.initial_state()
    for name, value in begin.items():
        state.mean[INDICES[name]] = value
    for _ in range(round(seconds / STEP)):
        state = process.propagate(state, imu, STEP)
    for name, value in end.items():
        assert state.mean[INDICES[name]] == pytest.approx(value, abs=2e-4)
    variances = np.diag(state.covariance)
    assert variances[SENSORS:] == pytest.approx(2 * [1e-6], rel=1e-3)
    assert state.covariance == pytest.approx(state.covariance.T, rel=1e-12)
