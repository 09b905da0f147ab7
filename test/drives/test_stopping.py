"""Start parameters of the driver, with which no carriage touches its neighbour."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import pytest

from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.guard import Guard
from facade_manipulator.drives.stopping_distances import StoppingAnalysis
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.limits import MotionLimits

GEOMETRY = Geometry()
LIMITS = MotionLimits()
CONTROLLER = ControllerSettings()


def analysis(
    geometry=GEOMETRY, limits=LIMITS, controller=CONTROLLER, **axis
) -> StoppingAnalysis:
    axes = tuple(replace(one, **axis) for one in DEFAULT_AXES)
    return StoppingAnalysis(geometry, limits, axes, controller)


def test_default_parameters_keep_the_carriages_apart():
    found = analysis()
    found.check()
    distances = [outcome.distance for outcome in found.outcomes]
    assert distances == pytest.approx([0.0154, 0.0054], abs=1e-4)
    speed = found.separation.speed(GEOMETRY.carriage_gap)
    assert speed == pytest.approx(0.294, abs=0.001)
    distance = found.separation.distance(LIMITS.speed)
    assert distance == pytest.approx(0.0518, abs=1e-4)


def test_weak_brake_stops_beyond_the_stroke():
    limits = replace(LIMITS, speed=0.5, acceleration=3.0)
    assert analysis(limits=limits, stop_deceleration=6.0).overshoot == 0.0
    stopping = 0.5**2 / (2.0 * 1.5)  # m
    planned = 0.5**2 / (2.0 * 3.0)  # m
    weak = analysis(limits=limits, stop_deceleration=1.5)
    assert weak.overshoot == pytest.approx(stopping - planned)


@pytest.mark.parametrize('lag', [0.0, 0.01])
def test_worst_axis_and_drive_lag_determine_the_separation(lag):
    first, middle, last = DEFAULT_AXES
    longer = middle.following_error_time + 0.03
    worse = replace(
        middle,
        stop_deceleration=4.0,
        following_error_window=0.02,
        following_error_time=longer,
    )
    axes = (first, worse, last)
    controller = replace(CONTROLLER, drive_lag=lag)
    found = StoppingAnalysis(GEOMETRY, LIMITS, axes, controller).separation
    sound = analysis().separation
    assert found.deceleration == 4.0
    assert found.window == 0.02
    assert found.silence - sound.silence == pytest.approx(lag)
    assert found.report - sound.report == pytest.approx(lag)
    assert found.tracking - sound.tracking == pytest.approx(0.03 + lag)


def test_loop_slows_down_when_measured_carriages_are_near():
    start = Geometry(carriage_offsets=(0.0, 0.0, -0.02))
    guard = Guard(start, analysis(start).separation, limit_margin=0.0)
    assert guard.allowed_speed((-0.1, 0.1, 0.0)) > LIMITS.speed
    slow = analysis().separation.speed(0.03)
    assert guard.allowed_speed((-0.05, 0.1, 0.0)) == pytest.approx(slow)


@pytest.mark.parametrize('number', [0, 1])
def test_gap_of_an_outcome_keeps_carriages_apart(number):
    found = analysis(
        replace(GEOMETRY, carriage_gap=analysis().outcomes[number].gap + 1e-6)
    )
    assert found.outcomes[number].distance >= -1e-6


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'stop_deceleration': 1.5}, r'0\.041\d+ m'),
        (
            {'stop_deceleration': 1.5, 'limit_margin': 0.1},
            'if all three brake at once.*-0.073 m.*increase .* axes.stop_deceleration',
        ),
        (
            {
                'geometry': replace(GEOMETRY, carriage_length=0.015),
                'following_error_window': 0.002,
            },
            'if one brakes independently and reports.*0.00539 m.*increase geometry.carriage_gap '
            'to at least 0.0296 m, axes.stop_deceleration or limits.jerk, or reduce limits.speed',
        ),
        (
            {
                'geometry': replace(GEOMETRY, carriage_gap=0.0012),
                'following_error_window': 0.0009,
            },
            'at geometry.carriage_gap.* 0 m/s',
        ),
        (
            {'following_error_window': 0.016},
            'following_error_window = 0.016 m is above.* 0.015 m',
        ),
        (
            {'controller': replace(CONTROLLER, drive_lag=0.04)},
            'at which the drives would trip',
        ),
        (
            {'limits': replace(LIMITS, speed=0.61)},
            'limits.speed = 0.61 m/s is above axes.max_speed',
        ),
        (
            {'limits': MotionLimits(speed=0.1, acceleration=0.01, jerk=0.1)},
            'the time to brake from limits.speed = 10.2 s is above .* = 4.8 s; next: increase '
            'limits.acceleration, or reduce limits.speed to at most 0.0455 m/s',
        ),
        (
            {'limits': MotionLimits(speed=0.0455, acceleration=0.01, jerk=0.1)},
            None,
        ),
        (  # on the stroke of 1 m it reaches only 0.447 m/s
            {'limits': MotionLimits(speed=0.5, acceleration=0.1, jerk=5.0)},
            None,
        ),
        ({'following_error_window': 0.015}, None),  # at the bound, as the others
        (
            {
                'geometry': replace(GEOMETRY, carriage_gap=0.05),
                'stop_deceleration': 2.9,
                'limit_margin': 0.0015,
            },
            None,
        ),
        (
            {
                'geometry': replace(GEOMETRY, carriage_gap=0.0147),
                'following_error_window': 0.01,
            },
            None,
        ),
    ],
)
def test_parameters_without_a_safe_stop_are_rejected(changes, message):
    with pytest.raises(ParameterError, match=message) if message else nullcontext():
        analysis(**changes).check()


def test_carriages_that_touch_at_the_gap_have_no_tolerance():
    geometry = replace(GEOMETRY, carriage_length=GEOMETRY.carriage_gap)
    tolerated = analysis(geometry=geometry).separation.tolerated
    assert tolerated == pytest.approx(GEOMETRY.carriage_gap)
