"""Sensors that can be bought, on a swaying rail: what they measure of a wall, and how late."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
import math
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import InputError
from facade_manipulator.estimation.estimator import DisturbanceEstimator
from facade_manipulator.estimation.settings import DistanceSettings, EstimatorSetup, FixSettings
from facade_manipulator.kinematics import compose, GRAVITY, Pose
from facade_manipulator.lab.gondola.motion import Motion
from facade_manipulator.parameters import inherited, parameter, settings
from facade_manipulator.prediction.estimate import Estimate, Variances

DIFFERENCE = 0.005  # s, between the places whose differences are velocity and acceleration
WAVES = 40  # of which the errors of places are made
WAVELENGTHS = (0.03, 0.3)  # m


@settings
class RailSettings:
    """What carries the sensors, and what is before them."""

    present: bool = parameter(
        'Whether there are raw sensors in place of estimates of the disturbance', default=False)
    distance: float = parameter(
        'Distance of the wall from the rail at rest', default=0.45, unit='m', minimum=0.05,
        maximum=10.0)
    mark: float = parameter(
        'Place of the feature that gives x', default=0.1, unit='m', minimum=-10.0, maximum=10.0)
    tilting: float = parameter(
        'Share of the tilt of a platform that tilts with its cables', default=0.0, minimum=0.0,
        maximum=1.0)
    cable_length: float = parameter(
        'Length of the cables with which it tilts', default=30.0, unit='m', minimum=1.0,
        maximum=500.0)
    mullion_pitch: float = parameter(
        'Distance between mullions along the wall; 0 has none', default=0.0, unit='m', minimum=0.0,
        maximum=20.0)
    mullion_width: float = parameter(
        'Width of a mullion', default=0.06, unit='m', minimum=1e-3, maximum=1.0)
    mullion_depth: float = parameter(
        'How far a mullion stands out', default=0.03, unit='m', minimum=-1.0, maximum=1.0)
    swapped: bool = parameter(
        'Whether the distances of left and right are swapped', default=False)
    seed: int = parameter('Seed of all noise', default=1, minimum=0)


@settings
class RangeSettings:
    """How a sensor of the wall measures, and what is wrong with it."""

    rate: float = parameter(
        'Rate of measurements', default=100.0, unit='Hz', minimum=0.1, maximum=1000.0)
    latency: float = parameter(
        'Age of a measurement when it comes', default=0.008, unit='s', minimum=0.0, maximum=1.0)
    noise: float = parameter(
        'Standard deviation from one measurement to the next', default=2e-4, unit='m',
        minimum=0.0, maximum=1.0)
    place_noise: float = parameter(
        'Standard deviation from one place of the wall to another', default=2e-4, unit='m',
        minimum=0.0, maximum=1.0)
    bias: float = parameter(
        'What it measures too much', default=0.0, unit='m', minimum=-1.0, maximum=1.0)
    scale: float = parameter('Factor', default=1.0, minimum=0.5, maximum=2.0)
    loss: float = parameter(
        'Share of measurements that never come', default=0.0, minimum=0.0, maximum=1.0)
    panes: float = parameter(
        'Share of measurements that go through glass, up to 3 m too far', default=0.0, minimum=0.0,
        maximum=1.0)
    stamp_error: float = parameter(
        'How much later than the motion its stamps are', default=0.0, unit='s', minimum=-0.5,
        maximum=0.5)
    silent_from: float = parameter(
        'When a silence begins, counted from the start', default=0.0, unit='s', minimum=0.0)
    silent_for: float = parameter('How long it lasts', default=0.0, unit='s', minimum=0.0)
    places: tuple[float, ...] = parameter(
        'Where such sensors are along the rail', default=(-0.5, 0.5), unit='m', minimum=-10.0,
        maximum=10.0)


@settings
class FixedFeatureSettings(RangeSettings):
    """The same of a camera that sees a feature of the wall."""

    rate: float = inherited(RangeSettings, 'rate', default=30.0)
    latency: float = inherited(RangeSettings, 'latency', default=0.06)
    noise: float = inherited(RangeSettings, 'noise', default=3e-4)
    places: tuple[float, ...] = inherited(RangeSettings, 'places', default=(0.1,))


@settings
class InertialSettings:
    """How the inertial sensor measures."""

    rate: float = inherited(RangeSettings, 'rate', default=200.0)
    latency: float = inherited(RangeSettings, 'latency', default=0.008)
    gyroscope_noise: float = parameter(
        'Noise density of the turning rates', default=1.4e-4, unit='rad/s/√Hz', minimum=0.0,
        maximum=0.1)
    accelerometer_noise: float = parameter(
        'Noise density of the accelerations', default=1e-3, unit='m/s^2/√Hz', minimum=0.0,
        maximum=1.0)
    gyroscope_bias: float = parameter(
        'Offset of the turning rates', default=1e-3, unit='rad/s', minimum=-0.1, maximum=0.1)
    accelerometer_bias: float = parameter(
        'Offset of the accelerations', default=0.02, unit='m/s^2', minimum=-1.0, maximum=1.0)
    scale: float = inherited(RangeSettings, 'scale', default=1.002)
    silent_from: float = inherited(RangeSettings, 'silent_from', default=0.0)
    silent_for: float = inherited(RangeSettings, 'silent_for', default=0.0)


class SensorSettings(NamedTuple):
    """All sensors of a rail."""

    rail: RailSettings = RailSettings()
    imu: InertialSettings = InertialSettings()
    distances: RangeSettings = RangeSettings()
    fix: FixedFeatureSettings = FixedFeatureSettings()


class Arrival(NamedTuple):
    """What comes of a sensor: a number, or turning rates and accelerations."""

    sensor: str  #: ``'imu'``, ``'range_1'``, … or ``'fix_x'``
    stamp: float  #: [s]
    values: tuple[float, ...]


def roughness_of(random: np.random.Generator) -> Callable[[float], float]:
    """Return the errors of places along the wall [m], of one standard deviation."""
    numbers, phases = (
        math.tau / np.geomspace(*WAVELENGTHS, WAVES), random.uniform(0.0, math.tau, WAVES))
    return lambda x: math.sqrt(2.0 / WAVES) * float(np.cos(numbers * x + phases).sum())


class RailSensors:
    """
    Measure a motion from a start on [s].

    The motion is looked up when a measurement comes: only then is it certain how the head has
    moved the gondola.
    """

    def __init__(self, settings: SensorSettings, motion: Motion, start: float) -> None:
        self._rail, self._imu = settings.rail, settings.imu
        self._motion, self._start = motion, start
        self._random = np.random.default_rng(settings.rail.seed)
        distances, fix = settings.distances, settings.fix
        sides = distances.places[::-1] if self._rail.swapped else distances.places
        self._streams = [SensorStream('imu', settings.imu, self._inertial, start + DIFFERENCE)]
        for name, own, places, seen in (
                *((f'range_{k}', distances, place, self._distance)
                  for k, place in enumerate(sides, 1)),
                *(('fix_x', fix, place, self._feature) for place in fix.places)):
            self._streams.append(SensorStream(name, own, partial(
                self._measured, own, places, seen, roughness_of(self._random)), start))

    def advance(self, now: float) -> list[Arrival]:
        """Return what has come by now [s], in the order of its arrival."""
        arrived = [item for stream in self._streams for item in stream.advance(now)]
        return [arrival for _, arrival in sorted(arrived, key=itemgetter(0))]

    def _measured(
        self, own: RangeSettings, place: float, seen: Callable[[Pose, float], float],
        roughness: Callable[[float], float], stamp: float,
    ) -> Arrival | None:
        """Return what a sensor at a place of the rail measures; the name is the stream's."""
        rail = self._motion(stamp)
        lost, glass = self._random.random(2) < (own.loss, own.panes)
        value = own.scale * seen(rail, place) + own.bias
        value += own.place_noise * roughness(rail.x + place)
        value += own.noise * self._random.standard_normal()
        if glass:
            value += self._random.uniform(0.3, 3.0)
        return None if lost else Arrival('', stamp + own.stamp_error, (float(value),))

    def _distance(self, rail: Pose, place: float) -> float:
        x, y, _ = compose(rail, Pose(place, 0.0, 0.0))
        pitch, width = self._rail.mullion_pitch, self._rail.mullion_width
        is_mullion = pitch > 0.0 and (x + 0.5 * pitch) % pitch < width
        depth = self._rail.mullion_depth if is_mullion else 0.0
        return (self._rail.distance - depth - y) / math.cos(rail.theta)

    def _feature(self, rail: Pose, place: float) -> float:
        x, y, yaw = compose(rail, Pose(place, 0.0, 0.0))
        return math.cos(yaw) * (self._rail.mark - x) + math.sin(yaw) * (self._rail.distance - y)

    def _attitude(self, rail: Pose) -> np.ndarray:
        """Return tilts about x and y, and the yaw."""
        share = self._rail.tilting / self._rail.cable_length
        return np.array((share * rail.y, -share * rail.x, rail.theta))

    def _inertial(self, stamp: float) -> Arrival:
        """Return what the inertial sensor measures, by differences of where the rail is."""
        before, here, after = (
            self._motion(stamp + shift) for shift in (-DIFFERENCE, 0.0, DIFFERENCE))
        tilt_x, tilt_y, yaw = self._attitude(here)
        rate_x, rate_y, turning = (
            self._attitude(after) - self._attitude(before)) / (2.0 * DIFFERENCE)
        ax, ay = ((one - 2.0 * two + three) / DIFFERENCE ** 2 for one, two, three in zip(
            before[:2], here[:2], after[:2], strict=True))
        cosine, sine = math.cos(yaw), math.sin(yaw)
        values = self._imu.scale * np.array((
            rate_x - turning * tilt_y, rate_y + turning * tilt_x, turning,
            cosine * ax + sine * ay - GRAVITY * tilt_y, cosine * ay - sine * ax + GRAVITY * tilt_x,
            GRAVITY))
        own, density = self._imu, math.sqrt(self._imu.rate)
        for part, noise, bias in ((slice(0, 3), own.gyroscope_noise, own.gyroscope_bias),
                                  (slice(3, 6), own.accelerometer_noise, own.accelerometer_bias)):
            values[part] += bias + density * noise * self._random.standard_normal(3)
        return Arrival('', stamp, tuple(values.tolist()))


class SensorStream:
    """The measurements of one sensor, each as late as it is."""

    def __init__(
        self, name: str, settings: RangeSettings | InertialSettings,
        measure: Callable[[float], Arrival | None], start: float,
    ) -> None:
        self._name, self._settings, self._measure = name, settings, measure
        self._start, self._taken = start, 0

    def advance(self, now: float) -> Iterator[tuple[float, Arrival]]:
        """Yield what has come by now [s], each with the time of its arrival."""
        settings = self._settings
        while (elapsed := self._taken / settings.rate) <= now - self._start - settings.latency:
            self._taken += 1
            is_silent = 0.0 <= elapsed - settings.silent_from < settings.silent_for
            arrival = None if is_silent else self._measure(self._start + elapsed)
            if arrival is not None:
                yield self._start + elapsed + settings.latency, arrival._replace(sensor=self._name)


class EstimatorOnRail:
    """The machine's own estimator, fed by the sensors of a rail; in place of a simulated one."""

    def __init__(self, settings: SensorSettings, motion: Motion, start: float) -> None:
        self._sensors = RailSensors(settings, motion, start)
        distances, fix = settings.distances, settings.fix
        self.estimator = DisturbanceEstimator(EstimatorSetup(
            distances={f'range_{k}': DistanceSettings(
                mounting=(place, 0.0, 0.0), noise=distances.noise,
                place_noise=distances.place_noise)
                for k, place in enumerate(distances.places, 1)},
            fixes={'fix_x': FixSettings(
                mounting=(fix.places[0], 0.0, 0.0), noise=fix.noise,
                place_noise=fix.place_noise)}))

    def advance(self, now: float) -> list[Estimate]:
        """Return the estimate of a time [s], if there is one."""
        for name, stamp, values in self._sensors.advance(now):
            with suppress(InputError):  # so does the node
                if name == 'imu':
                    self.estimator.add_imu(now, stamp, values[:3], values[3:])
                else:
                    self.estimator.add(name, now, stamp, *values)
        motion = self.estimator.advance(now)
        return [] if motion is None else [Estimate(
            motion.stamp, motion.pose, Variances(*np.diag(motion.covariance).tolist()))]
