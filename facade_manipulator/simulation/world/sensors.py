"""Sensors with noise and delay: an estimator of the disturbance, and raw sensors of MuJoCo."""

from __future__ import annotations

import heapq
import math
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction import Estimate, Variances
from facade_manipulator.simulation.world.scenario import Estimator, Sensors

WAVES = 40  # of which the errors of places on the wall are made
WAVELENGTHS = (0.03, 0.3)  # m
Item = TypeVar('Item')


class DelayedQueue(Generic[Item]):
    """Measurements on their way."""

    def __init__(self) -> None:
        self._queue: list[tuple[float, int, Item]] = []
        self._count = 0  # keeps the order of simultaneous arrivals

    def send(self, arrival: float, item: Item) -> None:
        """Let a measurement arrive at a time [s]."""
        heapq.heappush(self._queue, (arrival, self._count, item))
        self._count += 1

    def receive(self, now: float) -> list[Item]:
        """Return what has arrived by now [s], in the order of arrival."""
        arrived = []
        while self._queue and self._queue[0][0] <= now:
            arrived.append(heapq.heappop(self._queue)[2])
        return arrived


class SimulatedEstimator:
    """Estimates of the disturbance: noisy, late, sometimes lost or wrong."""

    def __init__(self, settings: Estimator, start: float, random: np.random.Generator) -> None:
        self.queue: DelayedQueue[Estimate] = DelayedQueue()
        self._settings, self._start, self._random = settings, start, random
        position, yaw = settings.position_noise ** 2, settings.yaw_noise ** 2
        self._variances = Variances(position, position, yaw)

    def sample(self, stamp: float, rail: Pose) -> None:
        """Estimate the rail's true pose at a stamp [s]."""
        settings, elapsed = self._settings, stamp - self._start
        delay = settings.latency + settings.jitter * self._random.uniform(-1.0, 1.0)
        pose = np.array(rail)
        if self.is_wrong(elapsed):
            pose = pose * settings.wrong_scale + settings.wrong_offset
        pose = self._random.normal(pose, np.sqrt(self._variances))
        is_silent = 0.0 <= elapsed - settings.silent_from < settings.silent_for
        if self._random.random() >= settings.loss and not is_silent:
            self.queue.send(stamp + delay, Estimate(stamp, Pose(*pose.tolist()), self._variances))

    def is_wrong(self, elapsed: float) -> bool:
        """Return whether estimates are wrong at a time since the start [s]."""
        number, since = divmod(elapsed, self._settings.wrong_every)
        durations = self._settings.wrong_for
        return number > 0.0 and since < durations[(int(number) - 1) % len(durations)]


class Measurement(NamedTuple):
    """What a raw sensor sends: a length, or rates and accelerations about and along x, y, z."""

    sensor: str  #: ``'imu'``, ``'range_1'``, ``'range_2'`` or ``'fix_x'``
    stamp: float  #: [s]
    values: tuple[float, ...]  #: [m] or [rad/s, m/s²]


class RawSensors:
    """An inertial sensor, two distance sensors and a camera that sees a mark."""

    def __init__(self, settings: Sensors, random: np.random.Generator) -> None:
        self.queue: DelayedQueue[Measurement] = DelayedQueue()
        self._settings, self._random = settings, random
        self._wave_numbers = math.tau / np.geomspace(*WAVELENGTHS, WAVES)
        self._phases = {name: random.uniform(0.0, math.tau, WAVES)
                        for name in ('range_1', 'range_2', 'fix_x')}

    def sample_imu(self, stamp: float, data: Any) -> None:
        """Measure rates and accelerations."""
        settings, density = self._settings, math.sqrt(self._settings.imu_rate)
        rates = self._random.normal(
            data.sensor('gyro').data + settings.gyroscope_bias, density * settings.gyroscope_noise)
        accelerations = self._random.normal(
            data.sensor('accelerometer').data + settings.accelerometer_bias,
            density * settings.accelerometer_noise)
        self.queue.send(stamp + settings.imu_latency, Measurement(
            'imu', stamp, (*rates.tolist(), *accelerations.tolist())))

    def sample_ranges(self, stamp: float, data: Any) -> None:
        """Measure the wall's distance in front of both sensors."""
        for name in ('range_1', 'range_2'):
            self._send(name, stamp, data, self._settings.range_noise, self._settings.range_latency)

    def sample_fix(self, stamp: float, data: Any) -> None:
        """Measure where the mark is along the camera's x axis."""
        self._send('fix_x', stamp, data, self._settings.fix_noise, self._settings.fix_latency)

    def _send(self, name: str, stamp: float, data: Any, noise: float, latency: float) -> None:
        place = data.site('camera' if name == 'fix_x' else name).xpos[0]
        waves = np.cos(self._wave_numbers * place + self._phases[name])
        value = data.sensor(name).data[0] + self._random.normal(0.0, noise)
        value += self._settings.place_noise * math.sqrt(2.0 / WAVES) * waves.sum()
        self.queue.send(stamp + latency, Measurement(name, stamp, (float(value),)))
