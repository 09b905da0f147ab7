"""
Raw sensors of the simulated world, recorded once per scenario and played to an estimator.

A test spoils the record like a bad sensor: it loses, delays or changes measurements.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
import math

import numpy as np

from facade_manipulator.errors import InputError
from facade_manipulator.estimation.estimator_settings import (
    DistanceSettings,
    EstimatorSetup,
    FixSettings,
    ProfileSettings,
)
from facade_manipulator.estimation.rail_pose_filter import (
    DisturbanceEstimator,
    RailMotion,
)
from facade_manipulator.kinematics import Geometry, GRAVITY, Pose
from facade_manipulator.simulation.world.scenario import Gondola, Motion, Scenario, Wind
from facade_manipulator.simulation.world.sensors import Measurement
from facade_manipulator.simulation.world.world import World

START = 1000.0  # s, so that no code takes 0 for the beginning of time
PERIOD = 0.01  # s, of the bus
FREE_STEP = (
    2.5e-3  # s, of a world in which nothing touches the wall: bristles need 0.5 ms
)
LEFT = DistanceSettings(mounting=(-0.5, 0.0, 0.0))
RIGHT = DistanceSettings(mounting=(0.5, 0.0, 0.0))
FIX = FixSettings(mounting=(0.1, 0.0, 0.0), noise=3e-4, place_noise=2e-4, feature=0.1)
SETUP = EstimatorSetup(
    distances={'range_1': LEFT, 'range_2': RIGHT},
    fixes={'fix_x': FIX},
    wall=ProfileSettings(distance=0.45),
)
GUSTS = Scenario(
    gondola=Gondola(guide_lever=0.0), wind=Wind(mean_speed=5.0), raw_sensors=True
)
Spoil = Callable[
    [float, Measurement], Iterable[Measurement]
]  #: of the time since `START` [s]


IMU_STEP = 0.005  # s
RANGE_NOISE = 2e-4  # m, of the distances of a rail at rest
FIX_NOISE = 3e-4  # m, of the fixes of a rail at rest


class ImuAtRest:
    """IMU of a rail at rest, with constant biases and the noise of `SETUP`."""

    RATE_NOISE = SETUP.imu.gyroscope_noise / math.sqrt(IMU_STEP)  # rad/s
    FORCE_NOISE = SETUP.imu.accelerometer_noise / math.sqrt(IMU_STEP)  # m/s²

    def __init__(self, random: np.random.Generator) -> None:
        self._random = random
        self._rate_bias = 1e-3 * random.standard_normal(3)  # rad/s
        self._force_bias = 0.02 * random.standard_normal(3) + (0.0, 0.0, GRAVITY)

    def measure(self) -> tuple[np.ndarray, np.ndarray]:
        """Return turning rates [rad/s] and specific forces [m/s²] of the next step."""
        rates = self._rate_bias + self.RATE_NOISE * self._random.standard_normal(3)
        forces = self._force_bias + self.FORCE_NOISE * self._random.standard_normal(3)
        return rates, forces


@dataclass
class Cycle:
    """Measurements that arrive in a cycle, and the true pose of the rail."""

    now: float
    measurements: list[Measurement]
    rail: Pose


@cache
def record(
    duration: float, seed: int = 1, motion: Motion = GUSTS.motion
) -> list[Cycle]:
    """Return the cycles of a gondola in gusts, or with a prescribed motion."""
    world = World(replace(GUSTS, seed=seed, motion=motion), Geometry(), START)
    world.model.opt.timestep = FREE_STEP
    carriages = world.carriages
    cycles = []
    for number in range(1, round(duration / PERIOD) + 1):
        now = START + number * PERIOD
        world.advance(now, carriages)
        cycles.append(Cycle(now, world.raw_sensors.receive(now), world.rail))
    return cycles


class Run:
    """Run of an estimator with the measurements of a record, spoilt or not."""

    def __init__(
        self,
        cycles: list[Cycle],
        spoil: Spoil = lambda _, measurement: [measurement],
        setup: EstimatorSetup = SETUP,
    ) -> None:
        self.estimator = DisturbanceEstimator(setup)
        self.motions: list[RailMotion] = []
        self.rejections: list[str] = []
        self._cycles: list[Cycle] = []
        self.play(cycles, spoil)

    def play(self, cycles: list[Cycle], spoil: Spoil) -> None:
        """Continue the run with later cycles of the record."""
        self._cycles = [*self._cycles, *cycles]
        for cycle in cycles:
            for original in cycle.measurements:
                for measurement in spoil(original.stamp - START, original):
                    feed(self.estimator, cycle.now, measurement, self.rejections)
            motion = self.estimator.advance(cycle.now)
            if motion is not None:
                self.motions.append(motion)

    @property
    def events(self) -> list[str]:
        """Return the events as texts."""
        return [event.text for event in self.estimator.events]

    def errors(
        self, since: float, until: float = math.inf
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return errors and deviations of a span [mm, mm, degrees]."""
        stamps = np.array([motion.stamp for motion in self.motions])
        times = np.array([cycle.now for cycle in self._cycles])
        rails = np.array([cycle.rail for cycle in self._cycles])
        truth = [np.interp(stamps, times, axis) for axis in rails.T]
        poses = np.array([motion.pose for motion in self.motions])
        errors = poses - np.transpose(truth)
        deviations = np.sqrt([np.diag(motion.covariance) for motion in self.motions])
        inside = (stamps >= START + since) & (stamps < START + until)
        scale = np.array((1e3, 1e3, math.degrees(1.0)))
        return scale * errors[inside], scale * deviations[inside]


def feed(
    estimator: DisturbanceEstimator,
    now: float,
    measurement: Measurement,
    rejections: list[str],
) -> None:
    """Add a measurement as the node does, and store the reason of a rejection."""
    sensor, stamp, values = measurement
    try:
        if sensor == 'imu':
            estimator.add_imu(now, stamp, values[:3], values[3:])
        else:
            estimator.add(sensor, now, stamp, *values)
    except InputError as error:
        rejections.append(error.reason)
