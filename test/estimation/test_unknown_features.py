"""Fixes whose feature has an unknown place on the wall, beside other sensors of x."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
import math

import numpy as np
import pytest
from sensor_record import (
    FIX_NOISE,
    IMU_STEP,
    ImuAtRest,
    RANGE_NOISE,
    replace,
    SETUP,
    START,
)

from facade_manipulator.estimation.estimator_settings import (
    EstimatorSetup,
    FixSettings,
    PoseFixSettings,
)
from facade_manipulator.estimation.rail_pose_filter import (
    DisturbanceEstimator,
    RailMotion,
)

POSE_NOISE = 1e-3  # m
WALL_STEPS = 2  # between two distances, and between two estimates
X_STEPS = 6  # between two measurements of x
LOSS = 4.0  # s, begin of the outages
RETURN = 14.0  # s, end of the outages
MARK = 0.1  # m, place of the second mark along the wall
SWAY = 0.02  # m, amplitude
SWAY_RATE = 1.5  # rad/s
UNKNOWN_FIX = FixSettings(noise=FIX_NOISE)
TWO_FIXES = replace(SETUP, fixes={'fix_a': UNKNOWN_FIX, 'fix_b': UNKNOWN_FIX})
FIX_AND_POSE = replace(
    SETUP, fixes={'fix_x': UNKNOWN_FIX}, poses={'fix_pose': PoseFixSettings()}
)


def always(_: float) -> bool:
    return True


def late(time: float) -> bool:
    return time > 0.5


def lost(time: float) -> bool:
    return not LOSS <= time < RETURN


def until_loss(time: float) -> bool:
    return time < LOSS


def sway(time: float) -> tuple[float, float]:
    """Return x and its acceleration [m, m/s²] of a rail that begins at rest at 0."""
    phase = SWAY_RATE * max(time - 1.0, 0.0)
    acceleration = SWAY_RATE**2 * SWAY * math.cos(phase) if phase else 0.0
    return SWAY * (1.0 - math.cos(phase)), acceleration


def rest(_: float) -> tuple[float, float]:
    return 0.0, 0.0


def displaced(_: float) -> tuple[float, float]:
    return 0.03, 0.0


@dataclass
class Rail:
    """Estimator of a rail that moves along x, with the sensors of x of a setup."""

    setup: EstimatorSetup
    #: whether each sensor of x measures at a time since `START` [s]
    is_measured: dict[str, Callable[[float], bool]]
    marks: dict[str, float] = field(default_factory=dict)  #: of the fixes [m]
    has_imu: bool = True
    motion: Callable[[float], tuple[float, float]] = rest
    times: list[float] = field(default_factory=list)  #: of the estimates [s]
    motions: list[RailMotion] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.estimator = DisturbanceEstimator(self.setup)

    @property
    def events(self) -> list[str]:
        """Return the events as texts."""
        return [event.text for event in self.estimator.events]

    def run(self, duration: float) -> None:
        """Run the estimator for a time [s]."""
        random = np.random.default_rng(1)
        imu = ImuAtRest(random)
        for number in range(round(duration / IMU_STEP)):
            time = number * IMU_STEP
            now = START + time
            x, acceleration = self.motion(time)
            if self.has_imu:
                rates, forces = imu.measure()
                forces[0] += acceleration
                self.estimator.add_imu(now, now, rates, forces)
            if number % X_STEPS == 0:
                self._measure_x(time, x, random)
            if number % WALL_STEPS == 0:
                for name in self.setup.distances:
                    distance = self.setup.wall.distance
                    distance += RANGE_NOISE * random.standard_normal()
                    self.estimator.add(name, now, now, distance)
                motion = self.estimator.advance(now)
                if motion is not None:
                    self.times.append(time)
                    self.motions.append(motion)

    def _measure_x(self, time: float, x: float, random: np.random.Generator) -> None:
        now = START + time
        for name, is_measured in self.is_measured.items():
            if not is_measured(time):
                continue
            if name in self.setup.fixes:
                value = self.marks.get(name, 0.0) - x
                value += FIX_NOISE * random.standard_normal()
            else:
                value = x + POSE_NOISE * random.standard_normal()
            self.estimator.add(name, now, now, value)

    def x(self, begin: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the errors of x and their published standard deviations in a time [m]."""
        inside = []
        for time, motion in zip(self.times, self.motions, strict=True):
            if begin <= time < end:
                deviation = math.sqrt(motion.covariance[0, 0])
                inside.append((motion.pose.x - self.motion(time)[0], deviation))
        errors, deviations = np.transpose(inside)
        return errors, deviations


def is_consistent(span: Sequence[np.ndarray], largest: float) -> bool:
    """Return whether errors are below a limit [m] and explained by their deviations."""
    errors, deviations = span
    is_explained = np.abs(errors) < 4.0 * deviations
    return bool(is_explained.all()) and float(np.abs(errors).max()) < largest


@pytest.mark.parametrize('mark', [MARK, 2e-3, -1.5])
@pytest.mark.parametrize('motion', [rest, sway])
def test_fix_beside_a_pose_measures_its_feature(mark, motion):
    is_seen = {'fix_pose.x': until_loss, 'fix_x': late}
    rail = Rail(FIX_AND_POSE, is_seen, {'fix_x': mark}, motion=motion)
    rail.run(LOSS + 3.0)
    assert is_consistent(rail.x(LOSS, LOSS + 3.0), 1.5e-3)


@pytest.mark.parametrize('back', [LOSS + 6.0, RETURN], ids=['kept', 'restarted'])
def test_fix_returns_at_its_measured_feature_after_an_outage(back):

    def is_fix_seen(time):
        return 0.5 < time < LOSS or time > back

    is_seen = {'fix_pose.x': until_loss, 'fix_x': is_fix_seen}
    rail = Rail(FIX_AND_POSE, is_seen, {'fix_x': MARK})
    rail.run(back + 2.0)
    assert ('x: started by fix_x' in rail.events) == (back == RETURN)
    assert is_consistent(rail.x(back + 0.5, back + 2.0), 2e-3)


@pytest.mark.parametrize('mark', [MARK, 2e-3])
def test_second_fix_restarts_x_at_its_measured_feature(mark):
    is_seen = {'fix_a': until_loss, 'fix_b': lost}
    rail = Rail(TWO_FIXES, is_seen, {'fix_b': mark}, has_imu=False, motion=sway)
    rail.run(RETURN + 2.0)
    assert 'x: restarted: not measured for too long' in rail.events
    assert rail.events[-1] == 'x: started by fix_b'
    assert is_consistent(rail.x(RETURN + 1.0, RETURN + 2.0), 2e-3)


@pytest.mark.parametrize('first', [always, until_loss])
def test_second_mark_near_the_first_causes_no_bias(first):
    is_seen = {'fix_a': first, 'fix_b': always}
    rail = Rail(TWO_FIXES, is_seen, {'fix_b': 2e-3}, motion=sway)
    rail.run(LOSS + 4.0)
    errors, _ = rail.x(LOSS + 1.0, LOSS + 4.0)
    assert abs(errors.mean()) < 0.5e-3


def test_fix_without_a_place_does_not_restart_x():
    """No sensor relates the feature to the place of the rail before the restart."""
    is_seen = {'fix_a': until_loss, 'fix_b': lambda time: time >= RETURN}
    rail = Rail(TWO_FIXES, is_seen, {'fix_b': MARK}, has_imu=False)
    rail.run(RETURN + 2.0)
    assert rail.events[-1] == 'x: restarted: not measured for too long'
    _, deviations = rail.x(RETURN, RETURN + 2.0)
    assert deviations.min() > 0.9


def test_fix_without_a_place_is_not_counted_as_outlier():
    rail = Rail(FIX_AND_POSE, {'fix_pose.x': always, 'fix_x': late}, {'fix_x': MARK})
    rail.run(LOSS)
    counts = rail.estimator.channels['fix_x'].counts
    assert 'outlier' not in counts
    assert 'other level' not in counts
    assert counts['used'] > 50


@pytest.mark.parametrize('pose', [lambda _: False, lambda time: time < 0.1])
def test_fix_without_place_starts_x_while_pose_is_silent(pose):
    rail = Rail(FIX_AND_POSE, {'fix_pose.x': pose, 'fix_x': always}, {'fix_x': MARK})
    rail.run(2.0)
    assert rail.events[-1] == 'x: started by fix_x'
    assert is_consistent(rail.x(1.5, 2.0), 1.5e-3)


def test_pose_starts_x_before_a_fix_without_a_place():
    """The pose begins 0.1 s later, and knows that the rail is not at 0."""
    is_seen = {'fix_pose.x': lambda time: time > 0.1, 'fix_x': always}
    rail = Rail(FIX_AND_POSE, is_seen, {'fix_x': MARK}, motion=displaced)
    rail.run(LOSS)
    assert 'x: started by fix_pose.x' in rail.events
    assert is_consistent(rail.x(2.0, LOSS), 1.5e-3)
