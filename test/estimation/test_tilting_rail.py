"""Pose and twist of a rail that tilts about an IMU which is not at the height of the rail."""

import math

import numpy as np
import pytest
from sensor_record import replace, SETUP, START

from facade_manipulator.estimation.estimator_settings import (
    ImuSettings,
    PoseFixSettings,
)
from facade_manipulator.estimation.rail_pose_filter import DisturbanceEstimator
from facade_manipulator.kinematics import GRAVITY, Pose

HEIGHT = 0.5  # m, of the IMU above the rail
IMU = ImuSettings(mounting=(0.0, 0.0, HEIGHT, 0.0, 0.0, 0.0))
CAMERA = {'camera': PoseFixSettings()}
SETUP_WITH_POSES = replace(SETUP, imu=IMU, distances={}, fixes={}, poses=CAMERA)
TILTS = np.array((0.003, 0.005))  # rad, amplitudes about x and y
FREQUENCY = math.tau  # rad/s
YAW = 0.3  # rad
STEP = 0.005  # s
BEGIN = 5.0  # s, after which the estimates are compared
END = 10.0  # s


def estimates(gyroscope_noise: float, pose_noise: float):
    """Return times, true poses and velocities along the rail, and the estimates."""
    random = np.random.default_rng(1)
    estimator = DisturbanceEstimator(SETUP_WITH_POSES)
    found = []
    for number in range(round(END / STEP)):
        time = number * STEP
        now = START + time
        tilt_x, tilt_y = TILTS * math.sin(FREQUENCY * time)
        rate_x, rate_y = TILTS * FREQUENCY * math.cos(FREQUENCY * time)
        # the IMU is at rest, and the middle of the rail below it moves
        along = -HEIGHT * tilt_y
        across = HEIGHT * tilt_x
        x = math.cos(YAW) * along - math.sin(YAW) * across
        y = math.sin(YAW) * along + math.cos(YAW) * across
        pose = Pose(x, y, YAW)
        velocity = (-HEIGHT * rate_y, HEIGHT * rate_x)

        rates = np.array((rate_x, rate_y, 0.0))
        rates += gyroscope_noise / math.sqrt(STEP) * random.standard_normal(3)
        estimator.add_imu(
            now, now, rates, (-GRAVITY * tilt_y, GRAVITY * tilt_x, GRAVITY)
        )
        if number % 2 == 0:
            for axis, value in pose._asdict().items():
                value += pose_noise * random.standard_normal()
                estimator.add(f'camera.{axis}', now, now, value)
            estimate = estimator.advance(now)
            if time > BEGIN:
                assert estimate.stamp == now
                found.append((pose, velocity, estimate))
    return found


def test_twist_is_the_derivative_of_the_pose():
    for pose, velocity, estimate in estimates(gyroscope_noise=0.0, pose_noise=0.0):
        assert estimate.pose == pytest.approx(pose, abs=2e-4)
        # 16 mm/s at most; half a step of the IMU late
        assert estimate.twist[:2] == pytest.approx(velocity, abs=1e-3)


def test_deviation_of_twist_includes_the_gyroscope_noise():
    shares = []
    for _, velocity, estimate in estimates(IMU.gyroscope_noise, pose_noise=1e-3):
        deviations = np.sqrt(np.diag(estimate.twist_covariance)[:2])
        errors = np.subtract(estimate.twist[:2], velocity)
        assert (deviations > 0.7 * HEIGHT * IMU.gyroscope_noise / math.sqrt(0.01)).all()
        shares.append(np.abs(errors) < 2.0 * deviations)
    assert (np.mean(shares, axis=0) > 0.93).all()
