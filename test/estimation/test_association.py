"""What measurements belong to, and where the rail is at the start."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.estimation.association import Association, Levels, MOST, OUTLIER
from facade_manipulator.estimation.start import densest, start_at_wall

PERIOD, SIGMA = 0.01, 3e-4
PLACES = ((-0.5, 0.0, 0.0), (0.5, 0.02, 0.0))


def decide(association, residuals, begin=0.0):
    return [association.decide(begin + k * PERIOD, residual, SIGMA)
            for k, residual in enumerate(residuals)]


def test_a_mullion_is_a_level_after_a_quarter_of_a_second_and_at_once_the_next_time():
    association = Association(Levels(), 1e-3)
    decide(association, [0.0] * 50)
    verdicts = decide(association, [-0.03] * 40, 0.5)
    found = next(k for k, verdict in enumerate(verdicts) if verdict.level != OUTLIER)
    assert 0.2 <= found * PERIOD <= 0.3
    assert verdicts[found].event == 'another level of -30.0 mm'
    assert decide(association, [0.0], 2.0)[0].level == 0.0
    assert decide(association, [-0.0302], 2.1)[0].level == pytest.approx(-0.03, abs=1e-4)


def test_panes_are_outliers_and_no_level():
    association = Association(Levels(), 1e-3)
    random = np.random.default_rng(1)
    verdicts = decide(association, np.where(
        random.random(500) < 0.5, random.uniform(0.3, 3.0, 500), 0.0))
    assert {verdict.level for verdict in verdicts} == {0.0, OUTLIER}
    assert association.record.counts['levels found'] == 0


def test_a_known_level_needs_no_learning():
    association = Association(Levels((-0.03,)), 1e-3)
    assert decide(association, [-0.03])[0].level == -0.03
    assert association.record.counts == {'other level': 1}


def test_what_agrees_a_little_beside_the_wall_finds_the_state_again():
    association = Association(Levels(), 1e-3)
    found = next(verdict for verdict in decide(association, [2e-3] * 40) if verdict.event)
    assert association.record.counts['found again'] == 1
    assert found.level == OUTLIER and found.spread == pytest.approx(2e-3)


def test_of_many_levels_those_longest_unused_go_and_those_of_the_settings_stay():
    levels = Levels((-0.03,))
    for k in range(30):
        levels.add(0.1 + 0.01 * k, float(k))
    offsets = [level.offset for level in levels.known]
    assert len(offsets) == MOST and {0.0, -0.03} <= set(offsets) and max(offsets) > 0.38


@given(st.floats(-0.02, 0.02), st.floats(-0.01, 0.01), st.floats(0.3, 0.6))
def test_a_start_finds_y_and_yaw(y, yaw, distance):
    start = start_at_wall(distance, PLACES, seen(distance, y, yaw), [0.0])
    assert (start.y, start.yaw) == pytest.approx((y, yaw), abs=2e-4)


def seen(distance, y, yaw, offsets=(0.0, 0.0)):
    return [(distance + offset - y - np.sin(yaw) * sx - np.cos(yaw) * sy) / np.cos(yaw)
            for (sx, sy, _), offset in zip(PLACES, offsets, strict=True)]


@pytest.mark.parametrize('offsets', [(-0.03, 0.0), (0.0, -0.03), (0.0, 0.0)])
def test_a_start_with_one_sensor_before_a_known_mullion_is_no_yaw(offsets):
    start = start_at_wall(0.0, PLACES, seen(0.45, 0.0, 0.004, offsets), [0.0, -0.03])
    assert start.yaw == pytest.approx(0.004, abs=3e-4)
    assert start.distance == pytest.approx(0.45, abs=1e-3)


def test_a_start_by_one_sensor_is_no_yaw_and_one_without_a_wall_no_y():
    assert start_at_wall(0.45, PLACES[1:], [0.43], [0.0])[:3] == pytest.approx((0.45, 0.0, 0.0))
    assert start_at_wall(0.0, PLACES[1:], [0.43], [0.0])[:3] == pytest.approx((0.45, 0.0, 0.0))


def test_a_start_with_all_sensors_before_mullions_needs_the_distance():
    start = start_at_wall(0.45, PLACES, seen(0.45, 0.002, 0.0, (-0.03, -0.03)), [0.0, -0.03])
    assert start.y == pytest.approx(0.002, abs=1e-4) or abs(start.y - 0.032) < 1e-3


def test_the_densest_are_of_the_wall_even_if_most_look_through_panes():
    random = np.random.default_rng(2)
    for _ in range(300):
        wall = 0.45 + 5e-3 * np.linspace(0.0, 1.0, 30) + 2e-4 * random.standard_normal(30)
        through = random.permutation(30) < 19
        values = np.where(through, wall + random.uniform(0.3, 3.0, 30), wall)
        assert densest(values.tolist()) == pytest.approx(0.4525, abs=4e-3)
