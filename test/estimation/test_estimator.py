"""The estimator on sensors of the simulated world: accuracy, consistency, and bad sensors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from sensor_record import play, record, replace, Run, SETUP, START

from facade_manipulator.errors import InputError
from facade_manipulator.estimation.estimator import DisturbanceEstimator
from facade_manipulator.estimation.settings import EstimatorSetup, PoseFixSettings
from facade_manipulator.simulation.world.sensors import Measurement

DURATION, SETTLED = 25.0, 8.0  # s
GOOD = (0.5, 0.22, 0.02)  # mm, mm, degrees
STARTED = ['imu: measuring', 'y, theta: started by range_1, range_2',
           'x: started by fix_x']
SILENT = 'imu: silent for'
POSE = replace(SETUP, distances={}, fixes={}, poses={'camera': PoseFixSettings()})


def rms(run: Run, since: float = SETTLED, until: float = math.inf) -> np.ndarray:
    errors, _ = run.errors(since, until)
    return np.sqrt((errors ** 2).mean(axis=0))


def assert_events(run: Run, *beginnings: str) -> None:
    """Compare the events without the numbers at their ends."""
    assert len(run.events) == len(beginnings), run.events
    for event, beginning in zip(run.events, beginnings, strict=True):
        assert event.startswith(beginning)


def changed(sensors, change, since=0.0, until=math.inf):
    """Return a spoiler that changes the measurements of some sensors for a while."""
    return lambda time, one: (
        change(one) if one.sensor in sensors and since <= time < until else [one])


def silent(*sensors, **span):
    return changed(sensors, lambda one: [], **span)


def scaled(sensor, *factors):
    return changed([sensor], lambda one: [one._replace(
        values=tuple(np.multiply(one.values, factors).tolist()))])


def displaced(sensor, offset, **span):
    return changed([sensor], lambda one: [one._replace(values=(one.values[0] + offset,))], **span)


def panes(time, measurement):
    """Let half of all distances pass through glass."""
    random = np.random.default_rng(int(1e4 * time))
    is_through = measurement.sensor.startswith('range') and random.random() < 0.5
    return [measurement._replace(values=(measurement.values[0] + random.uniform(0.3, 3.0),))
            if is_through else measurement]


def transoms(time, measurement):
    """Let both distances pass a transom of 30 mm for 1 s of every 4 s."""
    is_before = measurement.sensor.startswith('range') and 10.0 < time and time % 4.0 < 1.0
    return [measurement._replace(values=(measurement.values[0] - 0.03,)) if is_before
            else measurement]


def swapped(time, measurement):
    names = {'range_1': 'range_2', 'range_2': 'range_1'}
    return [measurement._replace(sensor=names.get(measurement.sensor, measurement.sensor))]


@pytest.mark.long
@pytest.mark.parametrize('seed', [1, 2])
def test_estimates_in_gusts_are_accurate(seed):
    run = play(record(DURATION, seed))
    assert (rms(run) < GOOD).all()
    assert_events(run, *STARTED)
    for channel in run.estimator.channels.values():
        assert channel.counts.keys() == {'used'} and 0.5 < channel.square < 1.5
    stamps = np.array([motion.stamp for motion in run.motions])
    poses, twists = (np.array([getattr(motion, name) for motion in run.motions])
                     for name in ('pose', 'twist'))
    turned = np.exp(1j * poses[:, 2]) * (twists[:, 0] + 1j * twists[:, 1])
    rates = np.column_stack([turned.real, turned.imag, twists[:, 2]])
    moved = np.cumsum(rates[:-1] * np.diff(stamps)[:, None], axis=0)
    assert (np.ptp((moved - poses[1:])[stamps[1:] > START + SETTLED], axis=0) < 0.01).all()


@pytest.mark.long
def test_published_deviations_are_those_of_the_errors():
    """Errors of places dominate and a run passes few of them, so average six runs."""
    shares = []
    for seed in range(1, 7):
        errors, deviations = play(record(DURATION, seed)).errors(SETTLED)
        shares.append((np.abs(errors) < 2.0 * deviations).mean(axis=0))
    assert (np.mean(shares, axis=0) > (0.93, 0.91, 0.96)).all()


@pytest.mark.long
@pytest.mark.parametrize(('spoil', 'bounds', 'events'), [
    (panes, GOOD, []),
    (silent('range_1', since=10.0, until=18.0), (0.5, 1.0, 0.06), []),
    (silent('range_1', 'range_2', since=10.0, until=12.0), (0.5, 1.5, 0.05), []),
    (silent('imu', since=12.0, until=12.2), (0.6, 0.25, 0.02), [SILENT, 'imu: measuring']),
    (silent('imu', since=12.0), (1.0, 0.3, 0.03), [SILENT]),
    (displaced('range_1', 5e-3, since=12.0), (0.5, 0.4, 0.03),
     ['range_1: new level at +']),
    (displaced('fix_x', 0.3, since=12.0), (0.8, 0.22, 0.02), ['fix_x: new level at +']),
    (transoms, (0.5, 0.3, 0.02), ['range_1: new level at -']),
], ids=['panes', 'range_silent', 'ranges_silent', 'imu_interrupted', 'imu_silent',
        'range_displaced', 'fix_displaced', 'transoms'])
def test_bad_sensor_is_named_and_harmless(spoil, bounds, events):
    run = play(record(DURATION), spoil)
    assert (rms(run) < bounds).all()
    assert_events(run, *STARTED, *events)


@pytest.mark.long
def test_silent_fix_loosens_x_until_it_is_given_up():
    run = play(record(DURATION), silent('fix_x', since=10.0, until=23.0))
    errors, deviations = run.errors(10.0, 23.0)
    assert (np.abs(errors) < 4.0 * deviations).all()
    assert rms(run)[1] < GOOD[1]
    assert_events(run, *STARTED, 'x: given up: not measured for too long', 'x: started by fix_x')


@pytest.mark.long
@pytest.mark.parametrize(('spoil', 'fault'), [
    (swapped, 'swap left and right'),
    (scaled('imu', *3 * [180.0 / math.pi], 1.0, 1.0, 1.0), 'in rad/s')])
def test_wrong_connection_is_named_and_nothing_estimated(spoil, fault):
    run = play(record(DURATION), spoil)
    assert fault in run.estimator.fault
    assert run.motions[-1].stamp < START + 15.0


@pytest.mark.long
def test_sensors_in_other_units_are_rejected():
    in_g = play(record(DURATION), scaled('imu', 1.0, 1.0, 1.0, *3 * [1.0 / 9.81]))
    assert in_g.rejections.count('unit') > 0.9 * 200 * (DURATION - 3.0)
    assert in_g.estimator.is_coasting
    in_mm = play(record(DURATION), scaled('range_1', 1e3))
    assert in_mm.estimator.channels['range_1'].counts.keys() == {'wrong unit'}
    assert in_mm.events[-1].startswith('y, theta: started by range_2')


@pytest.mark.long
@pytest.mark.parametrize('late', [-0.01, 0.02])
def test_gusts_show_the_delay_of_a_fix(late):
    fix = replace(SETUP.fixes['fix_x'], delay=0.005, delay_error=0.01)
    run = play(
        record(DURATION), changed(['fix_x'], lambda one: [one._replace(stamp=one.stamp + late)]),
        replace(SETUP, fixes={'fix_x': fix}))
    found, deviation = run.estimator.delays()['fix_x']
    assert abs(found - late) < 3.0 * deviation < 0.03


@pytest.mark.long
def test_spoilt_stamps_and_numbers_are_rejected():
    def spoil(time, measurement):
        kind = round(1e3 * time) % 200
        if kind == 0 and measurement.sensor == 'range_1':
            measurement = measurement._replace(values=(math.nan,))
        stamp = measurement.stamp + (5.0 if kind == 50 else -1.0 if kind == 100 else 0.0)
        return [measurement._replace(stamp=stamp)] * (2 if kind == 150 else 1)

    run = play(record(DURATION), spoil)
    assert {'not_finite', 'future', 'stale', 'out_of_order'} == set(run.rejections)
    assert (rms(run) < GOOD).all()
    assert run.estimator.channels['range_1'].counts['not finite'] > 0


@pytest.mark.long
def test_poses_and_imu_suffice():
    random = np.random.default_rng(1)
    rails = {round(cycle.now, 3): cycle.rail for cycle in record(DURATION)}

    def spoil(time, measurement):
        if measurement.sensor == 'imu':
            return [measurement]
        rail = rails.get(round(measurement.stamp, 3))
        if measurement.sensor != 'range_1' or rail is None:
            return []
        return [Measurement(f'camera.{axis}', measurement.stamp, (value + 1e-3 * noise,))
                for axis, value, noise in zip(
                    rail._fields, rail, random.standard_normal(3), strict=True)]

    assert (rms(play(record(DURATION), spoil, POSE)) < (0.6, 0.6, 0.06)).all()


def test_clock_that_is_set_starts_everything_again():
    estimator = DisturbanceEstimator(POSE)
    for begin in (START, START - 100.0, START + 100.0):
        for k in range(100):
            now = begin + 0.01 * k
            estimator.add('camera.x', now, now, 0.1)
            motion = estimator.advance(now)
        assert motion.stamp == pytest.approx(now, abs=0.01)
        assert motion.pose.x == pytest.approx(0.1, abs=1e-3)
        assert np.diag(motion.covariance)[1:] == pytest.approx((1.0, 0.1), rel=0.05)  # unknown
    assert sum('start again' in event.reason for event in estimator.events) == 2


def test_old_measurement_is_rejected_and_unknown_sensor_fails():
    estimator = DisturbanceEstimator(EstimatorSetup(distances=SETUP.distances))
    with pytest.raises(KeyError):
        estimator.add('other', 0.0, 0.0, 1.0)
    with pytest.raises(InputError, match=r'range_1 is 0.400 s old'):
        estimator.add('range_1', 0.4, 0.0, 1.0)
