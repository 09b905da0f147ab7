"""Simulated sensors with noise and delay: a disturbance estimator, and raw MuJoCo sensors."""

from __future__ import annotations

from bisect import bisect_right, insort
import math
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction.estimate import Estimate
from facade_manipulator.simulation.world.scenario import Estimator

# rate [Hz] and latency [s] of each raw sensor; the MJCF file has their noise and places
RAW_SENSORS = {
    'imu': (200.0, 0.008),
    'range_1': (100.0, 0.008),
    'range_2': (100.0, 0.008),
    'fix_x': (100.0 / 3.0, 0.06),
}


class DelayedQueue:
    """Queue of delayed measurements, in order of arrival."""

    def __init__(self) -> None:
        self._queue: list[tuple[float, Any]] = []

    def send(self, arrival: float, item: Any) -> None:
        """Add a measurement that arrives at a given time [s]."""
        insort(self._queue, (arrival, item), key=itemgetter(0))

    def receive(self, now: float) -> list[Any]:
        """Return all measurements that have arrived by `now` [s] since the last call."""
        count = bisect_right(self._queue, now, key=itemgetter(0))
        arrived = self._queue[:count]
        del self._queue[:count]
        return [item for _, item in arrived]


class SimulatedEstimator(DelayedQueue):
    """Simulated disturbance estimator: noisy, late, sometimes missing or wrong."""

    def __init__(
        self, settings: Estimator, start: float, random: np.random.Generator
    ) -> None:
        super().__init__()
        self._settings = settings
        self._start = start
        self._random = random
        position = settings.position_noise**2
        self._variances = (position, position, settings.yaw_noise**2)

    def sample(self, stamp: float, rail: Pose) -> None:
        """Estimate the true pose of the rail [m, m, rad] at a stamp [s]."""
        settings = self._settings
        elapsed = stamp - self._start
        delay = settings.latency + settings.jitter * self._random.uniform(-1.0, 1.0)

        pose = np.array(rail)
        number, since = divmod(elapsed, settings.wrong_every)
        duration = settings.wrong_for[(int(number) - 1) % len(settings.wrong_for)]
        if number > 0.0 and since < duration:
            pose = pose * settings.wrong_scale + settings.wrong_offset
        pose += np.sqrt(self._variances) * self._random.standard_normal(3)

        is_silent = 0.0 <= elapsed - settings.silent_from < settings.silent_for
        is_lost = self._random.random() < settings.loss
        if not is_silent and not is_lost:
            estimate = Estimate(stamp, Pose(*pose.tolist()), self._variances)
            self.send(stamp + delay, estimate)


class Measurement(NamedTuple):
    """Reading of a raw sensor: a length, or angular rates and accelerations for x, y and z."""

    sensor: str  #: ``'imu'``, ``'range_1'``, ``'range_2'`` or ``'fix_x'``
    stamp: float  #: [s]
    values: tuple[float, ...]  #: [m] or [rad/s, m/s²]


class RawSensors(DelayedQueue):
    """Simulated raw sensors: IMU, two distance sensors, and a camera that detects a mark."""

    GYROSCOPE_BIAS = 1e-3  # rad/s
    ACCELEROMETER_BIAS = 0.02  # m/s²
    PLACE_NOISE = 2e-4  # m, standard deviation from one place of the wall to another
    WAVES = 40  # in the error that depends on the place on the wall
    WAVELENGTHS = (0.03, 0.3)  # m

    def __init__(self, random: np.random.Generator) -> None:
        super().__init__()
        self._random = random
        self._wave_numbers = math.tau / np.geomspace(*self.WAVELENGTHS, self.WAVES)
        self._phases = {
            name: random.uniform(0.0, math.tau, self.WAVES) for name in RAW_SENSORS
        }

    def sample(self, model: Any, data: Any, name: str, stamp: float) -> None:
        """Read a sensor at a stamp [s], and queue the reading, which arrives after its latency."""
        if name == 'imu':
            rates = self._noisy('gyro', model, data, self.GYROSCOPE_BIAS)
            values = rates + self._noisy(
                'accelerometer', model, data, self.ACCELEROMETER_BIAS
            )
        else:
            offset = self._place_error(name, data)
            values = self._noisy(name, model, data, offset)[:1]
        _, latency = RAW_SENSORS[name]
        self.send(stamp + latency, Measurement(name, stamp, values))

    def _noisy(
        self, name: str, model: Any, data: Any, offset: float
    ) -> tuple[float, ...]:
        """Return the values of a model sensor with an offset and noise added."""
        true = data.sensor(name).data
        deviation = model.sensor(name).noise[0]
        # the same numbers as from Generator.normal, in a quarter of its time
        noise = deviation * self._random.standard_normal(len(true))
        return tuple((true + offset + noise).tolist())

    def _place_error(self, name: str, data: Any) -> float:
        """Return the error [m] due to dirt, texture and unevenness at a position on the wall."""
        place = data.site('camera' if name == 'fix_x' else name).xpos[0]
        waves = np.cos(self._wave_numbers * place + self._phases[name])
        return self.PLACE_NOISE * math.sqrt(2.0 / self.WAVES) * float(waves.sum())
