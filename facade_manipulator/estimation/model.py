"""
The model of the filter: state vector, motion between two inputs of the IMU, measurements.

The state is that of the IMU: position and velocity along the axes of `facade`, yaw ψ, acceleration
a along the axes of the rail, yaw rate, tilts θ about the rail's x and y, biases of gyroscopes and
accelerometers. Each sensor of the wall adds its own states: the error of the place that it
measures, and the unknown part of its delay. With the turning rates ω and the specific forces f of
the IMU less their biases,

    v̇ = R(ψ) a,  a = f + f_z (θ_y, −θ_x),  ψ̇ = ω_z + θ_x ω_y − θ_y ω_x,
    θ̇_x = ω_x + ω_z θ_y,  θ̇_y = ω_y − ω_z θ_x.

Without an IMU the filter coasts: the yaw rate changes at random, and acceleration and tilts decay
at random to 0 (R. A. Singer, “Estimating optimal tracking filter performance for manned
maneuvering targets”, IEEE Trans. AES 6 (1970) 473–483).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from facade_manipulator.estimation.settings import EstimatorSetup, ImuSettings
from facade_manipulator.kinematics import Pose

(X, Y, YAW, VX, VY, AX, AY, YAW_RATE, TILT_X, TILT_Y, GYROSCOPE_X, GYROSCOPE_Y, GYROSCOPE_Z,
 ACCELEROMETER_X, ACCELEROMETER_Y) = range(15)
SENSORS = 15  # index of the first state of a sensor of the wall
VELOCITY, INPUTS, RATES = slice(VX, AX), slice(AX, TILT_X), [VX, VY, YAW_RATE]
TILTS, BIASES = slice(TILT_X, GYROSCOPE_X), slice(GYROSCOPE_X, SENSORS)
# Variances of x, y, yaw and velocity when an axis starts:
POSE_ON_START, VELOCITY_ON_START = (0.015 ** 2, 0.015 ** 2, 0.02 ** 2), 0.15 ** 2
TILT, TILT_TIME = 3e-3, 1.0  # rad and s: standard deviation against the mean hanging, and its time
# Standard deviations of the biases at start. Biases of three times as much, of a consumer IMU, are
# found as well; a larger accelerometer bias would leave open which part is tilt.
GYROSCOPE_BIAS, ACCELEROMETER_BIAS = 0.01, 0.1  # rad/s, m/s²
# Random walk of the biases: 10 °/h and 0.1 mg of an industrial IMU in the minutes of a warm-up
GYROSCOPE_WALK, ACCELEROMETER_WALK = 5e-6, 1e-4  # rad/s/√s, m/s²/√s
BANDWIDTH = 100.0  # Hz, of the noise in yaw rate and acceleration
# Without an IMU, of a gondola in gusts:
ACCELERATION, ACCELERATION_TIME = 0.12, 0.6  # m/s² and s: standard deviation, correlation time
YAW_ACCELERATION = 6e-3  # rad/s²/√Hz
# s, correlation time of the delay of a fix: of a constant the filter would become ever more
# certain, although errors of the model look like one
DELAY_TIME = 60.0
PLACE_LENGTH = 0.02  # m, correlation length of the errors of places on the wall

# Elements of the transition matrix that depend on state and input, as row and column; to write
# all of them at once takes half the time
WITH_IMU = np.array((
    (X, VX), (Y, VY), (YAW, GYROSCOPE_Z), (VX, YAW), (VX, TILT_X), (VX, TILT_Y),
    (VX, ACCELEROMETER_X), (VX, ACCELEROMETER_Y), (VY, YAW), (VY, TILT_X), (VY, TILT_Y),
    (VY, ACCELEROMETER_X), (VY, ACCELEROMETER_Y), (AX, TILT_Y), (AY, TILT_X),
    (TILT_X, TILT_Y), (TILT_X, GYROSCOPE_X), (TILT_Y, TILT_X), (TILT_Y, GYROSCOPE_Y)))
COASTING = np.array((
    (X, VX), (Y, VY), (YAW, YAW_RATE), (VX, YAW), (VX, AX), (VX, AY), (VY, YAW), (VY, AX),
    (VY, AY), (AX, AX), (AY, AY), (TILT_X, TILT_X), (TILT_Y, TILT_Y)))

#: Turning rates [rad/s] and specific forces [m/s²] along the rail's axes; None without an IMU.
ImuInput = tuple[float, ...] | None


class FilterState(NamedTuple):
    """Mean and covariance of the state vector."""

    mean: np.ndarray
    covariance: np.ndarray


class SensorState(NamedTuple):
    """Standard deviation of a state of a sensor, and the correlation length [m] and time [s]."""

    deviation: float
    length: float = math.inf
    time: float = math.inf


def update(state: FilterState, cross: np.ndarray, variance: float, residual: float) -> FilterState:
    """
    Return the state after a scalar measurement.

    With P Hᵀ, the covariance of state and measurement, and H P Hᵀ + R, the residual's variance.
    """
    mean, covariance = state
    return FilterState(mean + cross * (residual / variance),
                       covariance - np.multiply.outer(cross, cross / variance))


def forget(covariance: np.ndarray, index: int, variance: float) -> None:
    """Give a state, in place, another variance and no correlation with the other states."""
    covariance[index] = covariance[:, index] = 0.0
    covariance[index, index] = variance


class Process:
    """The motion of the state vector for one IMU and one set of sensors."""

    def __init__(self, imu: ImuSettings, sensors: Sequence[SensorState]) -> None:
        self.size = SENSORS + len(sensors)
        self._variances = np.array([sensor.deviation for sensor in sensors]) ** 2  # of sensors
        self._decays = [(1.0 / sensor.length, 1.0 / sensor.time) for sensor in sensors]
        # transition matrices with the elements that never change, and places of those that do
        self._with_imu, self._coasting = np.eye(self.size), np.eye(self.size)
        inputs, biases = [AX, AY, YAW_RATE], [ACCELEROMETER_X, ACCELEROMETER_Y, GYROSCOPE_Z]
        self._with_imu[inputs, inputs], self._with_imu[inputs, biases] = 0.0, -1.0
        self._varying_with_imu, self._varying_coasting = (
            varying @ (self.size, 1) for varying in (WITH_IMU, COASTING))
        # variances that the states gain in a second, and those of yaw rate and acceleration
        self._imu_walk, self._coasting_walk = np.zeros((2, self.size))
        self._imu_walk[BIASES] = self._coasting_walk[BIASES] = np.array(
            3 * [GYROSCOPE_WALK] + 2 * [ACCELEROMETER_WALK]) ** 2
        self._imu_walk[YAW] = self._imu_walk[TILTS] = imu.gyroscope_noise ** 2
        self._imu_walk[VELOCITY] = imu.accelerometer_noise ** 2
        self._input_variances = BANDWIDTH * np.array(
            2 * [imu.accelerometer_noise] + [imu.gyroscope_noise]) ** 2
        self._coasting_walk[INPUTS] = (
            *2 * [2.0 * ACCELERATION ** 2 / ACCELERATION_TIME], YAW_ACCELERATION ** 2)
        self._coasting_walk[TILTS] = 2.0 * TILT ** 2 / TILT_TIME

    def initial_state(self) -> FilterState:
        """Return the state before the first measurement."""
        return FilterState(np.zeros(self.size), np.diag(np.concatenate([
            POSE_ON_START, 2 * [VELOCITY_ON_START], 2 * [ACCELERATION ** 2], [1e-4],
            2 * [TILT ** 2], 3 * [GYROSCOPE_BIAS ** 2],
            2 * [ACCELEROMETER_BIAS ** 2], self._variances])))

    def propagate(self, state: FilterState, imu: ImuInput, step: float) -> FilterState:
        """Return the state one step [s] later."""
        mean, transition = self.move(state.mean, imu, step)
        covariance: np.ndarray = transition @ state.covariance @ transition.T
        covariance = 0.5 * (covariance + covariance.T)  # an asymmetric part would grow
        noise = step * (self._imu_walk if imu else self._coasting_walk)
        if imu:
            noise[INPUTS] = self._input_variances
        noise[SENSORS:] = self._variances * (1.0 - _diagonal(transition)[SENSORS:] ** 2)
        variances = _diagonal(covariance)
        variances += noise
        return FilterState(mean, covariance)

    def move(
        self, before: np.ndarray, imu: ImuInput, step: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean one step [s] later and the transition matrix, its derivative."""
        x, y, yaw, vx, vy, ax, ay, wz, tilt_x, tilt_y, *biases = before[:SENSORS].tolist()
        if imu:
            wx, wy, wz, fx, fy, fz = imu
            wx, wy, wz = wx - biases[0], wy - biases[1], wz - biases[2]
            ax, ay = fx - biases[3] + fz * tilt_y, fy - biases[4] - fz * tilt_x
        middle = yaw + 0.5 * wz * step
        cosine, sine = step * math.cos(middle), step * math.sin(middle)
        dvx, dvy, turn = cosine * ax - sine * ay, sine * ax + cosine * ay, wz * step
        if imu:
            yaw += (tilt_x * wy - tilt_y * wx) * step
            tilt_x, tilt_y = tilt_x + wx * step + turn * tilt_y, tilt_y + wy * step - turn * tilt_x
            transition = self._with_imu.copy()
            transition.reshape(-1)[self._varying_with_imu] = (
                step, step, -step, -dvy, sine * fz, cosine * fz, -cosine, sine, dvx, -cosine * fz,
                sine * fz, -sine, -cosine, fz, -fz, turn, -step, -turn, -step)
        else:
            kept, upright = math.exp(-step / ACCELERATION_TIME), math.exp(-step / TILT_TIME)
            ax, ay, tilt_x, tilt_y = kept * ax, kept * ay, upright * tilt_x, upright * tilt_y
            transition = self._coasting.copy()
            transition.reshape(-1)[self._varying_coasting] = (
                step, step, step, -dvy, cosine, -sine, dvx, sine, cosine, kept, kept, upright,
                upright)
        x, y = x + (vx + 0.5 * dvx) * step, y + (vy + 0.5 * dvy) * step
        vx, vy = vx + dvx, vy + dvy
        mean = before.copy()
        mean[:GYROSCOPE_X] = x, y, yaw + turn, vx, vy, ax, ay, wz, tilt_x, tilt_y
        speed = math.hypot(vx, vy)
        decays = np.array([
            math.exp(-step * (speed * by_way + by_time)) for by_way, by_time in self._decays])
        mean[SENSORS:] *= decays
        _diagonal(transition)[SENSORS:] = decays
        return mean, transition


def _diagonal(matrix: np.ndarray) -> np.ndarray:
    """Return the diagonal of a square matrix as a view."""
    return matrix.reshape(-1)[::len(matrix) + 1]


@dataclass
class Wall:
    """What is known of the wall."""

    distance: float  #: from the rail at rest [m]; 0 is unknown


@dataclass
class WallSensor(ABC):
    """A sensor that measures one number of the rail's pose in front of the wall."""

    name: str
    axes: tuple[int, ...]  #: that it measures; nothing is expected before they have started
    noise: float  #: standard deviation of a measurement [m or rad]
    delay: float  #: how late the stamps are [s]
    lever: Sequence[float]  #: from the IMU to the sensor, along the rail's axes [m]
    wall: Wall
    largest: float = 20.0  #: m; a larger number has another unit
    states: tuple[SensorState, ...] = ()  #: its own
    first: int = 0  #: index of the first of these in the state vector

    @abstractmethod
    def observe(self, mean: Sequence[float]) -> tuple[float, np.ndarray]:
        """Return the expected measurement and its Jacobian in a state."""

    def expect(self, mean: Sequence[float], later: float) -> tuple[float, np.ndarray]:
        """Return the expected measurement a little later [s] and its Jacobian."""
        x, y, yaw, vx, vy, _, _, yaw_rate = mean[:TILT_X]
        expected, jacobian = self.observe(
            (x + later * vx, y + later * vy, yaw + later * yaw_rate, *mean[VX:]))
        by_x, by_y, by_yaw = jacobian[:VX].tolist()
        jacobian[VX], jacobian[VY], jacobian[YAW_RATE] = later * by_x, later * by_y, later * by_yaw
        return expected, jacobian


class DistanceSensor(WallSensor):
    """The distance of the wall along the rail's y."""

    def observe(self, mean: Sequence[float]) -> tuple[float, np.ndarray]:
        """Return (D − y) / cos ψ of the sensor's y, and its Jacobian."""
        (_, y, yaw), along, _ = pose_at(mean, self.lever)
        cosine = math.cos(yaw)
        distance = (self.wall.distance - y) / cosine
        jacobian = np.zeros(len(mean))
        jacobian[Y] = -1.0 / cosine
        jacobian[YAW] = distance * math.tan(yaw) - along / cosine
        jacobian[TILT_X] = self.lever[2] / cosine
        jacobian[self.first] = 1.0
        return distance + mean[self.first], jacobian


@dataclass
class FeatureSensor(WallSensor):
    """The place of a feature of the wall along the rail's x, seen from the sensor."""

    feature: float | None = None  #: place of the feature on the wall [m]; None is unknown

    def locate_feature(self, mean: Sequence[float], value: float) -> None:
        """Set the place of the feature by a measurement in a state."""
        (x, y, yaw), _, _ = pose_at(mean, self.lever)
        self.feature = x + (value - (self.wall.distance - y) * math.sin(yaw)) / math.cos(yaw)

    def observe(self, mean: Sequence[float]) -> tuple[float, np.ndarray]:
        """Return R(ψ)ᵀ (F − p) along x, and its Jacobian."""
        (x, y, yaw), _, _ = pose_at(mean, self.lever)
        cosine, sine = math.cos(yaw), math.sin(yaw)
        along, across = (self.feature or 0.0) - x, self.wall.distance - y
        jacobian = np.zeros(len(mean))
        jacobian[X], jacobian[Y] = -cosine, -sine
        jacobian[YAW] = cosine * across - sine * along + self.lever[1]
        jacobian[TILT_X], jacobian[TILT_Y] = sine * self.lever[2], -cosine * self.lever[2]
        jacobian[self.first] = 1.0
        return cosine * along + sine * across + mean[self.first], jacobian

    def expect(self, mean: Sequence[float], later: float) -> tuple[float, np.ndarray]:
        """Return the expected measurement, which shows the pose a delay ago, and its Jacobian."""
        delay = self.first + 1
        expected, jacobian = super().expect(mean, later - mean[delay])
        by_x, by_y, by_yaw = jacobian[:VX].tolist()
        jacobian[delay] = -by_x * mean[VX] - by_y * mean[VY] - by_yaw * mean[YAW_RATE]
        return expected, jacobian


class PoseSensor(WallSensor):
    """One axis of the pose of the rail's middle."""

    def observe(self, mean: Sequence[float]) -> tuple[float, np.ndarray]:
        """Return the rail's x, y or yaw, and its Jacobian."""
        axis, = self.axes
        pose, *_ = pose_at(mean, self.lever)
        return pose[axis], pose_jacobian(mean, self.lever)[axis]


def pose_at(
    mean: Sequence[float], lever: Sequence[float]
) -> tuple[tuple[float, float, float], float, float]:
    """Return the pose at a lever from the IMU [m, m, rad], and the lever along x and y [m]."""
    x, y, yaw, *_, tilt_x, tilt_y = mean[:TILT_Y + 1]
    sx, sy, sz = lever
    cosine, sine = math.cos(yaw), math.sin(yaw)
    along, across = cosine * sx - sine * sy, sine * sx + cosine * sy
    return (x + along + tilt_y * sz, y + across - tilt_x * sz, yaw), along, across


def pose_jacobian(mean: Sequence[float], lever: Sequence[float]) -> np.ndarray:
    """Return the derivative of the pose at a lever from the IMU, shape (3, n)."""
    _, along, across = pose_at(mean, lever)
    jacobian = np.zeros((3, len(mean)))
    jacobian[X, X] = jacobian[Y, Y] = jacobian[YAW, YAW] = 1.0
    jacobian[X, YAW], jacobian[Y, YAW] = -across, along
    jacobian[X, TILT_Y], jacobian[Y, TILT_X] = lever[2], -lever[2]
    return jacobian


def make_sensors(setup: EstimatorSetup, wall: Wall) -> list[WallSensor]:
    """Return the sensors of the wall, with their own states one after another."""
    def lever(*mounting: float) -> list[float]:
        return [there - here for there, here in zip(mounting, setup.imu.mounting, strict=False)]

    sensors: list[WallSensor] = []
    for name, one in setup.distances.items():
        place = SensorState(one.place_noise, PLACE_LENGTH)
        sensors.append(DistanceSensor(
            name, (Y, YAW), one.noise, one.delay, lever(*one.mounting), wall, states=(place,)))
    for name, fix in setup.fixes.items():
        place = SensorState(fix.place_noise, PLACE_LENGTH)
        delay = SensorState(fix.delay_error, time=DELAY_TIME)
        sensors.append(FeatureSensor(
            name, (X,), fix.noise, fix.delay, lever(*fix.mounting), wall, states=(place, delay),
            feature=fix.feature if fix.feature_known else None))
    for name, pose in setup.poses.items():
        noises = pose.position_noise, pose.position_noise, pose.yaw_noise
        sensors.extend(PoseSensor(f'{name}.{axis}', (index,), noise, pose.delay, lever(
            0.0, 0.0, 0.0), wall, math.inf) for index, (axis, noise) in enumerate(
                zip(Pose._fields, noises, strict=True)))
    first = SENSORS
    for sensor in sensors:
        sensor.first = first
        first += len(sensor.states)
    return sensors
