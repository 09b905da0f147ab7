"""Sensors as there are: an estimator of the disturbance, noisy, late and lying; a force sensor."""

from __future__ import annotations

import heapq
import math

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Pose, Wrench
from facade_manipulator.lab.gondola.motion import Motion
from facade_manipulator.parameters import inherited, parameter, settings
from facade_manipulator.prediction.estimate import Estimate, EstimateSettings, Variances
from facade_manipulator.prediction.mounting import estimator_motion


@settings
class EstimatorSettings:
    """How often, how late and how well the disturbance is estimated."""

    rate: float = parameter(
        'Rate of estimates', default=50.0, unit='Hz', minimum=0.1, maximum=1000.0)
    latency: float = parameter(
        'Mean age of an estimate when it comes', default=0.05, unit='s', minimum=0.0, maximum=5.0)
    jitter: float = parameter(
        'The age varies by plus or minus this', default=0.01, unit='s', minimum=0.0, maximum=5.0)
    position_noise: float = parameter(
        'Standard deviation of x and y', default=1e-3, unit='m', minimum=0.0, maximum=1.0)
    yaw_noise: float = parameter(
        'Standard deviation of the yaw', default=1.7453e-3, unit='rad', minimum=0.0, maximum=1.0)
    correlation: float = parameter(
        'Time over which the noise is correlated, as a filter makes it', default=0.0, unit='s',
        minimum=0.0, maximum=10.0)
    drift: float = parameter(
        'Speed at which the estimate of x wanders off', default=0.0, unit='m/s', minimum=-0.1,
        maximum=0.1)
    scale: float = parameter(
        'What it takes the motion times, 1 if it is right', default=1.0, minimum=0.1, maximum=10.0)
    lie_period: float = parameter(
        'Time from one lie to the next, 0 if it never lies', default=0.0, unit='s', minimum=0.0)
    lie_durations: tuple[float, ...] = parameter(
        'How long lies last, one after the other', default=(0.06, 0.1, 0.2), unit='s',
        minimum=0.0, maximum=60.0)
    lie_scale: tuple[float, ...] = parameter(
        'What it takes x, y and yaw times meanwhile', default=(1.0, 1.0, 1.0), minimum=-10.0,
        maximum=10.0, elements=Pose._fields)
    lie_offset: tuple[float, ...] = parameter(
        'What it adds to them meanwhile', default=(0.0, 0.0, 0.0), unit='m, m, rad',
        minimum=-10.0, maximum=10.0, elements=Pose._fields)
    loss: float = parameter(
        'Share of estimates that never come', default=0.0, minimum=0.0, maximum=1.0)
    silent_from: float = parameter(
        'When a silence begins, counted from the start', default=0.0, unit='s', minimum=0.0)
    silent_for: float = parameter('How long it lasts', default=0.0, unit='s', minimum=0.0)
    mounting: tuple[float, ...] = inherited(EstimateSettings, 'mounting', default=(0.0, 0.0, 0.0))
    axes: float = inherited(EstimateSettings, 'axes', default=0.0)
    stamp_error: float = inherited(EstimateSettings, 'delay', default=0.0)
    seed: int = parameter('Seed of noise, jitter and losses', default=1, minimum=0)

    def __post_init__(self) -> None:
        if self.jitter > self.latency:
            raise ParameterError(
                f'jitter = {self.jitter:g} s is above latency = {self.latency:g} s: estimates '
                'would come from the future')

    def lies(self, elapsed: float) -> bool:
        """Return whether it lies at a time since the start [s]."""
        if not self.lie_period:
            return False
        number, since = divmod(elapsed, self.lie_period)
        return number > 0.0 and since < self.lie_durations[
            (int(number) - 1) % len(self.lie_durations)]

    def variances(self) -> Variances:
        """Return the variances of x, y and yaw."""
        return Variances(self.position_noise ** 2, self.position_noise ** 2, self.yaw_noise ** 2)


class SimulatedEstimator:
    """Estimate a motion from a start on [s]."""

    def __init__(self, settings: EstimatorSettings, motion: Motion, start: float) -> None:
        self._settings = settings
        self._motion = motion
        self._start = start
        self._taken = 0
        self._random = np.random.default_rng(settings.seed)
        self._deviation = np.sqrt(np.array(settings.variances()))
        self._noise = np.zeros(len(Pose._fields))
        self._under_way: list[tuple[float, float, np.ndarray]] = []

    def advance(self, now: float) -> list[Estimate]:
        """Return the estimates that have come by now [s], in the order of their arrival."""
        while (stamp := self._start + self._taken / self._settings.rate) <= now:
            self._taken += 1
            self._receive(stamp)
        arrived, settings = [], self._settings
        while self._under_way and self._under_way[0][0] <= now:
            _, stamp, noise = heapq.heappop(self._under_way)
            # looked up only now: the motion of the stamp is certain once the head has moved there
            motion = estimator_motion(
                self._motion(stamp), Pose(*settings.mounting), settings.axes)
            seen: np.ndarray = settings.scale * np.array(motion)
            if settings.lies(stamp - self._start):
                seen = seen * settings.lie_scale + settings.lie_offset
            pose = Pose(*(seen + noise).tolist())
            arrived.append(Estimate(stamp + settings.stamp_error, pose, settings.variances()))
        return arrived

    def _receive(self, stamp: float) -> None:
        settings = self._settings
        fresh, alike = self._random.standard_normal(len(Pose._fields)), 0.0
        if settings.correlation:
            alike = math.exp(-1.0 / (settings.rate * settings.correlation))
        self._noise = alike * self._noise + math.sqrt(1.0 - alike ** 2) * fresh
        noise = self._deviation * self._noise
        delay = settings.latency + settings.jitter * self._random.uniform(-1.0, 1.0)
        lost = self._random.random() < settings.loss
        silent = 0.0 <= stamp - self._start - settings.silent_from < settings.silent_for
        if not lost and not silent:
            noise[0] += settings.drift * (stamp - self._start)
            heapq.heappush(self._under_way, (stamp + delay, stamp, noise))


@settings
class ForceSensorSettings:
    """How well the sensor measures the wrench on the head."""

    force_noise: float = parameter(
        'Standard deviation of the forces', default=0.5, unit='N', minimum=0.0, maximum=100.0)
    moment_noise: float = parameter(
        'Standard deviation of the moment', default=0.05, unit='N m', minimum=0.0, maximum=100.0)
    seed: int = parameter('Seed of the noise', default=1, minimum=0)


class ForceSensor:
    """Measure the wrench of the wall on the head."""

    def __init__(self, settings: ForceSensorSettings) -> None:
        self._random = np.random.default_rng(settings.seed)
        self._deviation = (settings.force_noise, settings.force_noise, settings.moment_noise)

    def measure(self, wrench: Wrench) -> Wrench:
        """Return what the sensor shows of a wrench."""
        return Wrench(*self._random.normal(wrench, self._deviation).tolist())
