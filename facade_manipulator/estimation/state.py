"""
The state of the filter, its motion from one inertial measurement to the next, its corrections.

The state is that of the inertial sensor, along the axes of `facade` and turned to those of the
rail: position, yaw and velocity, tilts about the rail's x and y, offsets of the gyroscopes and of
the accelerometers, then what each sensor of the wall adds: the error of the place that it looks
at, or what is not known of its delay. With turning rates ω, accelerations f, both less their
offsets, yaw ψ and tilts θ,

    v̇ = R(ψ) (f + f_z (θ_y, −θ_x)),  ψ̇ = ω_z + θ_x ω_y − θ_y ω_x,
    θ̇_x = ω_x + ω_z θ_y,  θ̇_y = ω_y − ω_z θ_x.

Without an inertial sensor the same equations hold for ω = f = 0, with offsets that are less yaw
rate and acceleration and change at random, the accelerations back to 0 (R. A. Singer, “Estimating
optimal tracking filter performance for manned maneuvering targets”, IEEE Trans. AES 6 (1970)
473–483).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from facade_manipulator.estimation.settings import ImuSettings

X, Y, YAW, VX, VY, TILT_X, TILT_Y, RATE_X, RATE_Y, RATE_Z, FORCE_X, FORCE_Y = range(12)
POSE, OFFSETS = slice(X, YAW + 1), slice(RATE_X, FORCE_Y + 1)
SENSORS = 12  # from here on the states of sensors of the wall
TILT_DEVIATION = 3e-3  # rad, standard deviation of the tilt of the inertial sensor at start
# How offsets wander: an industrial sensor's by 10 °/h and 0.1 mg in the minutes of a warm-up.
RATE_WALK, FORCE_WALK = 5e-6, 1e-4  # rad/s/√s, m/s²/√s
# Without an inertial sensor, of a gondola in gusts:
ACCELERATION, MEMORY = 0.12, 0.6  # m/s² and s: standard deviation, and how long it lasts
TURNING = 6e-3  # rad/s²/√Hz, of the yaw's acceleration
SWING, SWING_TIME = 5e-3, 1.0  # rad and s, likewise of the tilts


class FilterState(NamedTuple):
    """Mean and covariance."""

    mean: np.ndarray
    covariance: np.ndarray


class Innovation(NamedTuple):
    """What a measurement says beyond what was expected, and makes of the state."""

    gain: np.ndarray  #: covariance of the state and the measurement
    variance: float  #: of the residual
    residual: float

    def applied(self, state: FilterState) -> FilterState:
        """Return the state with the measurement."""
        mean, covariance = state
        return FilterState(mean + self.gain * (self.residual / self.variance),
                           covariance - np.multiply.outer(self.gain, self.gain / self.variance))


class InertialInput(NamedTuple):
    """Turning rates [rad/s] and accelerations [m/s²] along the rail's axes over a step."""

    rates: tuple[float, float, float]
    forces: tuple[float, float, float]
    measured: bool = True


def mean_input(one: InertialInput, other: InertialInput, share: float = 0.5) -> InertialInput:
    """Return the mean of two inputs, of which the other one has a share of the time."""
    (ax, ay, az), (bx, by, bz) = one.rates, other.rates
    (cx, cy, cz), (dx, dy, dz) = one.forces, other.forces
    rest = 1.0 - share
    return InertialInput(
        (rest * ax + share * bx, rest * ay + share * by, rest * az + share * bz),
        (rest * cx + share * dx, rest * cy + share * dy, rest * cz + share * dz))


# Where the derivative of the motion is not 0, row and column: see `Process`
COUPLED = np.array((
    (X, VX), (Y, VY), (YAW, RATE_Z), (VX, YAW), (VX, TILT_X), (VX, TILT_Y), (VX, FORCE_X),
    (VX, FORCE_Y), (VY, YAW), (VY, TILT_X), (VY, TILT_Y), (VY, FORCE_X), (VY, FORCE_Y),
    (TILT_X, TILT_Y), (TILT_X, RATE_X), (TILT_Y, TILT_X), (TILT_Y, RATE_Y)))
COASTING_STATES = [TILT_X, TILT_Y, FORCE_X, FORCE_Y]  # which decay without an inertial sensor
COASTING_TIMES = np.array((SWING_TIME, SWING_TIME, MEMORY, MEMORY))
COASTING = InertialInput((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), False)


class SensorState(NamedTuple):
    """A state of a sensor of the wall: the error of a place, or what is not known of a delay."""

    deviation: float
    cell: float  #: over which it is about the same [m]
    time: float = math.inf  #: likewise [s]


class Process:
    """The motion of the state, of one set of sensors."""

    def __init__(self, imu: ImuSettings, sensors: list[SensorState]) -> None:
        self._imu = imu
        self.size = SENSORS + len(sensors)
        self._own = np.array([sensor.deviation for sensor in sensors]) ** 2
        self._decays = [(1.0 / sensor.cell, 1.0 / sensor.time) for sensor in sensors]
        self._identity = np.eye(self.size)
        self._coupled = COUPLED @ (self.size, 1)  # in a transition as one row
        self._walk = {True: self._measured_walk(imu), False: self._coasting_walk()}
        self._offset_variances = np.array(
            3 * [imu.gyroscope_bias ** 2] + 2 * [imu.accelerometer_bias ** 2])

    def _measured_walk(self, imu: ImuSettings) -> np.ndarray:
        walk = np.zeros(self.size)
        walk[[YAW, TILT_X, TILT_Y]] = imu.gyroscope_noise ** 2
        walk[[VX, VY]] = imu.accelerometer_noise ** 2
        walk[RATE_X:RATE_Z + 1], walk[FORCE_X:SENSORS] = RATE_WALK ** 2, FORCE_WALK ** 2
        return walk

    def _coasting_walk(self) -> np.ndarray:
        walk = np.zeros(self.size)
        walk[[TILT_X, TILT_Y]] = 2.0 * SWING ** 2 / SWING_TIME
        walk[[FORCE_X, FORCE_Y]] = 2.0 * ACCELERATION ** 2 / MEMORY
        walk[RATE_Z] = TURNING ** 2
        return walk

    def unknown(self) -> FilterState:
        """Return the state before anything is known, of a filter that coasts."""
        variances = np.concatenate([
            (1.0, 1.0, 0.1, 0.1, 0.1), 2 * [TILT_DEVIATION ** 2], np.zeros(5), self._own])
        variances[[RATE_Z, FORCE_X, FORCE_Y]] = 1e-4, ACCELERATION ** 2, ACCELERATION ** 2
        return FilterState(np.zeros(self.size), np.diag(variances))

    def unknown_offsets(self) -> FilterState:
        """Return the offsets of the inertial sensor before anything is known of them."""
        return FilterState(np.zeros(5), self._offset_variances)

    @staticmethod
    def offsets_of(state: FilterState) -> FilterState:
        """Return the offsets of the inertial sensor and their variances."""
        return FilterState(state.mean[OFFSETS].copy(), np.diag(state.covariance)[OFFSETS].copy())

    def advanced(
        self, state: FilterState, inertial: InertialInput, step: float
    ) -> FilterState:
        """Return the state a time [s] later."""
        mean, transition = self.moved(state.mean, inertial, step)
        covariance: np.ndarray = transition @ state.covariance @ transition.T
        covariance = 0.5 * (covariance + covariance.T)  # what differs would grow without bound
        noise = self._walk[inertial.measured] * step
        noise[SENSORS:] = self._own * (1.0 - diagonal(transition)[SENSORS:] ** 2)
        variances = diagonal(covariance)
        variances += noise
        return FilterState(mean, covariance)

    def moved(
        self, before: np.ndarray, inertial: InertialInput, step: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean a time [s] later and the transition to it."""
        (_, _, yaw, vx, vy, tilt_x, tilt_y, ox, oy, oz, fox, foy) = before[:SENSORS].tolist()
        (rx, ry, rz), (fx, fy, fz) = inertial.rates, inertial.forces
        rx, ry, rz = rx - ox, ry - oy, rz - oz
        fx, fy = fx - fox + fz * tilt_y, fy - foy - fz * tilt_x
        cosine, sine = step * math.cos(yaw + 0.5 * rz * step), step * math.sin(
            yaw + 0.5 * rz * step)
        ax, ay, turned = cosine * fx - sine * fy, sine * fx + cosine * fy, rz * step
        mean = before.copy()
        mean[:RATE_X] += (
            (vx + 0.5 * ax) * step, (vy + 0.5 * ay) * step,
            (rz + tilt_x * ry - tilt_y * rx) * step, ax, ay,
            (rx + rz * tilt_y) * step, (ry - rz * tilt_x) * step)
        transition = self._identity.copy()
        transition.reshape(-1)[self._coupled] = (
            step, step, -step, -ay, sine * fz, cosine * fz, -cosine, sine,
            ax, -cosine * fz, sine * fz, -sine, -cosine, turned, -step, -turned, -step)
        if not inertial.measured:
            decay = np.exp(-step / COASTING_TIMES)
            mean[COASTING_STATES] *= decay
            transition[COASTING_STATES] *= decay[:, None]
        speed = math.hypot(mean[VX], mean[VY])
        kept = np.array([
            math.exp(-step * (speed * by_way + by_time)) for by_way, by_time in self._decays])
        mean[SENSORS:] *= kept
        diagonal(transition)[SENSORS:] = kept
        return mean, transition

    def without_imu(self, state: FilterState, last: InertialInput) -> FilterState:
        """Return the state with the rail's own yaw rate and acceleration in place of offsets."""
        mean, covariance = state.mean.copy(), state.covariance.copy()
        _, _, offset, ox, oy = mean[OFFSETS]
        (fx, fy, fz), (tilt_x, tilt_y) = last.forces, mean[TILT_X:TILT_Y + 1]
        forget(covariance, OFFSETS, np.array(
            (0.0, 0.0, (10.0 * self._imu.gyroscope_noise) ** 2, *2 * [0.05 ** 2])))
        mean[OFFSETS] = 0.0, 0.0, offset - last.rates[2], ox - fx - fz * tilt_y, (
            oy - fy + fz * tilt_x)
        return FilterState(mean, covariance)

    def with_imu(self, state: FilterState, offsets: FilterState) -> FilterState:
        """Return the state with what was known of the offsets of the inertial sensor."""
        mean, covariance = state.mean.copy(), state.covariance.copy()
        forget(covariance, OFFSETS, offsets.covariance)
        forget(covariance, slice(TILT_X, TILT_Y + 1), TILT_DEVIATION ** 2)
        mean[OFFSETS], mean[TILT_X:TILT_Y + 1] = offsets.mean, 0.0
        return FilterState(mean, covariance)


def forget(covariance: np.ndarray, part: slice, variances: np.ndarray | float) -> None:
    """Give a part of the state these variances, in place, and no correlation with the others."""
    covariance[part] = covariance[:, part] = 0.0
    indices = range(*part.indices(len(covariance)))
    covariance[indices, indices] = variances


def diagonal(matrix: np.ndarray) -> np.ndarray:
    """Return the diagonal of a square matrix, to be changed in place."""
    return matrix.reshape(-1)[::len(matrix) + 1]
