"""The filter's motion and the sensors' derivatives, held against differences."""

import math

from estimator_plant import Imu, LASERS, setup_of
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.estimation.estimator import DisturbanceEstimator
from facade_manipulator.estimation.sensors import (
    DistanceSensor,
    FeatureSensor,
    pose_at,
    PoseSensor,
    Wall,
)
from facade_manipulator.estimation.settings import (
    DistanceSettings,
    FixSettings,
    ImuSettings,
    PoseFixSettings,
    ProfileSettings,
)
from facade_manipulator.estimation.state import (
    COASTING,
    FilterState,
    InertialInput,
    Process,
    RATE_Z,
    SENSORS,
    SensorState,
    TILT_DEVIATION,
    TILT_X,
    TILT_Y,
    VX,
    X,
    YAW,
)

STEP, SHIFT = 0.005, 1e-6
INPUT = InertialInput((0.03, -0.02, 0.05), (0.2, -0.1, 9.7))
LARGEST = np.array((0.1, 0.1, 0.05, 0.2, 0.2, 0.02, 0.02, 0.01, 0.01, 0.01, 0.1, 0.1, 1e-3, 1e-3,
                    3e-3))
states = st.lists(st.floats(-1.0, 1.0), min_size=15, max_size=15).map(
    lambda shares: LARGEST * shares)


def process():
    return Process(ImuSettings(), [SensorState(1e-3, 0.02), SensorState(1e-3, 0.02),
                                   SensorState(1e-3, math.inf)])


def sensors():
    wall, imu = Wall(ProfileSettings(distance=0.5)), (0.2, -0.1, 0.3)
    feature = FeatureSensor('fix', FixSettings(mounting=(0.1, 0.05, 0.0)), wall, imu, SENSORS + 1)
    feature.feature = 0.3
    left = DistanceSettings(mounting=(-0.5, 0.1, 0.2))
    return [DistanceSensor('left', left, wall, imu, SENSORS), feature,
            *(PoseSensor('pose', axis, PoseFixSettings(), imu) for axis in range(3))]


@pytest.mark.parametrize('inertial', [INPUT, COASTING])
@given(mean=states)
def test_the_transition_is_the_derivative_of_the_motion(inertial, mean):
    moving = process()
    _, transition = moving.moved(mean, inertial, STEP)
    for index in range(SENSORS):
        shift = np.zeros(len(mean))
        shift[index] = SHIFT
        slope = (moving.moved(mean + shift, inertial, STEP)[0]
                 - moving.moved(mean - shift, inertial, STEP)[0]) / (2.0 * SHIFT)
        assert transition[:SENSORS, index] == pytest.approx(
            slope[:SENSORS], abs=2e-4)  # half of g STEP²


@pytest.mark.parametrize('number', range(5))
@given(mean=states, yaw=st.floats(-1.0, 1.0))
def test_a_sensors_derivative_is_that_of_what_it_should_measure(number, mean, yaw):
    sensor, turning = sensors()[number], 0.02
    mean[[YAW, -1]] = yaw, 0.0  # of the delay of stamps it is to first order
    _, direction = sensor.expected(mean, turning)
    for index in range(len(mean)):
        shift = np.zeros(len(mean))
        shift[index] = SHIFT
        slope = (sensor.expected(mean + shift, turning)[0]
                 - sensor.expected(mean - shift, turning)[0]) / (2.0 * SHIFT)
        assert direction[index] == pytest.approx(slope, abs=1e-8)


def test_a_body_that_turns_about_a_point_stays_there():
    """A sensor at a lever of 1 m that turns at a constant rate measures ω² r towards the point."""
    moved, turning = process(), 0.3
    mean = np.zeros(15)
    mean[X], mean[VX + 1] = 1.0, turning
    state = FilterState(mean, np.eye(15))
    for _ in range(2000):
        state = moved.advanced(
            state, InertialInput((0.0, 0.0, turning), (-turning ** 2, 0.0, 9.81)), STEP)
    middle, _ = pose_at(state.mean, (-1.0, 0.0, 0.0))
    assert middle[:2] == pytest.approx((0.0, 0.0), abs=1e-4)
    assert state.mean[YAW] == pytest.approx(turning * 10.0)


def test_what_is_about_the_same_for_a_time_is_forgotten_in_it():
    moved = Process(ImuSettings(), [SensorState(1e-3, math.inf, 10.0)])
    state = FilterState(np.full(13, 1e-3), np.zeros((13, 13)))
    for _ in range(2000):
        state = moved.advanced(state, COASTING, STEP)
    assert state.mean[SENSORS] == pytest.approx(1e-3 * math.exp(-1.0))
    assert state.covariance[SENSORS, SENSORS] == pytest.approx(1e-6 * (1.0 - math.exp(-2.0)))


def test_gravity_of_a_tilt_is_no_acceleration():
    moved, mean = process(), np.zeros(15)
    mean[TILT_Y] = 0.01
    state = FilterState(mean, np.eye(15))
    for _ in range(200):
        state = moved.advanced(
            state, InertialInput((0.0, 0.0, 0.0), (-0.01 * 9.81, 0.0, 9.81)), STEP)
    assert state.mean[X] == pytest.approx(0.0, abs=1e-9)


def test_before_anything_is_known_an_imu_and_sensors_may_be_off_by_what_is_said_of_them():
    off = np.sqrt(np.diag(process().unknown().covariance))
    assert off[[TILT_X, TILT_Y, SENSORS, SENSORS + 1, SENSORS + 2]] == pytest.approx(
        [TILT_DEVIATION, TILT_DEVIATION, 1e-3, 1e-3, 1e-3])


def test_a_pose_without_deviations_has_those_of_the_settings_of_its_axes():
    settings = PoseFixSettings()
    assert [sensor.noise for sensor in sensors()[2:]] == [
        settings.position_noise, settings.position_noise, settings.yaw_noise]


def test_an_imu_that_goes_and_comes_leaves_velocity_and_knowledge_of_its_offsets():
    moved, mean = process(), np.zeros(15)
    mean[VX], mean[RATE_Z] = 0.2, 0.01
    known = FilterState(mean, 1e-4 * np.eye(15))
    offsets = moved.offsets_of(known)
    lost = moved.without_imu(known, InertialInput((0.0, 0.0, 0.06), (0.3, 0.0, 9.81)))
    later = moved.advanced(lost, COASTING, 0.1)
    assert later.mean[YAW] == pytest.approx(0.1 * 0.05)
    assert later.mean[VX] == pytest.approx(0.2 + 0.1 * 0.3, rel=0.02)
    back = moved.with_imu(later, offsets)
    assert back.mean[RATE_Z] == 0.01 and back.mean[VX] == later.mean[VX]
    assert (np.linalg.eigvalsh(back.covariance) > -1e-12).all()
    assert np.diag(back.covariance)[[TILT_X, TILT_Y]] == pytest.approx(TILT_DEVIATION ** 2)


def test_the_velocity_of_the_rail_is_as_uncertain_as_that_of_the_imu_and_the_rate_it_turns_by():
    estimator = DisturbanceEstimator(setup_of(LASERS, Imu(place=(0.2, -0.05, 0.1))))
    mean, random = np.zeros(SENSORS + len(LASERS)), np.random.default_rng(1)
    mean[[YAW, VX, VX + 1, RATE_Z]] = 0.3, 0.2, -0.1, 0.01
    axes = [VX, VX + 1, RATE_Z]
    root = random.standard_normal((3, 3))
    covariance = np.zeros((len(mean), len(mean)))
    covariance[np.ix_(axes, axes)] = root @ root.T

    def velocity(shift):
        return np.array(estimator._motion(0.0, FilterState(mean + shift, covariance), INPUT)[2])

    slopes = np.array([velocity(one) - velocity(-one) for one in 0.5 * np.eye(len(mean))[axes]]).T
    found = estimator._motion(0.0, FilterState(mean, covariance), INPUT).velocity_covariance
    assert found == pytest.approx(slopes @ root @ root.T @ slopes.T, abs=1e-3)
