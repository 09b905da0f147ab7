"""Units, signs and repeatability of the simulated world."""

from collections import Counter
from dataclasses import replace
import math

import numpy as np
import pytest

from facade_manipulator.kinematics import Geometry, GRAVITY, inverse_kinematics, Pose
from facade_manipulator.simulation.world import sensors
from facade_manipulator.simulation.world.scenario import (
    load_scenario,
    Motion,
    Scenario,
    scenario_names,
    Wall,
    Wind,
)
from facade_manipulator.simulation.world.world import World

pytestmark = pytest.mark.long

GEOMETRY = Geometry()
START = 1000.0
PERIOD = 0.01
SINES = {
    'x': ((0.1, 0.25, 0.3),),
    'y': ((0.015, 0.5, 1.0),),
    'theta': ((0.035, 0.4, 0.0),),
}
STILL = Motion(x=((0.0, 1.0, 0.0),))
MIDDLE = Pose(0.0, 0.25, 0.0)


def run(world, duration, head=lambda elapsed: MIDDLE):
    """Advance with the head on a path in frame rail [m, m, rad]; yield each cycle's world."""
    begin = world.time
    for number in range(1, round(duration / PERIOD) + 1):
        world.advance(
            begin + number * PERIOD, inverse_kinematics(GEOMETRY, head(number * PERIOD))
        )
        yield world


def finish(*arguments):
    *_, world = run(*arguments)
    return world


@pytest.mark.parametrize('lag', [0.0, 0.015])
@pytest.mark.parametrize('mean_speed', [0.0, 5.0])
def test_gondola_in_steady_air_hangs_at_the_origin(mean_speed, lag):
    scenario = Scenario(wind=Wind(mean_speed=mean_speed, turbulence=0.0))
    world = finish(World(scenario, GEOMETRY, START, drive_lag=lag), 5.0)
    assert world.rail == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert world.data.site('rail').xpos[2] == pytest.approx(0.0, abs=1e-9)
    assert world.time == pytest.approx(START + 5.0)


def seen(name, seed):
    world = World(replace(load_scenario(name), seed=seed), GEOMETRY)
    rails = [each.rail for each in run(world, 0.5)]
    arrived = [
        queue.receive(math.inf) for queue in (world.estimator, world.raw_sensors)
    ]
    return rails, *arrived, world.measure_wrench()


@pytest.mark.parametrize('name', scenario_names())
def test_same_seed_repeats_each_scenario_bit_by_bit(name):
    assert seen(name, 3) == seen(name, 3)


def test_raw_readings_arrive_after_their_latency():
    received = set()
    for world in run(World(load_scenario('sensors'), GEOMETRY, START), 0.5):
        for reading in world.raw_sensors.receive(world.time):
            _, latency = sensors.RAW_SENSORS[reading.sensor]
            assert world.time >= reading.stamp + latency - 1e-9
            received.add(reading.sensor)
    assert received == sensors.RAW_SENSORS.keys()


def test_another_seed_gives_other_wind_and_noise():
    rails, estimates, *_ = seen('gusts', 1)
    other_rails, other_estimates, *_ = seen('gusts', 2)
    assert rails
    assert rails != other_rails
    assert estimates
    assert estimates != other_estimates


def test_world_is_independent_of_the_step_length():
    carriages = inverse_kinematics(GEOMETRY, MIDDLE)
    scenario = load_scenario('gusts')
    ends = []
    for steps in (10, 50):
        world = World(scenario, GEOMETRY)
        for number in range(1, steps + 1):
            world.advance(0.5 * number / steps, carriages)
        ends.append(world.rail)
    assert ends[0] == pytest.approx(ends[1], abs=1e-12)


@pytest.mark.parametrize(
    ('axis', 'stiffness', 'inertia'),
    [
        # body and cables in one line: the long pendulum with the body's own inertia
        (0, 500.0 * GRAVITY / 30.0, 500.0),
        (5, 500.0 * GRAVITY / 30.0 * 0.6**2 + 600.0 * 0.6**2, 450.0 * 0.7**2),
    ],
)
def test_gondola_sways_with_the_textbook_period(axis, stiffness, inertia):
    world = World(Scenario(), GEOMETRY)
    speed = np.zeros(6)
    speed[axis] = 0.01
    world.data.joint('gondola').qvel[:] = speed
    period = math.tau * math.sqrt(inertia / stiffness)
    moved = [each.rail for each in run(world, 0.75 * period)]
    values = np.array(moved)[:, 2 if axis == 5 else 0]
    crossing = PERIOD * (np.argmax(values < 0.0) + 1)
    assert crossing == pytest.approx(0.5 * period, rel=0.05)


def test_carriages_follow_a_ramp_late_by_the_drive_lag():
    for lag in (0.0, 0.015):
        world = World(Scenario(motion=STILL), GEOMETRY, head=MIDDLE, drive_lag=lag)
        finish(world, 1.0, lambda t: Pose(0.05 * t, 0.25, 0.0))
        assert 0.05 - world.carriages.q3 == pytest.approx(0.05 * lag, abs=2e-6)


def test_raw_sensors_read_the_prescribed_motion(monkeypatch):
    """Overwriting the position of the box would make the accelerometer read 30 % of the truth."""
    for name in ('GYROSCOPE_BIAS', 'ACCELEROMETER_BIAS', 'PLACE_NOISE'):
        monkeypatch.setattr(sensors.RawSensors, name, 0.0)
    world = World(Scenario(motion=Motion(**SINES), raw_sensors=True), GEOMETRY)
    world.model.sensor_noise[:] = 0.0
    finish(world, 4.0)
    motion = Motion(**SINES).poses
    counts = Counter()
    for sensor, stamp, values in world.raw_sensors.receive(math.inf):
        counts[sensor] += 1
        before = np.array(motion(stamp - 1e-3))
        here = np.array(motion(stamp))
        after = np.array(motion(stamp + 1e-3))
        (ax, ay, _) = (before - 2.0 * here + after) / 1e-6
        (x, y, theta) = here
        cosine = math.cos(theta)
        sine = math.sin(theta)
        turn = (after - before)[2] / 2e-3
        along = cosine * ax + sine * ay
        across = cosine * ay - sine * ax
        forces_and_rates = (0.0, 0.0, turn, along, across, GRAVITY)
        mark = cosine * (0.1 - x) + sine * (0.45 - y) - 0.1
        expected_values = {
            'imu': forces_and_rates,
            'range_1': ((0.45 - y + 0.5 * sine) / cosine,),
            'range_2': ((0.45 - y - 0.5 * sine) / cosine,),
            'fix_x': (mark,),
        }
        expected = expected_values[sensor]
        if sensor != 'imu' or counts['imu'] > 10:  # the sway begins with a jerk
            assert values == pytest.approx(
                expected, abs=3e-3 if sensor == 'imu' else 2e-5
            )
    assert counts == {'imu': 800, 'range_1': 400, 'range_2': 400, 'fix_x': 134}


@pytest.mark.parametrize('slide', [0.05, 0.0, -0.05])
@pytest.mark.parametrize('stiffness', [600.0, 2000.0, 5000.0])
def test_wall_pushes_and_rubs_at_the_bristles(stiffness, slide):
    """Press a brush against the wall with 30 N and slide it along the wall [m/s]."""
    wall = Wall(is_touched=True, distance=0.2, brush_stiffness=stiffness)
    depth = 30.0 / stiffness
    scenario = Scenario(motion=STILL, wall=wall)
    world = World(scenario, GEOMETRY, head=Pose(0.0, 0.19, 0.0))

    def press(t):
        return Pose(0.0, 0.19 + (0.01 + depth) * t, 0.0)

    def rub(t):
        return Pose(slide * t, 0.2 + depth, 0.0)

    finish(world, 1.0, press)
    fx, fy, mz = finish(world, 1.0, rub).wrench
    assert fy == pytest.approx(-30.0, rel=0.04)
    friction = 0.3 * fy * np.sign(slide)
    assert fx == pytest.approx(friction, rel=0.01, abs=0.01)
    assert mz == pytest.approx(fx * depth, rel=0.05, abs=1e-3)


def test_noise_of_the_force_sensor_has_its_deviation():
    world = World(Scenario(wall=Wall(is_touched=True)), GEOMETRY)
    readings = np.array([world.measure_wrench() for _ in range(4000)])
    deviations = readings.std(axis=0)
    assert deviations == pytest.approx((0.5, 0.5, 0.05), rel=0.05)
