"""Sensors of a rail at rest that are silent, and then measure the wall or something else."""

from collections.abc import Callable
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

from facade_manipulator.estimation.estimator_settings import PoseFixSettings
from facade_manipulator.estimation.rail_pose_filter import (
    DisturbanceEstimator,
    RailMotion,
)
from facade_manipulator.kinematics import GRAVITY, Pose

RANGE_STEPS = 2  # between two distances
FIX_STEPS = 6  # between two fixes
LOSS = 8.0  # s, begin of the outages
PANE = 0.3  # m, behind the wall
RECESS = 0.06  # m, behind the wall
X = 0  # index of the axis
Y = 1


@dataclass
class Sensors:
    """Sensors of a rail at rest, by the time since `START` [s]."""

    seed: int = 1
    #: whether the distance sensors measure
    is_measured: Callable[[float], bool] = lambda time: True
    #: depth of the surface behind the wall [m]
    depth: Callable[[float], float] = lambda time: 0.0
    #: whether the mark is measured
    is_mark_seen: Callable[[float], bool] = lambda time: True
    #: place of the measured mark along the wall [m]
    mark: Callable[[float], float] = lambda time: 0.0
    imu_end: float = math.inf  #: s
    times: list[float] = field(default_factory=list)  #: of the estimates [s]
    motions: list[RailMotion] = field(default_factory=list)
    events: list[str] = field(default_factory=list)  #: after the start of the axes

    def run(self, duration: float) -> None:
        """Run the estimator for a time [s]."""
        random = np.random.default_rng(self.seed)
        estimator = DisturbanceEstimator(SETUP)
        imu = ImuAtRest(random)
        for number in range(round(duration / IMU_STEP)):
            time = number * IMU_STEP
            now = START + time
            if time < self.imu_end:
                rates, forces = imu.measure()
                estimator.add_imu(now, now, rates, forces)
            if number % FIX_STEPS == 0 and self.is_mark_seen(time):
                place = self.mark(time) + FIX_NOISE * random.standard_normal()
                estimator.add('fix_x', now, now, place)
            if number % RANGE_STEPS == 0:
                self._measure_distances(estimator, time, random)
                self._advance(estimator, time)
        for event in estimator.events:
            if event.stamp > START + 2.0:
                self.events.append(event.text)

    def _measure_distances(
        self,
        estimator: DisturbanceEstimator,
        time: float,
        random: np.random.Generator,
    ) -> None:
        now = START + time
        for name in SETUP.distances:
            distance = SETUP.wall.distance + self.depth(time)
            distance += RANGE_NOISE * random.standard_normal()
            if self.is_measured(time):
                estimator.add(name, now, now, distance)

    def _advance(self, estimator: DisturbanceEstimator, time: float) -> None:
        motion = estimator.advance(START + time)
        if motion is not None:
            self.times.append(time)
            self.motions.append(motion)

    def x(self, begin: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the errors of x and their published standard deviations in a time [m]."""
        return self._axis(X, begin, end)

    def y(self, begin: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the errors of y and their published standard deviations in a time [m]."""
        return self._axis(Y, begin, end)

    def _axis(
        self, axis: int, begin: float, end: float
    ) -> tuple[np.ndarray, np.ndarray]:
        inside = []
        for time, motion in zip(self.times, self.motions, strict=True):
            if begin <= time < end:
                deviation = math.sqrt(motion.covariance[axis, axis])
                inside.append((motion.pose[axis], deviation))
        errors, deviations = np.transpose(inside)
        return errors, deviations


def lost(begin: float, end: float) -> Callable[[float], bool]:
    """Return the visibility of the wall with an outage [s]."""
    return lambda time: not begin <= time < end


def surface(depth: float, *times: tuple[float, float]) -> Callable[[float], float]:
    """Return the depth [m] of a surface that is measured in some spans of time [s]."""

    def at(time: float) -> float:
        return depth if any(begin <= time < end for begin, end in times) else 0.0

    return at


@pytest.mark.parametrize(
    'panes',
    [
        ((LOSS + 1.1, LOSS + 1.12),),
        ((LOSS - 0.02, LOSS), (LOSS + 1.1, LOSS + 1.3)),
    ],
    ids=['after', 'before_and_after'],
)
def test_panes_around_an_outage_do_not_restart_the_axis(panes):
    sensors = Sensors(is_measured=lost(LOSS, LOSS + 1.1), depth=surface(PANE, *panes))
    sensors.run(LOSS + 2.0)
    errors, deviations = sensors.y(LOSS, LOSS + 2.0)
    assert not any('restarted' in event for event in sensors.events)
    assert (np.abs(errors) < 4.0 * deviations).all()
    assert deviations.max() < 5e-3


def test_recess_after_a_one_second_outage_becomes_a_level():
    depth = surface(RECESS, (LOSS, LOSS + 3.0))
    sensors = Sensors(is_measured=lost(LOSS, LOSS + 1.0), depth=depth)
    sensors.run(LOSS + 3.0)
    assert not any('restarted' in event for event in sensors.events)
    assert any('new level at +' in event for event in sensors.events)
    assert np.abs(sensors.y(LOSS, LOSS + 3.0)[0]).max() < 5e-3


def test_axis_restarts_after_a_second_of_rejections():
    """Let all distances differ for 1.5 s, so that no level is found."""

    def depth(time):
        return PANE + math.fmod(1e3 * time, 1.0) + 10.0 * (time - LOSS)

    sensors = Sensors(depth=lambda time: depth(time) if LOSS < time < 9.5 else 0.0)
    sensors.run(LOSS + 3.0)
    restart = 'y, theta: restarted: no measurement was accepted for 1 s'
    assert sensors.events[0] == restart
    errors, _ = sensors.y(LOSS + 2.5, LOSS + 3.0)
    assert np.abs(errors).max() < 1e-3


@pytest.mark.parametrize('outage', [0.5, 1.5])
@pytest.mark.parametrize('seed', [1, 2, 3])
def test_level_found_after_an_outage_keeps_its_uncertainty(outage, seed):
    back = LOSS + outage
    depth = surface(RECESS, (LOSS, LOSS + 4.0), (LOSS + 5.0, LOSS + 7.0))
    sensors = Sensors(seed, is_measured=lost(LOSS, back), depth=depth)
    sensors.run(LOSS + 7.0)
    _, before = sensors.y(LOSS, back)
    (event,) = sensors.events  # the wall itself is not another level
    assert 'new level at +' in event

    errors, deviations = sensors.y(back, LOSS + 4.0)
    assert (np.abs(errors) < 3.5 * deviations).all()
    assert deviations.min() > 0.9 * before[-1]

    # the wall ends the uncertainty, and then the level is found anew
    for begin in (LOSS + 4.2, LOSS + 5.5):
        errors, deviations = sensors.y(begin, begin + 0.8)
        assert (np.abs(errors) < 3.5 * deviations).all()
        assert deviations.max() < 5e-4


def test_mark_found_after_an_outage_keeps_its_uncertainty():
    mark = surface(0.3, (LOSS, LOSS + 4.0))
    sensors = Sensors(is_mark_seen=lost(LOSS, LOSS + 1.0), mark=mark)
    sensors.run(LOSS + 4.0)
    _, before = sensors.x(LOSS, LOSS + 1.0)
    errors, deviations = sensors.x(LOSS + 1.0, LOSS + 4.0)
    assert (np.abs(errors) < 3.5 * deviations).all()
    assert deviations.min() > 0.9 * before[-1]


@pytest.mark.parametrize('rate', [5.0, 8.0, 10.0, 50.0])
def test_step_of_a_slow_sensor_becomes_a_level(rate):
    sensor = PoseFixSettings()
    setup = replace(SETUP, distances={}, fixes={}, poses={'camera': sensor})
    estimator = DisturbanceEstimator(setup)
    random = np.random.default_rng(1)
    period = round(1.0 / (rate * IMU_STEP))
    for number in range(round((LOSS + 4.0) / IMU_STEP)):
        now = START + number * IMU_STEP
        estimator.add_imu(now, now, (0.0, 0.0, 0.0), (0.0, 0.0, GRAVITY))
        if number % period == 0:
            for axis, noise in zip(Pose._fields, sensor.noise, strict=True):
                is_displaced = axis == 'y' and now > START + LOSS
                value = noise * random.standard_normal() + 0.03 * is_displaced
                estimator.add(f'camera.{axis}', now, now, value)
        motion = estimator.advance(now)
    texts = [event.text for event in estimator.events]
    assert not any('restarted' in text for text in texts)
    assert any(text.startswith('camera.y: new level at +') for text in texts)
    assert motion.pose.y == pytest.approx(0.0, abs=5e-3)


def test_return_far_from_the_estimate_is_reported():
    """After an outage without the IMU no sensor distinguishes a recess from the wall."""
    is_measured = lost(LOSS + 2.0, LOSS + 2.8)
    depth = surface(RECESS, (LOSS + 2.0, LOSS + 5.0))
    sensors = Sensors(is_measured=is_measured, depth=depth, imu_end=LOSS)
    sensors.run(LOSS + 4.0)
    assert any('place of the wall is assumed' in event for event in sensors.events)


def test_short_outage_is_not_reported():
    sensors = Sensors(is_measured=lost(LOSS, LOSS + 0.5))
    sensors.run(LOSS + 2.0)
    assert sensors.events == []
