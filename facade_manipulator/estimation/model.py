"""
Model of the filter: state vector, motion between two inputs of the IMU, and measurements.

The state is that of the IMU: position and velocity along the axes of `facade`, yaw ψ, acceleration
a along the axes of the rail, yaw rate, tilts θ about the rail's x and y, biases of gyroscopes and
accelerometers. The attitude is the turn ψ about z, then the turn (θ_x, θ_y, 0) about an axis in
the plane of the rail. Each sensor of the wall adds its own states: the error of the place that it
measures, and the unknown part of its delay. With the turning rates ω and the specific forces f of
the IMU less their biases, and without terms of higher order in θ,

    v̇ = R(ψ) a,  a = f + f_z (θ_y, −θ_x),  ψ̇ = ω_z + (θ_x ω_y − θ_y ω_x) / 2,
    θ̇_x = ω_x + ω_z θ_y,  θ̇_y = ω_y − ω_z θ_x.

Without an IMU the filter coasts: the yaw rate is a random walk, and acceleration and tilts are
Gauss-Markov processes about 0 (R. A. Singer, “Estimating optimal tracking filter performance for
manned maneuvering targets”, IEEE Trans. AES 6 (1970) 473–483).
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

(
    X,
    Y,
    YAW,
    VX,
    VY,
    AX,
    AY,
    YAW_RATE,
    TILT_X,
    TILT_Y,
    GYROSCOPE_X,
    GYROSCOPE_Y,
    GYROSCOPE_Z,
    ACCELEROMETER_X,
    ACCELEROMETER_Y,
) = range(15)
SENSORS = 15  # index of the first state of a sensor of the wall
RATES, TILTS = [VX, VY, YAW_RATE], slice(TILT_X, GYROSCOPE_X)
GYROSCOPES, ACCELEROMETERS = (
    slice(GYROSCOPE_X, ACCELEROMETER_X),
    slice(ACCELEROMETER_X, SENSORS),
)
WITH_IMU, COASTING = range(2)
# Variances of x, y, yaw and velocity when an axis starts:
POSE_ON_START, VELOCITY_ON_START = (0.015**2, 0.015**2, 0.05**2), 0.15**2
TILT, TILT_TIME = 3e-3, 1.0  # rad, s: standard deviation from level, correlation time
# Standard deviations of the biases at start. The filter also finds the biases of a consumer IMU,
# three times as large. It could not separate a larger accelerometer bias from tilt.
GYROSCOPE_BIAS, ACCELEROMETER_BIAS = 0.01, 0.1  # rad/s, m/s²
# Random walk of the biases: 10 °/h and 0.1 mg of an industrial IMU in the minutes of a warm-up
GYROSCOPE_WALK, ACCELEROMETER_WALK = 5e-6, 1e-4  # rad/s/√s, m/s²/√s
BANDWIDTH = (
    100.0  # Hz, of the noise in yaw rate and acceleration: about one divided by a step
)
# Without an IMU, of a gondola in gusts:
ACCELERATION, ACCELERATION_TIME = (
    0.12,
    0.6,
)  # m/s² and s: standard deviation, correlation time
YAW_ACCELERATION = 6e-3  # rad/s²/√Hz
# s, correlation time of the delay of a fix: for a constant delay the variance would fall to 0,
# although errors of the model look like a delay
DELAY_TIME = 60.0
PLACE_LENGTH = 0.02  # m, correlation length of the errors of places on the wall

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


def update(
    state: FilterState, cross: np.ndarray, variance: float, residual: float
) -> FilterState:
    """
    Return the state after a scalar measurement.

    `cross` is P Hᵀ, the covariance of state and measurement; `variance` is H P Hᵀ + R.
    """
    mean, covariance = state
    return FilterState(
        mean + cross * (residual / variance),
        covariance - np.multiply.outer(cross, cross / variance),
    )


class Process:
    """
    Motion of the state vector for one IMU and one set of sensors.

    In addition to the motion, states decay over time and distance, and process noise keeps their
    variances (Gauss-Markov processes). Accelerations and tilts decay only without an IMU.
    """

    def __init__(self, imu: ImuSettings, sensors: Sequence[SensorState]) -> None:
        self._variances = np.concatenate(
            [  # at the start
                POSE_ON_START,
                2 * [VELOCITY_ON_START],
                2 * [ACCELERATION**2],
                [1e-4],
                2 * [TILT**2],
                3 * [GYROSCOPE_BIAS**2],
                2 * [ACCELEROMETER_BIAS**2],
                [sensor.deviation**2 for sensor in sensors],
            ]
        )
        self._by_distance = np.zeros(len(self._variances))  # rates of the decay [1/m]
        self._by_distance[SENSORS:] = [1.0 / sensor.length for sensor in sensors]
        # rates of the decay [1/s] and process noise [per second], with an IMU and without
        self._by_time, self._walk = np.zeros((2, 2, len(self._variances)))
        self._by_time[:, SENSORS:] = [1.0 / sensor.time for sensor in sensors]
        self._by_time[COASTING, [AX, AY]] = 1.0 / ACCELERATION_TIME
        self._by_time[COASTING, TILTS] = 1.0 / TILT_TIME
        self._walk[:, GYROSCOPES] = GYROSCOPE_WALK**2
        self._walk[:, ACCELEROMETERS] = ACCELEROMETER_WALK**2
        self._walk[COASTING, YAW_RATE] = YAW_ACCELERATION**2
        self._walk[WITH_IMU, [YAW, TILT_X, TILT_Y]] = imu.gyroscope_noise**2
        self._walk[WITH_IMU, [VX, VY]] = imu.accelerometer_noise**2
        self._walk[WITH_IMU, YAW_RATE] = (BANDWIDTH * imu.gyroscope_noise) ** 2
        self._walk[WITH_IMU, [AX, AY]] = (BANDWIDTH * imu.accelerometer_noise) ** 2

    def initial_state(self) -> FilterState:
        """Return the state before the first measurement."""
        return FilterState(np.zeros(len(self._variances)), np.diag(self._variances))

    def forget(self, state: FilterState, axes: Sequence[int]) -> FilterState:
        """Return a state without knowledge of the given axes and their velocities."""
        kept = np.ones(len(self._variances))
        kept[[*axes, *(RATES[axis] for axis in axes)]] = 0.0
        return FilterState(
            kept * state.mean,
            np.outer(kept, kept) * state.covariance
            + np.diag((1.0 - kept) * self._variances),
        )

    def propagate(self, state: FilterState, imu: ImuInput, step: float) -> FilterState:
        """Return the state after a step [s] with the input of the IMU, if any."""
        mean, transition, noise = self.move(state.mean, imu, step)
        # dot() takes two thirds of the time of @.
        covariance: np.ndarray = transition.dot(state.covariance).dot(transition.T)
        covariance = 0.5 * (covariance + covariance.T)  # an asymmetric part would grow
        covariance.reshape(-1)[:: len(mean) + 1] += noise
        return FilterState(mean, covariance)

    def move(
        self, before: np.ndarray, imu: ImuInput, step: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return mean, transition matrix and variances of the process noise after a step [s]."""
        x, y, yaw, vx, vy, ax, ay, wz, tilt_x, tilt_y, *biases = before[
            :SENSORS
        ].tolist()
        mode = WITH_IMU if imu else COASTING
        decays = np.exp(
            -step * (math.hypot(vx, vy) * self._by_distance + self._by_time[mode])
        )
        noise = step * self._walk[mode] + self._variances * (1.0 - decays**2)
        mean, transition = decays * before, np.diag(decays)
        if imu:
            wx, wy, wz, fx, fy, fz = imu
            wx, wy, wz = wx - biases[0], wy - biases[1], wz - biases[2]
            ax, ay = fx - biases[3] + fz * tilt_y, fy - biases[4] - fz * tilt_x
        middle, turn = yaw + 0.5 * wz * step, wz * step
        cosine, sine = step * math.cos(middle), step * math.sin(middle)
        dvx, dvy = cosine * ax - sine * ay, sine * ax + cosine * ay
        transition[X, VX] = transition[Y, VY] = step
        transition[VX, YAW], transition[VY, YAW] = -dvy, dvx
        if imu:
            yaw += 0.5 * (tilt_x * wy - tilt_y * wx) * step
            mean[AX:GYROSCOPE_X] = (
                ax,
                ay,
                wz,
                tilt_x + wx * step + turn * tilt_y,
                tilt_y + wy * step - turn * tilt_x,
            )
            transition[YAW, GYROSCOPE_Z] = -step
            transition[VX, TILT_X], transition[VX, TILT_Y] = sine * fz, cosine * fz
            transition[VY, TILT_X], transition[VY, TILT_Y] = -cosine * fz, sine * fz
            transition[VX, ACCELEROMETER_X] = transition[VY, ACCELEROMETER_Y] = -cosine
            transition[VX, ACCELEROMETER_Y], transition[VY, ACCELEROMETER_X] = (
                sine,
                -sine,
            )
            transition[AX, AX] = transition[AY, AY] = transition[YAW_RATE, YAW_RATE] = (
                0.0
            )
            transition[AX, ACCELEROMETER_X] = transition[AY, ACCELEROMETER_Y] = -1.0
            transition[AX, TILT_Y], transition[AY, TILT_X] = fz, -fz
            transition[YAW_RATE, GYROSCOPE_Z] = -1.0
            transition[TILT_X, TILT_Y], transition[TILT_Y, TILT_X] = turn, -turn
            transition[TILT_X, GYROSCOPE_X] = transition[TILT_Y, GYROSCOPE_Y] = -step
        else:
            transition[YAW, YAW_RATE] = step
            transition[VX, AX], transition[VX, AY] = cosine, -sine
            transition[VY, AX], transition[VY, AY] = sine, cosine
        mean[:AX] = (
            x + (vx + 0.5 * dvx) * step,
            y + (vy + 0.5 * dvy) * step,
            yaw + turn,
            vx + dvx,
            vy + dvy,
        )
        return mean, transition, noise


@dataclass
class WallSensor(ABC):
    """
    Sensor that measures one number of its pose in front of the wall.

    A sensor may add states: the error of the measured place, then that of its delay.
    """

    name: str
    axes: tuple[
        int, ...
    ]  #: measured axes; the sensor is not used before they have started
    noise: float  #: standard deviation of a measurement [m or rad]
    delay: float  #: delay of the stamps [s]
    lever: Sequence[float]  #: from the IMU to the sensor, along the rail's axes [m]
    distance: float  #: of the wall from the rail at rest [m]; 0 is unknown
    first: int = SENSORS  #: index of the first state of the sensor in the state vector
    states: tuple[SensorState, ...] = ()  #: states that the sensor adds

    @abstractmethod
    def observe(self, x: float, y: float, yaw: float) -> tuple[float, Sequence[float]]:
        """Return the measurement at a pose of the sensor, and its derivatives by the pose."""

    def expect(self, mean: Sequence[float], later: float) -> tuple[float, np.ndarray]:
        """Return the expected measurement `later` [s] after a state, and its Jacobian."""
        x, y, yaw, vx, vy, _, _, yaw_rate, tilt_x, tilt_y = mean[:GYROSCOPE_X]
        own = slice(self.first, self.first + len(self.states))
        place, delay = (*mean[own], 0.0, 0.0)[:2]
        later -= delay
        yaw += later * yaw_rate
        sx, sy, sz = self.lever
        cosine, sine = math.cos(yaw), math.sin(yaw)
        along, across = cosine * sx - sine * sy, sine * sx + cosine * sy
        expected, (by_x, by_y, by_yaw) = self.observe(
            x + later * vx + along + tilt_y * sz,
            y + later * vy + across - tilt_x * sz,
            yaw,
        )
        by_yaw += by_y * along - by_x * across  # of the IMU
        jacobian = np.zeros(len(mean))
        jacobian[:GYROSCOPE_X] = (
            by_x,
            by_y,
            by_yaw,
            later * by_x,
            later * by_y,
            0.0,
            0.0,
            later * by_yaw,
            -sz * by_y,
            sz * by_x,
        )
        jacobian[own] = (1.0, -by_x * vx - by_y * vy - by_yaw * yaw_rate)[
            : len(self.states)
        ]
        return expected + place, jacobian

    def shift(self, mean: np.ndarray, value: float) -> float:
        """Return the change of the measured axis [m or rad] that explains a measurement."""
        expected, jacobian = self.expect(mean.tolist(), 0.0)
        return (value - expected) / float(jacobian[self.axes[0]])


class DistanceSensor(WallSensor):
    """Sensor of the distance D of the wall along the rail's y [m]."""

    def observe(self, x: float, y: float, yaw: float) -> tuple[float, Sequence[float]]:
        """Return (D − y) / cos ψ [m] and its derivatives."""
        cosine = math.cos(yaw)
        distance = (self.distance - y) / cosine
        return distance, (0.0, -1.0 / cosine, distance * math.tan(yaw))


@dataclass
class FeatureSensor(WallSensor):
    """Sensor of the place of a feature F of the wall along the rail's x."""

    feature: float = 0.0  #: place of the feature on the wall [m]; 0 is unknown

    def observe(self, x: float, y: float, yaw: float) -> tuple[float, Sequence[float]]:
        """Return R(ψ)ᵀ (F − p) along x [m] and its derivatives."""
        cosine, sine = math.cos(yaw), math.sin(yaw)
        along, across = self.feature - x, self.distance - y
        return (
            cosine * along + sine * across,
            (-cosine, -sine, cosine * across - sine * along),
        )


class PoseSensor(WallSensor):
    """Sensor of one axis of the pose of the rail's middle."""

    def observe(self, x: float, y: float, yaw: float) -> tuple[float, Sequence[float]]:
        """Return the rail's x, y [m] or yaw [rad] and its derivatives."""
        (axis,) = self.axes
        return (x, y, yaw)[axis], [float(k == axis) for k in (X, Y, YAW)]


def lever(imu: ImuSettings, mounting: Sequence[float]) -> list[float]:
    """Return the position of a sensor relative to the IMU [m]."""
    return [there - here for there, here in zip(mounting, imu.mounting, strict=False)]


def pose_sensors(
    name: str, noises: Sequence[float], delay: float, imu: ImuSettings
) -> list[WallSensor]:
    """Return the sensors of the rail's middle: x, y, yaw; noises [m, m, rad], delay [s]."""
    return [
        PoseSensor(
            f'{name}.{axis}', (index,), noise, delay, lever(imu, (0.0, 0.0, 0.0)), 0.0
        )
        for index, (axis, noise) in enumerate(zip(Pose._fields, noises, strict=True))
    ]


def make_sensors(setup: EstimatorSetup) -> list[WallSensor]:
    """Return the sensors of the wall, each with the index of its states."""
    sensors: list[WallSensor] = []
    for name, one in setup.distances.items():
        sensors.append(
            DistanceSensor(
                name,
                (Y, YAW),
                one.noise,
                one.delay,
                lever(setup.imu, one.mounting),
                setup.wall.distance,
                SENSORS + len(sensors),
                (SensorState(one.place_noise, PLACE_LENGTH),),
            )
        )
    for number, (name, fix) in enumerate(setup.fixes.items()):
        states = (
            SensorState(fix.place_noise, PLACE_LENGTH),
            SensorState(fix.delay_error, time=DELAY_TIME),
        )
        sensors.append(
            FeatureSensor(
                name,
                (X,),
                fix.noise,
                fix.delay,
                lever(setup.imu, fix.mounting),
                setup.wall.distance,
                SENSORS + len(setup.distances) + 2 * number,
                states,
                fix.feature,
            )
        )
    for name, pose in setup.poses.items():
        sensors += pose_sensors(name, pose.noise, pose.delay, setup.imu)
    return sensors
