"""Assignment of measurements to levels of the wall, and the rail's pose at the start."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.estimation.history import Measurement
from facade_manipulator.estimation.rail_pose_model import (
    DistanceSensor,
    PoseSensor,
    Y,
    YAW,
)
from facade_manipulator.estimation.start import FirstMeasurements, start_at_wall
from facade_manipulator.estimation.wall_depth_levels import Channel, Level, OUTLIER

PERIOD = 0.01
SIGMA = 3e-4
PLACES = np.array(((-0.5, 0.0, 0.0), (0.5, 0.02, 0.0)))


def channel(*levels):
    sensor = DistanceSensor('left', (Y,), 1e-4, 0.0, (0.0, 0.0, 0.0), 0.45)
    return Channel(sensor, [Level(offset) for offset in (0.0, *levels)])


def decide(channel, residuals, begin=0.0):
    """Return the measurements with their levels, and the events."""
    measurements = []
    events = []
    for number, residual in enumerate(residuals):
        stamp = begin + number * PERIOD
        measurement = Measurement('left', stamp, 0.0, SIGMA**2)
        measurements.append(measurement)
        event = channel.decide(measurement, residual, SIGMA, is_coasting=False)
        if event:
            events.append(event)
    return measurements, events


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


def yaw_channel():
    sensor = PoseSensor('pose.theta', (YAW,), 1e-4, 0.0, (0.0, 0.0, 0.0), 0.0)
    return Channel(sensor, [Level(0.0)])


@pytest.mark.parametrize(
    ('residual', 'event'),
    [
        (0.03, 'new level at +30.0 mrad'),
        (2e-3, 'measurements agree with each other, 2.0 mrad off the estimate'),
    ],
)
def test_events_of_a_yaw_are_in_milliradians(residual, event):
    _, events = decide(yaw_channel(), [residual] * 40)
    assert events == [event]


def test_return_of_a_yaw_is_reported_in_milliradians():
    measurement = Measurement('pose.theta', 10.0, 0.0, SIGMA**2)
    event = yaw_channel().decide(measurement, 1e-3, 5e-3, is_coasting=False)
    assert 'at +0.0 mrad' in event
    assert event.endswith('with a deviation of 5.0 mrad')


def test_yaw_in_another_unit_is_rejected_in_radians():
    with pytest.raises(
        InputError, match='30 rad .* 20 rad; next: publish it in radians'
    ):
        yaw_channel().receive(0.0, 0.0, 30.0)


def test_window_panes_are_outliers_and_make_no_level():
    seen = channel()
    random = np.random.default_rng(1)
    is_pane = random.random(500) < 0.5
    residuals = np.where(is_pane, random.uniform(0.3, 3.0, 500), 0.0)
    measurements, events = decide(seen, residuals)
    assert {one.level for one in measurements} == {0.0, OUTLIER}
    assert not events


def test_outliers_that_agree_near_a_level_increase_variance():
    measurements, (event,) = decide(channel(), [2e-3] * 40)
    found = next(one for one in measurements if one.spread)
    assert event == 'measurements agree with each other, 2.0 mm off the estimate'
    assert found.level == OUTLIER
    assert found.spread == pytest.approx(2e-3)


def test_configured_level_is_used_at_once_and_kept():
    seen = channel(-0.03)
    assert decide(seen, [-0.03])[0][0].level == -0.03
    assert seen.counts == {'other level': 1}
    for k in range(1, Channel.MOST):
        decide(seen, [0.1 * k] * 40, begin=k)
    # the oldest found level was replaced
    offsets = [level.offset for level in seen.levels]
    found = [0.1 * k for k in range(2, Channel.MOST)]
    assert offsets == pytest.approx([0.0, -0.03, *found])


def distances(wall, y, yaw, offsets=(0.0, 0.0)):
    found = []
    for (sx, sy, _), offset in zip(PLACES, offsets, strict=True):
        gap = wall + offset - y - np.sin(yaw) * sx - np.cos(yaw) * sy
        found.append(gap / np.cos(yaw))
    return found


# y below half the 30 mm between the levels: a larger y is likelier another level
@given(
    st.floats(-0.014, 0.014),
    st.floats(-0.01, 0.01),
    st.floats(0.3, 0.6),
    st.sampled_from([(0.0, 0.0), (-0.03, 0.0), (0.0, -0.03)]),
    st.booleans(),
)
def test_start_finds_wall_y_and_yaw(y, yaw, wall, offsets, is_known):
    y *= is_known  # y begins at 0 otherwise
    measured = distances(wall, y, yaw, offsets)
    found = start_at_wall(wall * is_known, PLACES, measured, [0.0, -0.03])
    assert found == pytest.approx((wall, y, yaw), abs=2e-4)


@pytest.mark.parametrize('known', [0.0, 0.45])
def test_start_by_one_sensor_assumes_no_yaw(known):
    found = start_at_wall(known, PLACES[1:], [0.43], [0.0])
    assert found == pytest.approx((0.45, 0.0, 0.0))


def test_densest_cluster_between_panes_is_the_wall():
    random = np.random.default_rng(2)
    for _ in range(300):
        first = FirstMeasurements()
        drift = 5e-3 * np.linspace(0.0, 1.0, 40)
        wall = 0.45 + drift + 2e-4 * random.standard_normal(40)
        through = random.permutation(40) < 25
        behind = wall + random.uniform(0.3, 3.0, 40)
        for k, value in enumerate(np.where(through, behind, wall)):
            first.add(k * PERIOD, value)
        assert first.suffice(0.4)
        assert not first.suffice(2.0)
        assert first.densest() == pytest.approx(0.4525, abs=4e-3)


def test_start_forgets_measurements_before_a_silence():
    first = FirstMeasurements()
    for stamp in (0.0, 0.1, 0.2):
        first.add(stamp, 0.45)
    first.add(20.0, 0.5)
    assert not first.suffice(20.0)
    for stamp in (20.1, 20.2, 20.35):
        first.add(stamp, 0.5)
    assert first.suffice(20.4)
    assert first.densest() == 0.5
    assert first.begin == 20.0
