"""What is left of the gap when each drive stops on its own."""

from __future__ import annotations

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.motion.braking import Brake, highest_speed, least_distance, overshoot
from facade_manipulator.motion.limits import CarriageMotion, MotionLimits, PathLimiter, Separation

LIMITS = MotionLimits()
SUDDEN = replace(LIMITS, jerk=1e4)  # a path without acceleration to lose, nearly
FASTEST = LIMITS.speed, LIMITS.acceleration
GAP, PERIOD = 0.02, 0.01
ROUNDING_OF_THE_PATH = 0.0005  # m: the path to rest is jerk-limited and sampled, the bound is not
shares = st.floats(-1.0, 1.0)


def stop(deceleration: float, delay: float = 0.0) -> Brake:
    return Brake(delay, deceleration)


def test_drives_braking_twice_as_hard_keep_the_gap():
    hard = stop(2.0 * LIMITS.acceleration)
    assert least_distance(GAP, SUDDEN, hard, hard) == pytest.approx(GAP, abs=1e-4)
    assert least_distance(GAP, LIMITS, hard, hard) == pytest.approx(0.0154, abs=1e-4)


def test_drives_braking_less_hard_collide():
    weak = stop(1.5)
    assert least_distance(GAP, SUDDEN, weak, weak) == pytest.approx(-0.0633, abs=3e-4)


@pytest.mark.parametrize(('late', 'early', 'left'), [
    (stop(6.0, 0.02), stop(6.0), GAP - 0.5 * 0.02),
    (stop(6.0, 0.04), stop(math.inf), GAP - 0.5 * 0.04 - 0.5 ** 2 / 12.0),
])
def test_drive_stopping_first_costs_the_way_of_its_neighbour(late, early, left):
    for pair in ((late, early), (early, late)):
        assert least_distance(GAP, SUDDEN, *pair) == pytest.approx(left, abs=1e-4)


@given(st.floats(1.0, 12.0), st.floats(0.0, 0.05), st.floats(0.0, 0.05))
def test_slower_machine_keeps_a_larger_distance(deceleration, delay, earlier):
    left, right = stop(deceleration, delay), stop(6.0, earlier)
    assert least_distance(GAP, replace(LIMITS, speed=0.25), left, right) >= least_distance(
        GAP, LIMITS, left, right) - 1e-4  # the speeds that are tried


def brake_together(motion: CarriageMotion) -> float:
    """Return the minimum of q3 - q1 on the path to rest [m]."""
    path = [position for position, _, _ in PathLimiter(LIMITS, PERIOD).stop(motion)]
    return min(q3 - q1 for q1, _, q3 in [motion.position, *path])


def stop_alone(speed: float, brake: Brake, time: float) -> float:
    """Return how far a carriage has come at a time."""
    braking = abs(speed) / brake.deceleration
    slowing = min(max(0.0, time - brake.delay), braking)
    return speed * (min(time, brake.delay) + slowing) - math.copysign(
        0.5 * brake.deceleration * slowing ** 2, speed)


@pytest.mark.long
@given(st.tuples(shares, shares, shares), st.tuples(shares, shares, shares),
       st.floats(3.0, 12.0), st.floats(0.0, 0.03))
def test_no_allowed_motion_comes_nearer_than_the_bound(
        speeds, accelerations, deceleration, delay):
    velocity = tuple(LIMITS.speed * share for share in speeds)
    room = [min(1.0, (LIMITS.speed - abs(v)) * 2.0 * LIMITS.jerk / LIMITS.acceleration ** 2)
            for v in velocity]  # an acceleration that would leave the speed limit is none
    motion = CarriageMotion((0.0, 0.0, 0.0), velocity, tuple(
        LIMITS.acceleration * share * most ** 0.5
        for share, most in zip(accelerations, room, strict=True)))
    start = GAP - brake_together(motion)  # so that the path to rest just keeps the gap
    late, early = stop(deceleration, delay), stop(6.0)
    for left, right in ((late, early), (early, late)):
        least = min(
            start + stop_alone(velocity[2], right, time) - stop_alone(velocity[0], left, time)
            for time in [0.002 * step for step in range(150)])
        assert least >= least_distance(GAP, LIMITS, left, right) - ROUNDING_OF_THE_PATH


# --- a neighbour that stands dead

WINDOW, TOLERATED, DECELERATION = 0.015, 0.015, 6.0
SILENCE, TRACKING, REPORT = 4, 3, 2  # cycles
SEPARATION = Separation(
    0.0, DECELERATION, SILENCE * PERIOD, WINDOW, TRACKING * PERIOD, TOLERATED, REPORT * PERIOD)


@given(st.floats(0.01, 0.5))
def test_distance_of_a_speed_allows_that_speed_only(speed):
    distance = SEPARATION.distance(speed)
    assert SEPARATION.speed(distance + 1e-9) >= speed - 1e-6
    assert SEPARATION.speed(distance - 0.001) < speed


@given(st.floats(0.0, 0.1), st.floats(0.0, 0.1))
def test_allowed_speed_grows_with_the_distance(distance, other):
    near, far = sorted((distance, other))
    assert SEPARATION.speed(near) <= SEPARATION.speed(far)


def test_weak_brake_stops_beyond_the_stroke():
    assert overshoot(*FASTEST, 6.0) == 0.0
    assert overshoot(*FASTEST, 1.5) == pytest.approx(0.5 ** 2 / 3.0 - 0.5 ** 2 / 6.0)


def test_highest_speed_fulfils_its_condition():
    assert highest_speed(lambda speed: True, 0.5) == 0.5
    assert highest_speed(lambda speed: speed < 0.3, 0.5) == pytest.approx(0.3, abs=1e-3)
