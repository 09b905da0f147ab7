"""To which level measurements belong, and where the rail is at the start."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.estimation.channel import Channel, Level, MOST, OUTLIER, wall_levels
from facade_manipulator.estimation.history import Measurement
from facade_manipulator.estimation.model import DistanceSensor, Wall, Y
from facade_manipulator.estimation.start import FirstMeasurements, start_at_wall

PERIOD, SIGMA = 0.01, 3e-4
PLACES = np.array(((-0.5, 0.0, 0.0), (0.5, 0.02, 0.0)))


def channel(*levels):
    return Channel(DistanceSensor(
        'left', (Y,), 1e-4, 0.0, (0.0, 0.0, 0.0), Wall(0.45)), wall_levels(levels))


def decide(channel, residuals, begin=0.0):
    """Return the measurements with their levels, and the events."""
    measurements = [Measurement('left', begin + k * PERIOD, 0.0, SIGMA ** 2)
                    for k in range(len(residuals))]
    return measurements, [event for one, residual in zip(measurements, residuals, strict=True)
                          if (event := channel.decide(one, residual, SIGMA))]


def test_mullion_becomes_a_level_after_a_quarter_second():
    seen = channel()
    decide(seen, [0.0] * 50)
    measurements, events = decide(seen, [-0.03] * 40, 0.5)
    found = next(k for k, one in enumerate(measurements) if one.level != OUTLIER)
    assert 0.2 <= found * PERIOD <= 0.3
    assert events == ['new level at -30.0 mm']
    (wall, mullion), _ = decide(seen, [0.0, -0.0302], 2.0)
    assert wall.level == 0.0
    assert mullion.level == pytest.approx(-0.03, abs=1e-4)


def test_panes_are_outliers_and_no_level():
    seen, random = channel(), np.random.default_rng(1)
    measurements, _ = decide(seen, np.where(
        random.random(500) < 0.5, random.uniform(0.3, 3.0, 500), 0.0))
    assert {one.level for one in measurements} == {0.0, OUTLIER}
    assert len(seen.levels) == 1


def test_configured_level_is_used_at_once():
    seen = channel(-0.03)
    assert decide(seen, [-0.03])[0][0].level == -0.03
    assert seen.counts == {'other level': 1}


def test_measurements_agreeing_near_the_wall_loosen_the_state():
    seen = channel()
    measurements, _ = decide(seen, [2e-3] * 40)
    found = next(one for one in measurements if one.spread)
    assert seen.counts['found again'] == 1
    assert found.level == OUTLIER and found.spread == pytest.approx(2e-3)


def test_new_level_replaces_the_oldest_found_one():
    seen = channel(-0.03)
    seen.levels.extend(Level(0.1 * k, is_configured=False) for k in range(1, MOST - 1))
    decide(seen, [5.0] * 40)
    offsets = [level.offset for level in seen.levels]
    assert len(offsets) == MOST and {0.0, -0.03, 5.0} <= set(offsets) and 0.1 not in offsets


def distances(wall, y, yaw, offsets=(0.0, 0.0)):
    return [(wall + offset - y - np.sin(yaw) * sx - np.cos(yaw) * sy) / np.cos(yaw)
            for (sx, sy, _), offset in zip(PLACES, offsets, strict=True)]


@given(st.floats(-0.02, 0.02), st.floats(-0.01, 0.01), st.floats(0.3, 0.6))
def test_start_finds_y_and_yaw(y, yaw, wall):
    assert start_at_wall(wall, PLACES, distances(wall, y, yaw), [0.0]) == pytest.approx(
        (wall, y, yaw), abs=2e-4)


@pytest.mark.parametrize('offsets', [(-0.03, 0.0), (0.0, -0.03), (0.0, 0.0)])
def test_start_with_one_sensor_before_mullion_keeps_yaw(offsets):
    wall, y, yaw = start_at_wall(0.0, PLACES, distances(0.45, 0.0, 0.004, offsets), [0.0, -0.03])
    assert (wall, y, yaw) == pytest.approx((0.45, 0.0, 0.004), abs=1e-3)


@pytest.mark.parametrize('known', [0.0, 0.45])
def test_start_by_one_sensor_assumes_no_yaw(known):
    assert start_at_wall(known, PLACES[1:], [0.43], [0.0]) == pytest.approx((0.45, 0.0, 0.0))


def test_densest_values_are_of_the_wall_between_panes():
    random = np.random.default_rng(2)
    for _ in range(300):
        first = FirstMeasurements()
        wall = 0.45 + 5e-3 * np.linspace(0.0, 1.0, 30) + 2e-4 * random.standard_normal(30)
        through = random.permutation(30) < 19
        for k, value in enumerate(np.where(through, wall + random.uniform(0.3, 3.0, 30), wall)):
            first.add(k * PERIOD, value)
        assert first.span(0.3) == pytest.approx(0.29)
        assert first.densest() == pytest.approx(0.4525, abs=4e-3)
    assert first.span(2.0) == 0.0  # the sensor is silent
