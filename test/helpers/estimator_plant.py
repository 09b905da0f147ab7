"""
A gondola and sensors of its own, to test the estimator of the disturbance.

Nothing of it is the product's: a level or a tilting platform as oscillators under coloured noise
and pushes, attitudes and levers in three dimensions, a wall whose errors are a field of waves, and
sensors with what is wrong with them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from facade_manipulator.errors import InputError
from facade_manipulator.estimation.estimator import DisturbanceEstimator
from facade_manipulator.estimation.settings import (
    DistanceSettings,
    EstimatorSetup,
    FixSettings,
    ImuSettings,
    PoseFixSettings,
    ProfileSettings,
)

STEP, GRAVITY, START, WALL, MARK = 0.0025, 9.81, 1000.0, 0.45, 0.1
# frequency [Hz], damping and share of each mode of x, y, yaw and the two tilts
MODES = {
    'x': ((0.091, 0.012, 1.0), (0.31, 0.03, 0.12)),
    'y': ((0.13, 0.04, 1.0), (0.72, 0.03, 0.25)),
    'yaw': ((0.21, 0.03, 1.0), (0.09, 0.05, 0.3)),
    'tilt_x': ((0.72, 0.03, 1.0),), 'tilt_y': ((0.31, 0.03, 1.0),)}
GUSTY = {'x': 0.07, 'y': 0.010, 'yaw': math.radians(0.5), 'tilt_x': 3e-3, 'tilt_y': 3e-3}


@dataclass(frozen=True)
class Day:
    """What the gondola does."""

    duration: float = 60.0
    seed: int = 1
    strength: float = 1.0
    tilting: bool = False  # the platform hangs on one point along the wall, as a swing
    pushes: tuple[float, ...] = ()  # s, of 500 N on 500 kg for 0.3 s
    hoisting: float = 0.0  # m/s, up and down between 0 and 30 m


@dataclass(frozen=True)
class Range:
    """One sensor of the wall: kind, place on the rail, and what is wrong with it."""

    kind: str  # 'distance', 'fix' or 'pose'
    rate: float
    latency: float
    noise: float
    field: float
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    panes: float = 0.0  # share of measurements that go through glass
    lost: tuple[tuple[float, float], ...] = ()  # from, to [s]
    stamp_error: float = 0.0
    step: tuple[float, float] = (math.inf, 0.0)  # when and by how much it is displaced


LASERS = {'left': Range('distance', 100.0, 0.005, 2e-4, 2e-4, (-0.5, 0.0, 0.0)),
          'right': Range('distance', 100.0, 0.005, 2e-4, 2e-4, (0.5, 0.0, 0.0))}
CAMERA = Range('fix', 20.0, 0.08, 5e-4, 3e-4, (0.1, 0.0, 0.0))
BETTER = replace(CAMERA, rate=30.0, latency=0.06, noise=3e-4, field=2e-4)
LINE = replace(CAMERA, rate=100.0, latency=0.02, noise=3e-4, field=1e-4)


@dataclass(frozen=True)
class Imu:
    """Noise densities and offsets of an industrial inertial sensor, and what is wrong with it."""

    gyroscope: float = math.radians(0.008)
    accelerometer: float = 100e-6 * GRAVITY
    rate_offset: float = math.radians(0.05)
    offset: float = 0.02
    place: tuple[float, float, float] = (0.2, -0.05, 0.1)
    latency: float = 0.004
    silent: tuple[tuple[float, float], ...] = ()
    scale: float = 1.002
    unit: tuple[float, float] = (1.0, 1.0)  # of rates and accelerations


class Motion(NamedTuple):
    """Samples every `STEP`: places (n, 3), accelerations, attitudes, turning rates."""

    times: np.ndarray
    place: np.ndarray
    acceleration: np.ndarray
    attitude: Rotation
    rates: np.ndarray
    euler: np.ndarray


def move(day: Day) -> Motion:
    """Return the motion of the rail's middle."""
    random, count = np.random.default_rng(day.seed), round(day.duration / STEP) + 800
    times = STEP * np.arange(count)
    waves = {name: _modes(name, random, times, day) for name in MODES}
    position = np.zeros((count, 3))
    acceleration = np.zeros((count, 3))
    for axis, name in enumerate(('x', 'y')):
        position[:, axis], _, acceleration[:, axis] = waves[name]
    if day.hoisting:
        position[:, 2] = 15.0 - np.abs((day.hoisting * times) % 60.0 - 30.0)
    tilt_y = waves['tilt_y']
    if day.tilting:  # a = −g φ: the accelerometer along the rail shows next to nothing
        tilt_y = tuple(part - whole / 30.0 for part, whole in zip(tilt_y, waves['x'], strict=True))
    euler = np.column_stack([waves['tilt_x'][0], tilt_y[0], waves['yaw'][0]])
    roll, pitch, yaw = np.column_stack([waves['tilt_x'][1], tilt_y[1], waves['yaw'][1]]).T
    (sin_r, sin_p, _), (cos_r, cos_p, _) = np.sin(euler).T, np.cos(euler).T
    rates = np.column_stack([roll - yaw * sin_p, pitch * cos_r + yaw * cos_p * sin_r,
                             -pitch * sin_r + yaw * cos_p * cos_r])
    return Motion(times, position, acceleration,
                  Rotation.from_euler('ZYX', euler[:, ::-1]), rates, euler)


def _modes(name, random, times, day):
    """Return position, velocity and acceleration of an axis, as its root of mean square asks."""
    from scipy.signal import lfilter  # a second, for all who collect the tests

    total = np.zeros((3, len(times)))
    kick = np.zeros(len(times))
    for begin in day.pushes:
        inside = (times > begin) & (times < begin + 0.3)
        kick[inside] += np.sin(math.pi * (times[inside] - begin) / 0.3)
    for frequency, damping, share in MODES[name]:
        white = random.standard_normal(len(times) + 40000)
        smooth = lfilter([1.0], [1.0, -0.992], lfilter([1.0], [1.0, -0.992], white))
        omega = math.tau * frequency
        wave = _oscillate(omega, damping, smooth)[:, 40000:]
        wave *= share * day.strength * GUSTY[name] / wave[0].std()
        total += wave
        size = {'x': 1.0, 'y': 0.5, 'yaw': 0.15, 'tilt_x': 0.02, 'tilt_y': 0.02}[name]
        total += _oscillate(omega, damping, share * size * kick)
    return total


def _oscillate(omega, damping, force):
    """Return position, velocity and acceleration under a force, by the central difference."""
    from scipy.signal import lfilter

    a, b = omega * omega * STEP * STEP, damping * omega * STEP
    position = lfilter([0.0, STEP * STEP / (1.0 + b)],
                       [1.0, (a - 2.0) / (1.0 + b), (1.0 - b) / (1.0 + b)], force)
    velocity = np.gradient(position, STEP)
    return np.array([position, velocity, np.gradient(velocity, STEP)])


class Wall:
    """The façade: transoms and mullions, and the errors of its places as a field of waves."""

    def __init__(self, seed: int, transom: float = 0.0, pitch: float = 1.5) -> None:
        random = np.random.default_rng(seed)
        angle = random.uniform(0.0, math.tau, 80)
        number = math.tau / random.uniform(0.05, 0.25, 80)
        self._waves = np.stack([number * np.cos(angle), number * np.sin(angle)])
        self._phases = random.uniform(0.0, math.tau, 80)
        self._transom, self._pitch = transom, pitch

    def error(self, x, z, which=0):
        """Return the error of places, of one standard deviation."""
        phase = np.outer(x, self._waves[0]) + np.outer(z, self._waves[1])
        return math.sqrt(2.0 / 80) * np.cos(phase + (1 + which) * self._phases).sum(axis=1)

    def relief(self, z):
        """Return how far transoms of 80 mm stand out."""
        return np.where(z % self._pitch < 0.08, self._transom, 0.0)


def ranges(motion: Motion, wall: Wall, name: str, sensor: Range, seed: int):
    """Return arrivals, stamps and values of a sensor of the wall."""
    random = np.random.default_rng([seed, sum(map(ord, name))])
    stamps = random.uniform(0.0, 1.0 / sensor.rate) + np.arange(
        0.2, motion.times[-1] - 1.5, 1.0 / sensor.rate)
    index = np.round(stamps / STEP).astype(int)
    stamps = motion.times[index]
    turn = motion.attitude[index]
    place = motion.place[index] + turn.apply(sensor.place)
    noise = sensor.noise * random.standard_normal(len(stamps))
    error = sensor.field * wall.error(place[:, 0], place[:, 2], 7 * sum(map(ord, name)))
    beam = turn.apply((0.0, 1.0, 0.0))
    if sensor.kind == 'distance':
        value = (WALL - wall.relief(place[:, 2]) - place[:, 1]) / beam[:, 1]
        value = np.where(random.random(len(stamps)) < sensor.panes,
                         value + random.uniform(0.3, 3.0, len(stamps)), value)
    elif sensor.kind == 'fix':
        mark = np.column_stack([np.full(len(stamps), MARK), np.full(len(stamps), WALL),
                                place[:, 2]])
        value = turn.inv().apply(mark - place)[:, 0]
    else:
        value = np.column_stack([motion.place[index, :2], motion.euler[index, 2]])
        noise, error = noise[:, None] * (1.0, 1.0, 1.5), 0.0
    begin, jump = sensor.step
    value = value + noise + error + (jump * (stamps >= begin) if jump else 0.0)
    kept = np.ones(len(stamps), bool)
    for since, until in sensor.lost:
        kept &= ~((stamps >= since) & (stamps < until))
    arrivals = stamps + sensor.latency * (1.0 + 0.1 * random.uniform(-1.0, 1.0, len(stamps)))
    return arrivals[kept], stamps[kept] + sensor.stamp_error, value[kept]


def inertial(motion: Motion, imu: Imu, seed: int):
    """Return arrivals, stamps, turning rates and accelerations of the inertial sensor, 200 Hz."""
    random = np.random.default_rng([seed, 99])
    index = np.arange(0, len(motion.times) - 600, 2)
    turning = np.gradient(motion.rates, STEP, axis=0)
    lever = np.array(imu.place)
    own = np.cross(turning, lever) + np.cross(motion.rates, np.cross(motion.rates, lever))
    force = motion.attitude.inv().apply(motion.acceleration + (0.0, 0.0, GRAVITY)) + own
    density = math.sqrt(200.0)
    rates = imu.scale * motion.rates[index] + imu.rate_offset * np.array((1.0, -1.0, 0.7))
    rates += imu.gyroscope * density * random.standard_normal(rates.shape)
    forces = imu.scale * force[index] + imu.offset * np.array((1.0, -0.7, 0.5))
    forces += imu.accelerometer * density * random.standard_normal(forces.shape)
    stamps = motion.times[index]
    kept = np.ones(len(stamps), bool)
    for since, until in imu.silent:
        kept &= ~((stamps >= since) & (stamps < until))
    return (stamps + imu.latency)[kept], stamps[kept], (imu.unit[0] * rates)[kept], (
        imu.unit[1] * forces)[kept]


def setup_of(sensors: dict[str, Range], imu: Imu, **wall) -> EstimatorSetup:
    """Return what a user would write down of these sensors."""
    parts: dict[str, dict] = {'distance': {}, 'fix': {}, 'pose': {}}
    for name, one in sensors.items():
        if one.kind == 'pose':
            parts['pose'][name] = PoseFixSettings(
                position_noise=one.noise, yaw_noise=1.5 * one.noise)
            continue
        kind = DistanceSettings if one.kind == 'distance' else FixSettings
        parts[one.kind][name] = kind(
            mounting=one.place, noise=one.noise, place_noise=one.field)
    return EstimatorSetup(
        ImuSettings(mounting=(*imu.place, 0.0, 0.0, 0.0)), ProfileSettings(**wall),
        parts['distance'], parts['fix'], parts['pose'])


@dataclass
class Run:
    """What an estimator made of a day."""

    estimator: DisturbanceEstimator
    stamps: list = field(default_factory=list)
    poses: list = field(default_factory=list)
    velocities: list = field(default_factory=list)
    deviations: list = field(default_factory=list)
    covariances: list = field(default_factory=list)
    truth: np.ndarray = None
    rejections: list = field(default_factory=list)

    def errors(self, since: float = 10.0, until: float = math.inf, offsets: bool = False):
        """Return estimate less truth in mm, mm and degrees, and deviations, of a span [s]."""
        stamps = np.array(self.stamps)
        inside = (stamps >= since) & (stamps < until)
        difference = np.array(self.poses) - self.truth
        if not offsets:
            difference = difference - np.median(difference[stamps >= 10.0], axis=0)
        scale = np.array((1e3, 1e3, 180.0 / math.pi))
        return scale * difference[inside], scale * np.array(self.deviations)[inside]


def arrivals(day, motion, sensors, imu, wall):
    """Return all that comes, sorted, and what makes the estimator go on: the clock or the imu."""
    events = []
    if imu is not None:
        came, stamps, rates, forces = (part.tolist() for part in inertial(motion, imu, day.seed))
        events += [(a, 'imu', s, (r, f)) for a, s, r, f in zip(
            came, stamps, rates, forces, strict=True)]
    for name, sensor in sensors.items():
        events += [(a, name, s, v) for a, s, v in zip(
            *map(np.ndarray.tolist, ranges(motion, wall, name, sensor, day.seed)), strict=True)]
    clocked = 'tick' if imu is None or imu.silent else 'imu'
    if clocked == 'tick':
        events += [(t, 'tick', t, None) for t in np.arange(0.2, day.duration, 0.005).tolist()]
    return sorted(events, key=lambda event: event[:2]), clocked


def run(day: Day, sensors: dict[str, Range], imu: Imu | None = Imu(), wall: Wall | None = None,
        setup: EstimatorSetup | None = None, every: int = 1, spoil=None, **profile) -> Run:
    """Let an estimator run through a day; `spoil` may change the events, sorted by arrival."""
    motion = move(day)
    events, clocked = arrivals(day, motion, sensors, imu, wall or Wall(day.seed))
    events = spoil(events) if spoil else events
    result = Run(DisturbanceEstimator(setup or setup_of(sensors, imu or Imu(), **profile)))
    ticks = 0
    for arrival, name, stamp, value in events:
        if arrival > day.duration:
            break
        try:
            feed(result.estimator, name, START + arrival, START + stamp, value)
        except InputError as error:
            result.rejections.append(error.reason)
        if name == clocked:
            ticks += 1
            if ticks % every == 0:
                note(result, result.estimator.advance(START + arrival))
    index = np.interp(result.stamps, motion.times, np.arange(len(motion.times)))
    low = index.astype(int)
    full = np.column_stack([motion.place[:, :2], motion.euler[:, 2]])
    share = (index - low)[:, None]
    result.truth = (1.0 - share) * full[low] + share * full[low + 1]
    return result


def feed(estimator, name, now, stamp, value):
    """Hand one event over."""
    if name == 'imu':
        estimator.add_imu(now, stamp, *value)
    elif isinstance(value, list):
        for axis, number in zip(('x', 'y', 'theta'), value, strict=True):
            estimator.add(f'{name}.{axis}', now, stamp, number)
    elif name != 'tick':
        estimator.add(name, now, stamp, value)


def note(result, motion):
    """Keep an estimate."""
    if motion is not None:
        result.stamps.append(motion.stamp - START)
        result.poses.append(motion.pose)
        result.velocities.append(motion.velocity)
        result.covariances.append(motion.covariance)
        result.deviations.append(np.sqrt(np.diag(motion.covariance)))


__all__ = ['BETTER', 'CAMERA', 'LASERS', 'LINE', 'Day', 'Imu', 'Range', 'Run', 'Wall', 'feed',
           'inertial', 'move', 'ranges', 'replace', 'run', 'setup_of']
