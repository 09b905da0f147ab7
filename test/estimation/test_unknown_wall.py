"""Distances of a wall with an unknown place, and guessed features, beside sensors of the pose."""

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
    ProfileSettings,
)
from facade_manipulator.estimation.rail_pose_filter import (
    DisturbanceEstimator,
    RailMotion,
)
from facade_manipulator.estimation.rail_pose_model import WALL as WALL_ERROR
from facade_manipulator.kinematics import Pose

WALL = 0.45  # m, distance of the wall from place 0 of the rail
RAIL = Pose(0.03, 0.02, 0.01)
MARK = 0.1  # m, place of the feature along the wall
SETTLED = 5.0  # s, after the beginning of the last sensor
POSE_STEPS = 6  # between two poses, and between two fixes
WALL_STEPS = 2  # between two distances, and between two estimates
POSE_NOISE = PoseFixSettings().noise
POSE_X, POSE_Y, POSE_YAW = (f'fix_pose.{axis}' for axis in Pose._fields)
UNKNOWN = replace(
    SETUP,
    wall=ProfileSettings(distance=0.0),
    fixes={},
    poses={'fix_pose': PoseFixSettings()},
)
UNKNOWN_FIX = FixSettings(mounting=(0.1, 0.0, 0.0), noise=FIX_NOISE)


@dataclass
class Rail:
    """Estimator of a rail at rest at `RAIL`; each sensor measures from a time on."""

    setup: EstimatorSetup
    begins: dict[str, float]  #: of the sensors' measurements [s], after `START`
    has_imu: bool = True
    slope: float = 0.0  #: by which the wall recedes [m/s]
    seed: int = 1
    time: float = 0.0  #: [s], after `START`
    motions: list[RailMotion] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.estimator = DisturbanceEstimator(self.setup)
        self.random = np.random.default_rng(self.seed)
        self.imu = ImuAtRest(self.random)
        self.steps = 0

    @property
    def events(self) -> list[str]:
        """Return the events as texts."""
        return [event.text for event in self.estimator.events]

    def run(self, end: float) -> None:
        """Run the estimator until a time [s]."""
        while self.time < end:
            now = START + self.time
            if self.has_imu:
                self.estimator.add_imu(now, now, *self.imu.measure())
            for name, begin in self.begins.items():
                period = WALL_STEPS if name in self.setup.distances else POSE_STEPS
                if self.steps % period == 0 and self.time >= begin:
                    self.estimator.add(name, now, now, self.measure(name))
            if self.steps % WALL_STEPS == 0:
                motion = self.estimator.advance(now)
                if motion is not None:
                    self.motions.append(motion)
            self.steps += 1
            self.time = self.steps * IMU_STEP

    def measure(self, name: str) -> float:
        """Return a measurement of a sensor [m or rad]."""
        topic, _, axis = name.partition('.')
        noise = self.random.standard_normal()
        if topic in self.setup.poses:
            index = Pose._fields.index(axis)
            return RAIL[index] + self.setup.poses[topic].noise[index] * noise
        x, y, yaw = RAIL
        if topic in self.setup.fixes:
            sx, sy, _ = self.setup.fixes[topic].mounting
            along = math.cos(yaw) * (MARK - x) + math.sin(yaw) * (WALL - y)
            return along - sx + FIX_NOISE * noise
        sx, sy, _ = self.setup.distances[topic].mounting
        wall = WALL + self.slope * self.time
        distance = wall - y - math.sin(yaw) * sx - math.cos(yaw) * sy
        return distance / math.cos(yaw) + RANGE_NOISE * noise

    def errors(self, since: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the errors of the pose and their published deviations from a time on."""
        errors = []
        deviations = []
        for motion in self.motions:
            if motion.stamp >= START + since:
                errors.append(np.subtract(motion.pose, RAIL))
                deviations.append(np.sqrt(np.diag(motion.covariance)))
        return np.array(errors), np.array(deviations)


ORDERS = {
    'together': {'range_1': 0.0, 'range_2': 0.0, POSE_Y: 0.0, POSE_YAW: 0.0},
    'pose_soon': {'range_1': 0.0, 'range_2': 0.0, POSE_Y: 0.2, POSE_YAW: 0.2},
    'pose_later': {'range_1': 0.0, 'range_2': 0.0, POSE_Y: 4.0, POSE_YAW: 4.0},
    'distances_soon': {'range_1': 0.2, 'range_2': 0.2, POSE_Y: 0.0, POSE_YAW: 0.0},
    'distances_later': {'range_1': 4.0, 'range_2': 4.0, POSE_Y: 0.0, POSE_YAW: 0.0},
    'y_together': {'range_1': 0.0, 'range_2': 0.0, POSE_Y: 0.0},
    'y_later': {'range_1': 0.0, 'range_2': 0.0, POSE_Y: 4.0},
    'y_first': {'range_1': 4.0, 'range_2': 4.0, POSE_Y: 0.0},
    'yaw_first': {POSE_YAW: 0.0, 'range_1': 1.0, 'range_2': 1.0, POSE_Y: 3.0},
    'one_distance': {'range_1': 0.0, POSE_Y: 0.0, POSE_YAW: 0.0},
    'one_distance_first': {'range_1': 0.0, POSE_Y: 4.0, POSE_YAW: 4.0},
    'one_distance_later': {'range_1': 4.0, POSE_Y: 0.0, POSE_YAW: 0.0},
}


@pytest.mark.parametrize('has_imu', [True, False], ids=['imu', 'coasting'])
@pytest.mark.parametrize('begins', ORDERS.values(), ids=ORDERS)
def test_pose_takes_precedence_over_unknown_wall(begins, has_imu):
    rail = Rail(UNKNOWN, begins, has_imu)
    settled = max(begins.values()) + SETTLED
    rail.run(settled + 2.0)
    errors, deviations = rail.errors(settled)
    measured = slice(1, 3)  # y and yaw
    assert (np.abs(errors) < 4.0 * deviations)[:, measured].all()
    assert (np.abs(errors.mean(axis=0)) < POSE_NOISE)[measured].all()
    for channel in rail.estimator.channels.values():
        assert len(channel.levels) <= 1
    for name in UNKNOWN.distances:
        if name in begins:
            assert wall_distance(rail, name) == pytest.approx(WALL, abs=2e-3)


def wall_distance(rail: Rail, name: str) -> float:
    """Return the wall distance that a sensor uses [m]."""
    channel = rail.estimator.channels[name]
    (level,) = channel.levels
    correction = rail.estimator._history.update().state.mean[WALL_ERROR]
    return channel.sensor.distance + level.offset + correction


@pytest.mark.parametrize(
    'begins',
    [
        {POSE_Y: 0.0},
        {POSE_Y: 4.0},
        {POSE_Y: 0.0, 'range_1': 4.0, 'range_2': 4.0},
        {POSE_X: 0.0, POSE_Y: 0.0},
        {POSE_Y: 0.0, POSE_YAW: 0.0},
    ],
    ids=['y', 'y_later', 'y_first', 'x_and_y', 'y_and_yaw'],
)
def test_uncertain_y_leaves_yaw_as_certain_as_distances_allow(begins):
    begins = {'range_1': 0.0, 'range_2': 0.0, **begins}
    settled = max(begins.values()) + SETTLED
    deviations_of_yaw = []
    for distance in (WALL, 0.0):
        setup = replace(UNKNOWN, wall=ProfileSettings(distance=distance))
        rail = Rail(setup, begins)
        rail.run(settled)
        _, deviations = rail.errors(settled - 0.5)
        deviations_of_yaw.append(deviations[-1, 2])
    known, unknown = deviations_of_yaw
    assert unknown < 1.1 * known


def test_pose_takes_precedence_over_a_wall_that_is_not_plane():
    """Let the wall recede by 0.1 mm/s, as in front of a hoisted rail."""
    rail = Rail(UNKNOWN, {'range_1': 0.0, 'range_2': 0.0, POSE_Y: 0.0}, slope=1e-4)
    rail.run(60.0)
    errors, _ = rail.errors(30.0)
    assert np.abs(errors[:, 1]).max() < POSE_NOISE[1]


def test_clock_step_keeps_the_wall_found_beside_a_pose():
    rail = Rail(UNKNOWN, {'range_1': 0.0, 'range_2': 0.0, POSE_Y: 0.0})
    rail.run(SETTLED)
    (_, before, _) = rail.motions[-1].pose
    rail.steps += round(10.0 / IMU_STEP)
    del rail.begins[POSE_Y]
    rail.run(2.0 * SETTLED + 10.0)
    assert any('all axes restart' in event for event in rail.events)
    assert rail.motions[-1].pose.y == pytest.approx(before, abs=4e-4)


def coarse(noise: float) -> EstimatorSetup:
    """Return a setup with an unknown wall and a pose with the same noise in all axes [m, rad]."""
    return replace(UNKNOWN, poses={'fix_pose': PoseFixSettings(noise=3 * (noise,))})


@pytest.mark.parametrize('seed', range(1, 7))
@pytest.mark.parametrize('name', [POSE_X, POSE_Y])
def test_coarse_pose_starts_an_axis_with_its_own_deviation(name, seed):
    rail = Rail(coarse(0.2), {'range_1': 0.0, 'range_2': 0.0, name: 2.0}, seed=seed)
    rail.run(SETTLED)
    assert any(event.endswith(f'started by {name}') for event in rail.events)
    errors, deviations = rail.errors(2.5)
    axis = (POSE_X, POSE_Y).index(name)
    assert (np.abs(errors) < 3.5 * deviations)[:, axis].all()


@pytest.mark.parametrize('noise', [0.2, 0.5])
def test_coarse_yaw_starts_without_a_restart(noise):
    rail = Rail(coarse(noise), {POSE_YAW: 0.0})
    rail.run(SETTLED)
    assert rail.events == ['imu: measuring', f'theta: started by {POSE_YAW}']


@pytest.mark.parametrize('noise', [0.31, 1.0])
def test_pose_too_coarse_to_start_leaves_the_guess(noise):
    rail = Rail(coarse(noise), {'range_1': 0.0, 'range_2': 0.0, POSE_Y: 2.0})
    rail.run(SETTLED)
    assert not any('replaced' in event for event in rail.events)
    assert rail.motions[-1].pose.y == pytest.approx(0.0, abs=1e-3)
    assert rail.estimator.channels[POSE_Y].counts.keys() == {'too uncertain'}


def test_yaw_of_the_pose_alone_leaves_y_at_the_start():
    rail = Rail(UNKNOWN, {'range_1': 0.0, 'range_2': 0.0, POSE_YAW: 0.0})
    rail.run(SETTLED)
    assert rail.motions[-1].pose.y == pytest.approx(0.0, abs=1e-3)
    assert rail.motions[-1].pose.theta == pytest.approx(RAIL.theta, abs=1e-3)


def test_distances_restart_y_at_the_wall_found_beside_a_pose():
    rail = Rail(UNKNOWN, dict.fromkeys(('range_1', 'range_2', POSE_Y, POSE_YAW), 0.0))
    rail.run(SETTLED)
    rail.begins = {'range_1': 25.0, 'range_2': 25.0}
    rail.run(28.0)
    assert 'y, theta: restarted: not measured for too long' in rail.events
    errors, deviations = rail.errors(26.0)
    assert (np.abs(errors) < 4.0 * deviations)[:, 1:].all()
    assert deviations[-1, 1] < 2e-3


def test_unknown_yaw_does_not_restart_y_of_a_pose():
    rail = Rail(UNKNOWN, {POSE_Y: 0.0}, has_imu=False)
    rail.run(20.0)
    errors, deviations = rail.errors(1.0)
    assert deviations[:, 1].max() < 3e-3
    assert np.abs(errors[:, 1]).max() < 3e-3


@pytest.mark.parametrize('name', [POSE_X, 'fix_b'])
@pytest.mark.parametrize('begin', [0.0, 4.0])
def test_known_place_replaces_the_place_of_an_unknown_feature(name, begin):
    fixes = {'fix_x': UNKNOWN_FIX, 'fix_b': replace(UNKNOWN_FIX, feature=MARK)}
    setup = replace(SETUP, fixes=fixes, poses=UNKNOWN.poses)
    rail = Rail(setup, {'fix_x': 0.0, 'range_1': 0.0, 'range_2': 0.0, name: begin})
    rail.run(begin + SETTLED + 2.0)
    errors, deviations = rail.errors(begin + SETTLED)
    assert (np.abs(errors) < 4.0 * deviations)[:, 0].all()
    assert abs(errors[:, 0].mean()) < POSE_NOISE[0]
    assert sum('feature found' in event for event in rail.events) == 1


def test_feature_is_found_after_the_wall_before_it():
    """The place of a feature, measured at a yaw, depends on the distance of the wall."""
    setup = replace(UNKNOWN, fixes={'fix_x': UNKNOWN_FIX})
    begins = dict.fromkeys((POSE_X, POSE_Y, POSE_YAW, 'fix_x'), 0.0)
    rail = Rail(setup, {**begins, 'range_1': 4.0, 'range_2': 4.0})
    rail.run(SETTLED + 4.0)
    (level,) = rail.estimator.channels['fix_x'].levels
    assert level.offset == pytest.approx(MARK, abs=2e-3)
