"""Remaining gap when each drive stops independently."""

from dataclasses import replace
import math

from hypothesis import assume, given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.stopping_distances import (
    least_distance,
    Separation,
    StoppingAnalysis,
)
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.limits import CarriageMotion, MotionLimits, PathLimiter

LIMITS = MotionLimits()
SUDDEN = replace(LIMITS, jerk=1e4)  # a path that has almost no acceleration to reduce
GAP = 0.02
PERIOD = 0.01
ROUNDING_OF_THE_PATH = (
    0.0005  # m: the path to rest is jerk-limited and sampled, the bound is not
)
share = st.floats(-1.0, 1.0)
shares = st.tuples(share, share, share)


# the neighbour continues at full speed
@pytest.mark.parametrize(
    ('limits', 'deceleration', 'delay', 'left'),
    [
        (SUDDEN, 6.0, 0.0, GAP),
        (LIMITS, 6.0, 0.0, 0.0154),
        (SUDDEN, 1.5, 0.0, -0.0633),
        (SUDDEN, 6.0, 0.02, GAP - 0.5 * 0.02),
    ],
)
def test_minimum_distance_depends_on_deceleration_and_delay(
    limits, deceleration, delay, left
):
    assert least_distance(GAP, limits, deceleration, delay) == pytest.approx(
        left, abs=3e-4
    )


@given(st.floats(1.0, 12.0), st.floats(0.0, 0.05))
def test_lower_speed_limit_keeps_a_larger_distance(deceleration, delay):
    slower = replace(LIMITS, speed=0.25)
    faster = replace(LIMITS, speed=0.5)
    slow = least_distance(GAP, slower, deceleration, delay)
    fast = least_distance(GAP, faster, deceleration, delay)
    assert slow >= fast - 1e-4  # resolution of the search over speeds


def brake_together(motion: CarriageMotion) -> float:
    """Return the minimum of q3 - q1 on the path to rest [m]."""
    path = PathLimiter(LIMITS, PERIOD).stop(motion)
    return min(q3 - q1 for (q1, _, q3), _, _ in path)


def stop_alone(speed: float, deceleration: float, delay: float, time: float) -> float:
    """Return the displacement of a carriage [m] at a time [s] after the failure."""
    slowing = min(max(0.0, time - delay), abs(speed) / deceleration)
    braking = math.copysign(0.5 * deceleration * slowing**2, speed)
    return speed * (min(time, delay) + slowing) - braking


def possible_acceleration(speed: float) -> float:
    """Return the acceleration [m/s²] from which a carriage does not exceed the speed limit."""
    most = math.sqrt(2.0 * LIMITS.jerk * (LIMITS.speed - abs(speed)))
    return min(LIMITS.acceleration, most)


@pytest.mark.long
@given(shares, shares, st.floats(3.0, 12.0), st.floats(0.0, 0.03))
def test_no_allowed_motion_is_closer_than_the_minimum(
    speeds, accelerations, deceleration, delay
):
    velocity = tuple(LIMITS.speed * share for share in speeds)
    acceleration = []
    for speed, share in zip(velocity, accelerations, strict=True):
        acceleration.append(share * possible_acceleration(speed))
    motion = CarriageMotion((0.0, 0.0, 0.0), velocity, tuple(acceleration))
    # gap from which the path to rest just keeps GAP
    start = GAP - brake_together(motion)
    bound = least_distance(GAP, LIMITS, deceleration, delay) - ROUNDING_OF_THE_PATH
    for left, right in ((delay, 0.0), (0.0, delay)):
        for step in range(150):
            time = 0.002 * step
            moved_left = stop_alone(velocity[0], deceleration, left, time)
            moved_right = stop_alone(velocity[2], deceleration, right, time)
            assert start + moved_right - moved_left >= bound


@pytest.mark.long
@given(
    st.tuples(share, share),
    st.tuples(st.sampled_from([-1.0, 0.0, 1.0]), st.sampled_from([-1.0, 0.0, 1.0])),
    st.sampled_from([0.0, 0.02]),
)
def test_separated_carriages_keep_the_bound_from_every_acceleration(
    speeds, accelerations, delay
):
    left, right = (LIMITS.speed * share for share in speeds)
    velocity = (left, right, right)
    acceleration_left, acceleration_right = (
        LIMITS.acceleration * sign for sign in accelerations
    )
    acceleration = (acceleration_left, acceleration_right, acceleration_right)
    motion = CarriageMotion((0.0, 0.0, 0.0), velocity, acceleration)
    limiter = PathLimiter(LIMITS, PERIOD)
    assume(limiter.allows(motion, LIMITS.speed))
    separation = StoppingAnalysis(
        Geometry(), LIMITS, DEFAULT_AXES, ControllerSettings()
    ).separation
    start = GAP - brake_together(motion)
    for (q1, _, q3), (v1, _, v3), _ in limiter.stop(motion):
        nearest = separation.distance(max(abs(v1), abs(v3)))
        start = max(start, nearest - (q3 - q1))
    bound = least_distance(GAP, LIMITS, separation.deceleration, delay)
    for late_left, late_right in ((delay, 0.0), (0.0, delay)):
        for step in range(150):
            time = 0.002 * step
            moved_left = stop_alone(left, separation.deceleration, late_left, time)
            moved_right = stop_alone(right, separation.deceleration, late_right, time)
            left_over = start + moved_right - moved_left
            assert left_over >= bound - ROUNDING_OF_THE_PATH


# a neighbour that stops at once; the times are those of 4, 3 and 2 cycles
SEPARATION = Separation(
    touching=0.0,
    deceleration=6.0,
    silence=0.04,
    window=0.015,
    tracking=0.03,
    tolerated=0.015,
    report=0.02,
)


@given(st.floats(0.01, 0.5), st.floats(0.0, 0.1))
def test_separation_allows_a_speed_from_its_distance(speed, farther):
    distance = SEPARATION.distance(speed)
    assert SEPARATION.speed(distance + farther + 1e-9) >= speed - 1e-6
    assert SEPARATION.speed(distance - farther - 0.001) < speed
