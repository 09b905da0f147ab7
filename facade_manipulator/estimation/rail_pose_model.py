"""
Model of the filter: state vector, motion between IMU inputs, and measurements.

The state describes the IMU: position and velocity along the axes of `facade`, yaw ψ, acceleration
a along the axes of the rail, yaw rate, tilts θ about the rail's x and y, biases of gyroscopes and
accelerometers. The attitude is the turn ψ about z, then the turn (θ_x, θ_y, 0) about an axis in
the plane of the rail. A further state is the error of a wall distance that was found, because all
sensors of the wall share this error. Each sensor of the wall adds its own states: the error of the
place that it measures, and the unknown part of its delay. With the turning rates ω and the
specific forces f of the IMU less their biases, and without terms of higher order in θ,

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
from typing import ClassVar, NamedTuple

import numpy as np

from facade_manipulator.estimation.estimator_settings import EstimatorSetup, ImuSettings
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
    WALL,
) = range(16)
SENSORS = 16  # index of the first state of a sensor of the wall
RATES = [VX, VY, YAW_RATE]

#: Turning rates [rad/s] and specific forces [m/s²] along the rail's axes; None without an IMU.
ImuInput = tuple[float, ...] | None


class FilterState(NamedTuple):
    """Mean and covariance of the filter's state vector."""

    mean: np.ndarray
    covariance: np.ndarray


class SensorState(NamedTuple):
    """State of a sensor: standard deviation, correlation length [m] and correlation time [s]."""

    deviation: float
    length: float = math.inf
    time: float = math.inf


def update(
    state: FilterState,
    cross: np.ndarray,
    variance: float,
    residual: float,
    share: float = 1.0,
) -> FilterState:
    """
    Return the state after correction with a scalar measurement.

    `cross` is P Hᵀ, the covariance of state and measurement; `variance` is H P Hᵀ + R. `share` is
    the applied share of the covariance reduction that independent measurements would allow.
    """
    mean = state.mean + cross * (residual / variance)
    reduction = np.multiply.outer(cross, cross * (share / variance))
    return FilterState(mean, state.covariance - reduction)


class Process:
    """
    Process model of the state vector for one IMU and one set of sensors.

    In addition to the motion, states decay over time and distance, and process noise keeps their
    variances (Gauss-Markov processes). Accelerations and tilts decay only without an IMU.
    """

    TILTS = slice(TILT_X, GYROSCOPE_X)
    GYROSCOPES = slice(GYROSCOPE_X, ACCELEROMETER_X)
    ACCELEROMETERS = slice(ACCELEROMETER_X, WALL)
    WITH_IMU, WITHOUT_IMU = range(2)
    # Variances of x, y, yaw and velocity when an axis starts:
    POSE_ON_START = (0.015**2, 0.015**2, 0.05**2)
    VELOCITY_ON_START = 0.15**2
    # m², of a wall distance that is found beside a known y; the variance of this y is added
    WALL_ON_START = 0.015**2
    TILT = 3e-3  # rad, standard deviation from level
    TILT_TIME = 1.0  # s, correlation time of the tilts
    # Standard deviations of the biases at start. The filter also finds the biases of a consumer
    # IMU, three times as large. It could not separate a larger accelerometer bias from tilt.
    GYROSCOPE_BIAS_ON_START = 0.01  # rad/s
    ACCELEROMETER_BIAS_ON_START = 0.1  # m/s²
    # Random walk of the biases: 10 °/h and 0.1 mg of an industrial IMU in the minutes of a warm-up
    GYROSCOPE_WALK = 5e-6  # rad/s/√s
    ACCELEROMETER_WALK = 1e-4  # m/s²/√s
    # m/√s, of a wall distance that was found: a hoisted rail passes a wall that is not plane
    WALL_WALK = 5e-5
    # Hz, of the noise in yaw rate and acceleration: about one divided by a step
    BANDWIDTH = 100.0
    # Without an IMU, of a gondola in gusts:
    GUST_ACCELERATION = 0.12  # m/s², standard deviation
    ACCELERATION_TIME = 0.6  # s, correlation time
    YAW_ACCELERATION = 6e-3  # rad/s²/√Hz

    def __init__(self, imu: ImuSettings, sensors: Sequence[SensorState]) -> None:
        # variances at the start
        self._variances = np.zeros(SENSORS + len(sensors))
        self._variances[[X, Y, YAW]] = self.POSE_ON_START
        self._variances[[VX, VY]] = self.VELOCITY_ON_START
        self._variances[[AX, AY]] = self.GUST_ACCELERATION**2
        self._variances[YAW_RATE] = 1e-4
        self._variances[self.TILTS] = self.TILT**2
        self._variances[self.GYROSCOPES] = self.GYROSCOPE_BIAS_ON_START**2
        self._variances[self.ACCELEROMETERS] = self.ACCELEROMETER_BIAS_ON_START**2
        self._variances[WALL] = self.WALL_ON_START
        self._variances[SENSORS:] = [sensor.deviation**2 for sensor in sensors]

        # rates of the decay [1/m and 1/s], the latter with an IMU and without
        self._by_distance = np.zeros(len(self._variances))
        self._by_distance[SENSORS:] = [1.0 / sensor.length for sensor in sensors]
        self._by_time = np.zeros((2, len(self._variances)))
        self._by_time[:, SENSORS:] = [1.0 / sensor.time for sensor in sensors]
        self._by_time[self.WITHOUT_IMU, [AX, AY]] = 1.0 / self.ACCELERATION_TIME
        self._by_time[self.WITHOUT_IMU, self.TILTS] = 1.0 / self.TILT_TIME

        # process noise [per second], with an IMU and without
        self._walk = np.zeros((2, len(self._variances)))
        self._walk[:, self.GYROSCOPES] = self.GYROSCOPE_WALK**2
        self._walk[:, self.ACCELEROMETERS] = self.ACCELEROMETER_WALK**2
        self._walk[self.WITHOUT_IMU, YAW_RATE] = self.YAW_ACCELERATION**2
        self._walk[self.WITH_IMU, [YAW, TILT_X, TILT_Y]] = imu.gyroscope_noise**2
        self._walk[self.WITH_IMU, [VX, VY]] = imu.accelerometer_noise**2
        self._walk[self.WITH_IMU, YAW_RATE] = (
            self.BANDWIDTH * imu.gyroscope_noise
        ) ** 2
        self._walk[self.WITH_IMU, [AX, AY]] = (
            self.BANDWIDTH * imu.accelerometer_noise
        ) ** 2

        #: variances of the tilt rates [rad²/s²], measured by the IMU and without it
        self.tilt_rate_variances = (
            self.BANDWIDTH * imu.gyroscope_noise**2,
            (self.TILT / self.TILT_TIME) ** 2,
        )

    def initial_state(self) -> FilterState:
        """Return the initial state, before any measurement; the wall distance is exact."""
        covariance = np.diag(self._variances)
        covariance[WALL, WALL] = 0.0
        return FilterState(np.zeros(len(self._variances)), covariance)

    def forget(self, state: FilterState, axes: Sequence[int]) -> FilterState:
        """Return a state in which the given axes and their velocities are unknown."""
        return self._forget(state, [*axes, *(RATES[axis] for axis in axes)])

    def find_wall(self, state: FilterState, by_state: np.ndarray) -> FilterState:
        """
        Return a state after the wall distance was computed from the y of the rail.

        The distance contains the error of this y, of which `by_state` is the derivative by the
        state, and an error of its own.
        """
        state = self._forget(state, [WALL])
        cross = state.covariance.dot(by_state)
        state.covariance[WALL] += cross
        state.covariance[:, WALL] += cross
        state.covariance[WALL, WALL] += by_state.dot(cross)
        return state

    def _forget(self, state: FilterState, indices: Sequence[int]) -> FilterState:
        """Return a state in which the entries with the given indices are unknown."""
        kept = np.ones(len(self._variances))
        kept[indices] = 0.0
        covariance = np.outer(kept, kept) * state.covariance
        fresh = np.diag((1.0 - kept) * self._variances)
        return FilterState(kept * state.mean, covariance + fresh)

    def propagate(self, state: FilterState, imu: ImuInput, step: float) -> FilterState:
        """Return the state after a step [s] with the IMU input, if any."""
        mean, transition, noise = self.move(state.mean, imu, step)
        # dot() takes two thirds of the time of @.
        covariance: np.ndarray = transition.dot(state.covariance).dot(transition.T)
        covariance = 0.5 * (covariance + covariance.T)  # an asymmetric part would grow
        if state.covariance[WALL, WALL] > 0.0:  # otherwise the distance is exact
            noise[WALL] = step * self.WALL_WALK**2
        covariance.reshape(-1)[:: len(mean) + 1] += noise
        return FilterState(mean, covariance)

    def move(
        self, before: np.ndarray, imu: ImuInput, step: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return mean, transition matrix and process noise variances after a step [s]."""
        x, y, yaw, vx, vy, ax, ay, wz, tilt_x, tilt_y, *biases = before[:WALL].tolist()
        mode = self.WITH_IMU if imu else self.WITHOUT_IMU
        speed = math.hypot(vx, vy)
        decays = np.exp(-step * (speed * self._by_distance + self._by_time[mode]))
        noise = step * self._walk[mode] + self._variances * (1.0 - decays**2)
        mean = decays * before
        transition = np.diag(decays)

        # ψ̇ and a: measured by the IMU, or those of the state
        if imu:
            wx, wy, wz, fx, fy, fz = imu
            wx -= biases[0]
            wy -= biases[1]
            wz -= biases[2]
            ax = fx - biases[3] + fz * tilt_y
            ay = fy - biases[4] - fz * tilt_x
        turn = wz * step

        # v̇ = R(ψ) a, with ψ in the middle of the step
        middle = yaw + 0.5 * wz * step
        cosine = step * math.cos(middle)
        sine = step * math.sin(middle)
        dvx = cosine * ax - sine * ay
        dvy = sine * ax + cosine * ay
        transition[X, VX] = step
        transition[Y, VY] = step
        transition[VX, YAW] = -dvy
        transition[VY, YAW] = dvx

        if imu:
            _set_imu_derivatives(transition, step, turn, cosine, sine, fz)
            yaw += 0.5 * (tilt_x * wy - tilt_y * wx) * step
            mean[[AX, AY, YAW_RATE]] = (ax, ay, wz)
            mean[TILT_X] = tilt_x + wx * step + turn * tilt_y
            mean[TILT_Y] = tilt_y + wy * step - turn * tilt_x
        else:
            transition[YAW, YAW_RATE] = step
            transition[VX, AX] = cosine
            transition[VX, AY] = -sine
            transition[VY, AX] = sine
            transition[VY, AY] = cosine

        mean[X] = x + (vx + 0.5 * dvx) * step
        mean[Y] = y + (vy + 0.5 * dvy) * step
        mean[YAW] = yaw + turn
        mean[VX] = vx + dvx
        mean[VY] = vy + dvy
        return mean, transition, noise


def _set_imu_derivatives(
    transition: np.ndarray,
    step: float,
    turn: float,
    cosine: float,
    sine: float,
    fz: float,
) -> None:
    """Set the derivatives for biases and tilts in the transition matrix of a step [s]."""
    transition[YAW, GYROSCOPE_Z] = -step

    # v + R(ψ) a step: cosine and sine include the step
    transition[VX, TILT_X] = sine * fz
    transition[VX, TILT_Y] = cosine * fz
    transition[VY, TILT_X] = -cosine * fz
    transition[VY, TILT_Y] = sine * fz
    transition[VX, ACCELEROMETER_X] = -cosine
    transition[VX, ACCELEROMETER_Y] = sine
    transition[VY, ACCELEROMETER_X] = -sine
    transition[VY, ACCELEROMETER_Y] = -cosine

    # a = f + f_z (θ_y, −θ_x) and ω_z are measured again
    transition[AX, AX] = 0.0
    transition[AY, AY] = 0.0
    transition[YAW_RATE, YAW_RATE] = 0.0
    transition[AX, ACCELEROMETER_X] = -1.0
    transition[AY, ACCELEROMETER_Y] = -1.0
    transition[AX, TILT_Y] = fz
    transition[AY, TILT_X] = -fz
    transition[YAW_RATE, GYROSCOPE_Z] = -1.0

    # θ + (ω_x + ω_z θ_y, ω_y − ω_z θ_x) step
    transition[TILT_X, TILT_Y] = turn
    transition[TILT_Y, TILT_X] = -turn
    transition[TILT_X, GYROSCOPE_X] = -step
    transition[TILT_Y, GYROSCOPE_Y] = -step


@dataclass
class WallSensor(ABC):
    """
    Sensor that measures one scalar, which depends on the sensor's pose relative to the wall.

    A sensor may add states: the error of the measured place, then the error of the delay.
    """

    #: whether the measurement depends on the distance of the wall
    is_relative_to_wall: ClassVar[bool] = True

    name: str
    axes: tuple[int, ...]  #: measured; the sensor is not used before they have started
    noise: float  #: standard deviation of a measurement [m or rad]
    delay: float  #: delay of the stamps [s]
    lever: Sequence[float]  #: from the IMU to the sensor, along the rail's axes [m]
    distance: float  #: of the wall from the rail at rest [m]; 0 is unknown
    first: int = SENSORS  #: index of the first state of the sensor in the state vector
    states: tuple[SensorState, ...] = ()  #: states that the sensor adds

    def forget_place(self) -> None:
        """Forget the place on the wall that the sensor measures."""
        self.distance = 0.0

    @abstractmethod
    def observe(self, x: float, y: float, yaw: float) -> tuple[float, Sequence[float]]:
        """Return the measurement and its derivatives for a sensor pose [m, m, rad]."""

    def expect(
        self, mean: Sequence[float], time_offset: float
    ) -> tuple[float, np.ndarray]:
        """
        Return the expected measurement [m or rad] and its Jacobian for the whole state.

        The measurement is `time_offset` after the state [s], or before it if negative: the rail
        moves with constant velocity and yaw rate in between. The caller has subtracted the known
        `delay`; a delay that is a state is subtracted here.
        """
        x, y, yaw, vx, vy, _, _, yaw_rate, tilt_x, tilt_y = mean[:GYROSCOPE_X]
        own = slice(self.first, self.first + len(self.states))
        # the states of this sensor, 0 where it has none
        place_error, unknown_delay = (*mean[own], 0.0, 0.0)[:2]
        elapsed = time_offset - unknown_delay
        yaw += elapsed * yaw_rate
        wall = mean[WALL] if self.is_relative_to_wall else 0.0

        # pose of the sensor: p + R(ψ) (lever + tilts × lever)
        sx, sy, sz = self.lever
        sx += tilt_y * sz
        sy -= tilt_x * sz
        cosine = math.cos(yaw)
        sine = math.sin(yaw)
        along = cosine * sx - sine * sy
        across = sine * sx + cosine * sy
        expected, (by_x, by_y, by_yaw) = self.observe(
            x + elapsed * vx + along, y + elapsed * vy + across - wall, yaw
        )
        # the state is the pose of the IMU: its yaw also moves the sensor along an arc
        by_yaw += by_y * along - by_x * across

        jacobian = np.zeros(len(mean))
        jacobian[[X, Y, YAW]] = (by_x, by_y, by_yaw)
        jacobian[RATES] = (elapsed * by_x, elapsed * by_y, elapsed * by_yaw)
        jacobian[TILT_X] = sz * (sine * by_x - cosine * by_y)
        jacobian[TILT_Y] = sz * (cosine * by_x + sine * by_y)
        # a wall that is farther away acts like a rail that is farther from the wall
        jacobian[WALL] = -by_y if self.is_relative_to_wall else 0.0
        by_delay = -by_x * vx - by_y * vy - by_yaw * yaw_rate
        jacobian[own] = (1.0, by_delay)[: len(self.states)]
        return expected + place_error, jacobian

    def shift(self, mean: np.ndarray, value: float) -> float:
        """Return by how much the measured axis must change to explain a measurement [m or rad]."""
        expected, jacobian = self.expect(mean.tolist(), 0.0)
        return (value - expected) / float(jacobian[self.axes[0]])


class DistanceSensor(WallSensor):
    """Sensor of the wall distance D along the rail's y [m]."""

    def observe(self, x: float, y: float, yaw: float) -> tuple[float, Sequence[float]]:
        """Return (D − y) / cos ψ [m] and its derivatives."""
        cosine = math.cos(yaw)
        distance = (self.distance - y) / cosine
        return distance, (0.0, -1.0 / cosine, distance * math.tan(yaw))


@dataclass
class FeatureSensor(WallSensor):
    """Sensor of the position of a wall feature F along the rail's x."""

    feature: float = 0.0  #: place of the feature on the wall [m]; 0 is unknown

    def forget_place(self) -> None:
        """Forget the place of the feature."""
        self.feature = 0.0

    def observe(self, x: float, y: float, yaw: float) -> tuple[float, Sequence[float]]:
        """Return R(ψ)ᵀ (F − p) along x [m] and its derivatives."""
        cosine = math.cos(yaw)
        sine = math.sin(yaw)
        along = self.feature - x
        across = self.distance - y
        by_yaw = cosine * across - sine * along
        return cosine * along + sine * across, (-cosine, -sine, by_yaw)


class PoseSensor(WallSensor):
    """Sensor of one axis of the pose of the rail's midpoint."""

    is_relative_to_wall = False

    def observe(self, x: float, y: float, yaw: float) -> tuple[float, Sequence[float]]:
        """Return the rail's x, y [m] or yaw [rad] and its derivatives."""
        (axis,) = self.axes
        derivatives = [0.0, 0.0, 0.0]
        derivatives[axis] = 1.0
        return (x, y, yaw)[axis], derivatives


def lever(imu: ImuSettings, mounting: Sequence[float]) -> list[float]:
    """Return the position of a sensor relative to the IMU [m]."""
    return [there - here for there, here in zip(mounting, imu.mounting, strict=False)]


def pose_sensors(
    name: str, noises: Sequence[float], delay: float, imu: ImuSettings
) -> list[WallSensor]:
    """Return the sensors of x, y and yaw of the rail's midpoint; noises [m, m, rad], delay [s]."""
    place = lever(imu, (0.0, 0.0, 0.0))
    sensors: list[WallSensor] = []
    for axis, noise in enumerate(noises):
        full_name = f'{name}.{Pose._fields[axis]}'
        sensors.append(PoseSensor(full_name, (axis,), noise, delay, place, 0.0))
    return sensors


# s, correlation time of the delay of a fix: for a constant delay the variance would fall to 0,
# although model errors act like a delay
DELAY_TIME = 60.0
PLACE_LENGTH = 0.02  # m, correlation length of the errors of places on the wall


def make_sensors(setup: EstimatorSetup) -> list[WallSensor]:
    """Return all wall sensors, each with the indices of its states."""
    sensors: list[WallSensor] = []
    first = SENSORS  # index of the next sensor's first state
    for name, one in setup.distances.items():
        place = SensorState(one.place_noise, PLACE_LENGTH)
        sensors.append(
            DistanceSensor(
                name=name,
                axes=(Y, YAW),
                noise=one.noise,
                delay=one.delay,
                lever=lever(setup.imu, one.mounting),
                distance=setup.wall.distance,
                first=first,
                states=(place,),
            )
        )
        first += 1

    for name, fix in setup.fixes.items():
        place = SensorState(fix.place_noise, PLACE_LENGTH)
        delay = SensorState(fix.delay_error, time=DELAY_TIME)
        sensors.append(
            FeatureSensor(
                name=name,
                axes=(X,),
                noise=fix.noise,
                delay=fix.delay,
                lever=lever(setup.imu, fix.mounting),
                distance=setup.wall.distance,
                first=first,
                states=(place, delay),
                feature=fix.feature,
            )
        )
        first += 2

    for name, pose in setup.poses.items():
        sensors += pose_sensors(name, pose.noise, pose.delay, setup.imu)
    return sensors
