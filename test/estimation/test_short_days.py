"""The estimator on a few seconds and in its least settings: what every change of it must keep."""

import math

from estimator_plant import (
    BETTER,
    Day,
    Imu,
    LASERS,
    MARK,
    move,
    Range,
    replace,
    run,
    setup_of,
    START,
    STEP,
    WALL,
)
import numpy as np
import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.estimation.estimator import DisturbanceEstimator

SENSORS = {**LASERS, 'fix': BETTER}
POSE = {'camera': Range('pose', 30.0, 0.05, 1e-3, 0.0)}
DAY = Day(4.0, 2, strength=3.0)
AT_WALL_BY_IMU = ['y, theta: start at 501 mm by left, right', 'x: start by fix']
AT_WALL = ['y, theta: start at 499 mm by left, right', 'x: start by fix']
THERE = 'imu: is there'


def said(estimator):
    return [f'{event.subject}: {event.reason}' for event in estimator.events]


def test_pose_and_velocity_are_those_of_the_rail_and_as_uncertain_as_they_say():
    setup = setup_of(SENSORS, Imu(), distance=WALL)
    outcome = run(DAY, SENSORS, every=4, setup=replace(setup, fixes={'fix': replace(
        setup.fixes['fix'], feature=MARK, feature_known=True)}))
    errors, deviations = outcome.errors(1.0, offsets=True)
    assert (np.sqrt((errors ** 2).mean(axis=0)) < (0.6, 0.25, 0.02)).all()
    assert (np.abs(errors) < 3.5 * deviations).all()
    assert ((np.abs(errors) < 2.0 * deviations).mean(axis=0) > 0.85).all()
    assert (deviations < (1.0, 0.4, 0.05)).all()

    stamps, motion = np.array(outcome.stamps), move(DAY)
    moved = np.column_stack([motion.place[:, :2], motion.euler[:, 2]])
    truth = np.gradient(moved, STEP, axis=0)[np.round(stamps / STEP).astype(int)]
    wrong = (np.array(outcome.velocities) - truth)[stamps > 1.0].std(axis=0)
    assert (wrong < (6e-3, 5e-3, 2e-3)).all()  # m/s, rad/s
    estimator = outcome.estimator
    last = estimator.advance(START + DAY.duration)
    for covariance in (last.covariance, last.velocity_covariance):
        assert np.allclose(covariance, covariance.T, rtol=1e-9, atol=1e-20)
    share = np.sqrt(np.diag(last.velocity_covariance)) / wrong
    assert (share > 0.3).all() and (share < 3.0).all()

    for name, sensor in SENSORS.items():
        record = estimator.records[name]
        assert record.counts.keys() == {'used'} and 0.4 < record.square < 1.6
        assert (record.age, record.period) == pytest.approx(
            (sensor.latency, 1.0 / sensor.rate), rel=0.05)
    late, deviation = estimator.delays()['fix']
    assert abs(late) < 3.0 * deviation < 6e-3


def through_panes(events):
    """Let the distances be of anything from 2 s on."""
    random = np.random.default_rng(5)
    return [(arrival, name, stamp, random.uniform(0.5, 3.0) if name in LASERS and stamp > 2.0
             else value) for arrival, name, stamp, value in events]


@pytest.mark.parametrize(('sensors', 'options', 'events', 'bounds'), [
    (POSE, {}, [THERE, *(f'{axis}: start by camera.{axis}' for axis in ('x', 'y', 'theta'))],
     (0.7, 0.7, 0.03)),
    (SENSORS, {'imu': None}, AT_WALL, (1.0, 0.3, 0.04)),
    (SENSORS, {'imu': Imu(silent=((2.0, 2.3),))}, [
        THERE, *AT_WALL, 'imu: silent for 0.12 s: going on by constant acceleration', THERE],
     (0.8, 0.3, 0.02)),
    ({**SENSORS, 'fix': replace(BETTER, lost=((1.0, 9.0),)),
      'other': replace(BETTER, lost=((0.0, 9.0),))}, {},
     [THERE, *AT_WALL_BY_IMU, 'x: nothing has been measured of it for too long'], None),
    (SENSORS, {'spoil': through_panes}, [
        THERE, *AT_WALL_BY_IMU,
        'y, theta: nothing that was measured for 1 s fits',
        AT_WALL_BY_IMU[0]], None)])
def test_each_loss_has_its_event_and_does_no_harm(sensors, options, events, bounds):
    outcome = run(DAY, sensors, every=4, **options)
    assert said(outcome.estimator) == events
    assert outcome.stamps[-1] == pytest.approx(DAY.duration, abs=0.03)
    if bounds:
        errors, _ = outcome.errors(1.0, offsets=True)
        errors -= np.median(errors, axis=0) * (sensors is SENSORS)  # which do not know the wall
        assert (np.sqrt((errors ** 2).mean(axis=0)) < bounds).all()


def test_a_clock_that_is_set_starts_everything_again():
    estimator = DisturbanceEstimator(setup_of(POSE, Imu()))
    for begin in (START, START - 100.0, START + 100.0):
        for k in range(100):
            now = begin + 0.01 * k
            estimator.add('camera.x', now, now, 0.1)
        motion = estimator.advance(now)
        assert motion.stamp == pytest.approx(now, abs=0.01)
        assert motion.pose.x == pytest.approx(0.1, abs=1e-3)
        assert estimator.records['camera.x'].period == pytest.approx(0.01)
    assert sum('starts again' in event.reason for event in estimator.events) == 2


def test_an_unknown_sensor_is_a_mistake_and_an_old_measurement_is_rejected():
    estimator = DisturbanceEstimator(setup_of(SENSORS, Imu()))
    with pytest.raises(KeyError):
        estimator.add('other', 0.0, 0.0, 1.0)
    with pytest.raises(InputError, match='left is 0.400 s old'):
        estimator.add('left', 0.4, 0.0, 1.0)
    with pytest.raises(InputError, match='left'):
        estimator.add('left', 0.4, 0.4, math.nan)
    assert estimator.records['left'].counts == {'not finite': 1}
