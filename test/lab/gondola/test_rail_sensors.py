"""Simulated sensors on a rail measure what its motion says, and break as they are asked to."""

from dataclasses import replace
import math

import numpy as np
import pytest

from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.lab.gondola import rail_sensors
from facade_manipulator.lab.gondola.closed_loop import ClosedLoop
from facade_manipulator.lab.gondola.scenario import load_scenario

EXACT = rail_sensors.SensorSettings(
    rail_sensors.RailSettings(), rail_sensors.InertialSettings(
        gyroscope_noise=0.0, accelerometer_noise=0.0, gyroscope_bias=0.0, accelerometer_bias=0.0,
        scale=1.0),
    rail_sensors.RangeSettings(noise=0.0, place_noise=0.0),
    rail_sensors.FixedFeatureSettings(noise=0.0, place_noise=0.0))
OMEGA = 1.3


def sway(time):
    return Pose(0.1 * math.sin(OMEGA * time), 0.01 * math.cos(time), 0.02 * math.sin(time))


def measured(settings=EXACT, duration=4.0):
    """Return what comes of each sensor: stamps and values."""
    sensors, found = rail_sensors.RailSensors(settings, sway, 0.0), {}
    for now in np.arange(0.0, duration, 0.005):
        for arrival in sensors.advance(now):
            found.setdefault(arrival.sensor, []).append((arrival.stamp, *arrival.values))
    return {name: np.array(rows) for name, rows in found.items()}


def ranges(name='range_1', **changes):
    return measured(EXACT._replace(distances=replace(EXACT.distances, **changes)))[name]


def test_exact_sensors_measure_the_motion():
    found = measured()
    stamps, *_, turning, ax, _, az = found['imu'].T
    assert turning == pytest.approx(0.02 * np.cos(stamps), abs=1e-4)
    assert ax == pytest.approx(-0.1 * OMEGA ** 2 * np.sin(OMEGA * stamps), abs=2e-3)
    assert set(az) == {9.81}
    left, right = (found[name][:, 1] for name in ('range_1', 'range_2'))
    yaw = np.array([sway(stamp).theta for stamp in found['range_1'][:, 0]])
    assert left - right == pytest.approx(np.tan(yaw), abs=1e-6)
    stamps, seen = found['fix_x'].T
    assert np.ptp(seen + [sway(stamp).x for stamp in stamps]) < 0.02


def test_rates_and_latencies_are_as_set():
    found = measured()
    assert [len(found[name]) for name in ('imu', 'range_1', 'fix_x')] == pytest.approx(
        [799, 399, 118], abs=3)
    first = rail_sensors.RailSensors(EXACT, sway, 0.0)
    assert not first.advance(0.007) and first.advance(0.009)


def test_a_platform_that_tilts_with_its_cables_hides_its_acceleration():
    hanging = replace(EXACT.rail, tilting=1.0, cable_length=9.81 / OMEGA ** 2)
    assert np.abs(measured(EXACT._replace(rail=hanging))['imu'][:, 4]).max() < 5e-3


@pytest.mark.parametrize(('changes', 'seen'), [
    ({'bias': 0.01}, lambda exact, other: np.allclose(other[:, 1], exact[:, 1] + 0.01)),
    ({'scale': 1.05}, lambda exact, other: np.allclose(other[:, 1], 1.05 * exact[:, 1])),
    ({'loss': 0.3}, lambda exact, other: 0.6 < len(other) / len(exact) < 0.8),
    ({'panes': 0.5}, lambda exact, other: 0.4 < (other[:, 1] > 0.7).mean() < 0.6),
    ({'stamp_error': 0.02}, lambda exact, other: np.allclose(other[:, 0], exact[:, 0] + 0.02)),
    ({'silent_from': 1.0, 'silent_for': 1.0}, lambda exact, other: len(other) == len(exact) - 100),
    ({'noise': 1e-3}, lambda exact, other: 9e-4 < (other - exact)[:, 1].std() < 1.1e-3),
    ({'place_noise': 1e-3}, lambda exact, other: 2e-4 < (other - exact)[:, 1].std() < 2e-3)])
def test_each_fault_is_seen(changes, seen):
    assert seen(ranges(), ranges(**changes))


def test_mullions_stand_out_and_swapped_sides_are_swapped():
    wall = replace(EXACT.rail, mullion_pitch=1.0, mullion_width=0.06)
    assert np.ptp(measured(EXACT._replace(rail=wall))['range_1'][:, 1]) > 0.03
    swapped = measured(EXACT._replace(rail=replace(EXACT.rail, swapped=True)))
    assert np.array_equal(swapped['range_1'], measured()['range_2'])


def errors(name, duration, **fix):
    """Return a scenario's error on the wall at 100 Hz."""
    scenario, goal = load_scenario(name), Pose(0.0, 0.25, 0.0)
    sensors = scenario.sensors._replace(fix=replace(scenario.sensors.fix, **fix))
    loop = ClosedLoop(Geometry(), scenario._replace(sensors=sensors), scenario.motion(), goal)
    loop.send_goal(goal)
    found = np.array([step.sample.error for step in loop.run(duration)])
    assert not loop.rejections
    return found - np.median(found[1000:], axis=0)


@pytest.mark.long
def test_raw_sensors_are_better_than_the_default_estimates_and_x_alone_sways_without_a_fix():
    found = errors('sensors', 42.0, silent_from=20.0, silent_for=10.0)
    before, meanwhile, after = (
        found[part].std(axis=0) for part in (
            slice(1000, 2000), slice(2000, 3000), slice(3600, None)))
    assert (before < 0.8 * errors('gusty', 20.0)[1000:].std(axis=0)).all()
    assert abs(found[2000:3000, 0]).max() < 0.15  # what nobody knows does not displace it
    assert 0.02 < meanwhile[0] < 0.08  # the sway itself
    assert (meanwhile[1:] < 1.5 * before[1:]).all() and (after < 1.5 * before).all()
