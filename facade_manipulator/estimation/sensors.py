"""What each sensor of the wall should measure in a state, and how that depends on the state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
import math

import numpy as np

from facade_manipulator.estimation.settings import (
    DistanceSettings,
    EstimatorSetup,
    FixSettings,
    PoseFixSettings,
    ProfileSettings,
)
from facade_manipulator.estimation.state import (
    FilterState,
    InertialInput,
    Innovation,
    RATE_Z,
    SENSORS,
    SensorState,
    TILT_X,
    TILT_Y,
    VX,
    VY,
    X,
    Y,
    YAW,
)
from facade_manipulator.kinematics import Pose

# s, over which the delay of stamps is about the same: of one that is never forgotten the filter
# becomes ever more certain, though what the model lacks looks like one
DELAY_TIME = 60.0
CELL = 0.02  # m, distance over which the error of a place on the wall is about the same


class Wall:
    """Where the wall and its features are, once that is known: by the settings or by the start."""

    def __init__(self, settings: ProfileSettings) -> None:
        self.settings = settings
        self.distance = settings.distance  #: 0 is not known


class WallSensor(ABC):
    """A sensor that measures one number of where the rail is before the wall."""

    #: states without which nothing can be expected of it, and which it starts
    axes: tuple[int, ...]
    scale = 1.0  #: of its measurements

    def __init__(
        self, name: str, noise: float, delay: float, mounting: Sequence[float],
        imu: Sequence[float], first: int, *states: SensorState,
    ) -> None:
        #: with the standard deviation of a measurement [m or rad], how late its stamp is [s], and
        #: the index from which on the states that it adds are the filter's
        self.name, self.noise, self.delay, self.first = name, noise, delay, first
        self.lever, self.states = _lever(mounting, imu), states

    @abstractmethod
    def expected(self, mean: np.ndarray, turning: float) -> tuple[float, np.ndarray]:
        """Return what it should measure while the yaw turns [rad/s], and the derivative."""


class DistanceSensor(WallSensor):
    """The distance of the wall along the rail's y."""

    axes = (Y, YAW)

    def __init__(
        self, name: str, settings: DistanceSettings, wall: Wall, imu: Sequence[float], first: int
    ) -> None:
        super().__init__(name, settings.noise, settings.delay, settings.mounting, imu, first,
                         SensorState(settings.place_noise, CELL))
        self.mounting, self._wall = settings.mounting, wall

    def expected(self, mean: np.ndarray, turning: float) -> tuple[float, np.ndarray]:
        """Return (D − y) / cos ψ of the sensor's y, and its derivative."""
        (_, y), cosine, sine = place(mean, self.lever)
        sx, sy, sz = self.lever
        distance = (self._wall.distance - y) / cosine
        direction = np.zeros(len(mean))
        direction[Y] = -1.0 / cosine
        direction[YAW] = distance * sine / cosine - sx + sy * sine / cosine
        direction[TILT_X] = sz / cosine
        direction[self.first] = 1.0
        return distance + float(mean[self.first]), direction


class FeatureSensor(WallSensor):
    """Where a feature of the wall is along the rail's x, seen from the sensor."""

    axes = (X,)

    def __init__(
        self, name: str, settings: FixSettings, wall: Wall, imu: Sequence[float], first: int
    ) -> None:
        super().__init__(name, settings.noise, settings.delay, settings.mounting, imu, first,
                         SensorState(settings.place_noise, CELL),
                         SensorState(settings.delay_error, math.inf, DELAY_TIME))
        self._wall = wall
        #: its place on the wall [m], known from the start on
        self.feature = settings.feature if settings.feature_known else None

    def expected(self, mean: np.ndarray, turning: float) -> tuple[float, np.ndarray]:
        """Return where the feature is along the sensor's x, and the derivative of that."""
        (x, y), cosine, sine = place(mean, self.lever)
        _, sy, sz = self.lever
        along, across = (self.feature or 0.0) - x, self._wall.distance - y
        direction = np.zeros(len(mean))
        direction[X], direction[Y] = -cosine, -sine
        direction[TILT_X], direction[TILT_Y] = sine * sz, -cosine * sz
        direction[YAW] = cosine * across - sine * along + sy
        rate = direction[X] * mean[VX] + direction[Y] * mean[VY] + direction[YAW] * turning
        direction[self.first], direction[self.first + 1] = 1.0, -rate
        expected = cosine * along + sine * across + mean[self.first]
        return float(expected - rate * mean[self.first + 1]), direction


class PoseSensor(WallSensor):
    """One axis of the rail's pose."""

    def __init__(
        self, name: str, axis: int, settings: PoseFixSettings, imu: Sequence[float]
    ) -> None:
        noise = settings.yaw_noise if axis == YAW else settings.position_noise
        super().__init__(
            f'{name}.{Pose._fields[axis]}', noise, settings.delay, (0.0, 0.0, 0.0), imu, 0)
        self.axes = (axis,)

    def expected(self, mean: np.ndarray, turning: float) -> tuple[float, np.ndarray]:
        """Return the rail's x, y or yaw, and its derivative."""
        value, jacobian = pose_at(mean, self.lever)
        axis, = self.axes
        return float(value[axis]), jacobian[axis]


def _lever(mounting: Sequence[float], imu: Sequence[float]) -> tuple[float, float, float]:
    """Return where something is from the inertial sensor, along the rail's axes [m]."""
    x, y, z = (there - here for there, here in zip(mounting[:3], imu[:3], strict=True))
    return x, y, z


def place(
    mean: np.ndarray, lever: tuple[float, float, float]
) -> tuple[tuple[float, float], float, float]:
    """Return where what is at a lever from the inertial sensor is, cosine and sine of the yaw."""
    x, y, yaw, _, _, tilt_x, tilt_y = mean[:TILT_Y + 1].tolist()
    sx, sy, sz = lever
    cosine, sine = math.cos(yaw), math.sin(yaw)
    return (x + cosine * sx - sine * sy + tilt_y * sz,
            y + sine * sx + cosine * sy - tilt_x * sz), cosine, sine


def pose_at(mean: np.ndarray, lever: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return x, y and yaw of what is at a lever from the inertial sensor, and the derivative."""
    (x, y), cosine, sine = place(mean, lever)
    sx, sy, sz = lever
    jacobian = np.zeros((3, len(mean)))
    jacobian[X, X] = jacobian[Y, Y] = jacobian[YAW, YAW] = 1.0
    jacobian[X, YAW], jacobian[Y, YAW] = -sine * sx - cosine * sy, cosine * sx - sine * sy
    jacobian[X, TILT_Y], jacobian[Y, TILT_X] = sz, -sz
    return np.array((x, y, mean[YAW])), jacobian


def innovation_of(
    sensor: WallSensor, state: FilterState, inertial: InertialInput, later: float, value: float,
    variance: float,
) -> Innovation:
    """Return what a measurement a little later [s] says, with the variance of its noise."""
    mean, covariance = state
    residual, direction = residual_of(sensor, mean, inertial, later, value)
    gain = covariance.dot(direction)  # of vectors in half of the time of @
    return Innovation(gain, max(float(gain.dot(direction)), 0.0) + variance, residual)


def residual_of(
    sensor: WallSensor, mean: np.ndarray, inertial: InertialInput, later: float, value: float
) -> tuple[float, np.ndarray]:
    """Return a measurement a little later [s] less what is expected, which has this derivative."""
    turning = inertial.rates[2] - mean[RATE_Z]
    expected, direction = sensor.expected(mean, turning)
    by_x, by_y, by_yaw = later * direction[X], later * direction[Y], later * direction[YAW]
    direction[VX], direction[VY], direction[RATE_Z] = by_x, by_y, -by_yaw
    return value - expected - (by_x * mean[VX] + by_y * mean[VY] + by_yaw * turning), direction


def make_sensors(setup: EstimatorSetup, wall: Wall) -> list[WallSensor]:
    """Return the sensors of the wall, their states one after the other."""
    imu, sensors = setup.imu.mounting, list[WallSensor]()

    def first() -> int:
        return SENSORS + sum(len(sensor.states) for sensor in sensors)

    for name, distance in setup.distances.items():
        sensors.append(DistanceSensor(name, distance, wall, imu, first()))
    for name, fix in setup.fixes.items():
        sensors.append(FeatureSensor(name, fix, wall, imu, first()))
    for name, pose in setup.poses.items():
        sensors.extend(PoseSensor(name, axis, pose, imu) for axis in (X, Y, YAW))
    return sensors
