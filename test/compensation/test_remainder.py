"""Remainder of a trajectory that has jumped."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.compensation.correction import Remainder
from facade_manipulator.kinematics import MotionState, Pose, Twist, ZERO_STATE

START = 100.0
PERIOD = 0.005
lengths = st.floats(-0.2, 0.2)
poses = st.builds(Pose, lengths, lengths, lengths)
twists = st.builds(Twist, lengths, lengths, lengths)
motions = st.builds(MotionState, poses, twists)
constants = st.floats(0.02, 2.0)


@given(motions, constants, st.floats(0.01, 2.0))
def test_remainder_begins_with_the_jump_and_decays_smoothly(jump, constant, elapsed):
    remainder = Remainder(constant)
    remainder.add(START, jump)
    begun = remainder.at(START)
    late = remainder.at(START + 20.0 * constant)
    assert begun.position == pytest.approx(tuple(jump.position), abs=1e-12)
    assert begun.velocity == pytest.approx(tuple(jump.velocity), abs=1e-12)
    assert late.position == pytest.approx((0.0,) * 3, abs=1e-7)
    assert remainder.at(START + 41.0 * constant) == ZERO_STATE
    now = START + elapsed
    before = remainder.at(now - 1e-5).position
    after = remainder.at(now + 1e-5).position
    slope = np.subtract(after, before) / 2e-5
    assert remainder.at(now).velocity == pytest.approx(slope, abs=1e-3)


@given(
    st.lists(
        st.tuples(st.floats(-0.1, 0.1), st.floats(-1.0, 1.0), st.floats(-5.0, 5.0)),
        min_size=2,
        max_size=60,
    ),
    st.floats(0.005, 0.1),
    st.floats(0.005, 0.1),
)
def test_trajectory_with_its_remainders_stays_within_the_bound(pieces, slow, fast):
    """Each piece of the trajectory begins with a position, velocity and acceleration."""
    fade = Remainder(slow)
    brake = Remainder(fast)
    reached = motion(0.0, 0.0)
    beyond = 0.0
    highest = np.zeros(3)  # of position, velocity and acceleration
    for number, (p, v, a) in enumerate(pieces):
        begin = START + 2.0 * number * PERIOD
        fade.add(begin, motion(reached.position.x - p, 0.0))
        brake.add(begin, motion(0.0, reached.velocity.x - v))
        for t in (0.0, PERIOD, 2.0 * PERIOD):
            reached = motion(p + v * t + 0.5 * a * t * t, v + a * t)
            magnitudes = np.abs((reached.position.x, reached.velocity.x, a))
            highest = np.maximum(highest, magnitudes)
            total = reached.plus(fade.at(begin + t)).plus(brake.at(begin + t))
            beyond = max(beyond, abs(total.position.x))
    position, velocity, acceleration = highest
    from_velocity = 2.0 * (slow + fast / math.e) * velocity
    bound = position + from_velocity + fast**2 * acceleration
    assert beyond <= bound + 1e-9


@given(
    st.lists(
        st.tuples(
            st.floats(-0.1, 0.1),
            st.floats(-1.0, 1.0),
            st.floats(-5.0, 5.0),
            st.floats(1.0, 2.0),
        ),
        min_size=2,
        max_size=60,
    ),
    st.floats(0.005, 0.1),
)
def test_remainder_with_changing_time_constant_stays_within_the_bound(pieces, least):
    """Each piece has a position, velocity, acceleration, and a multiple of the time constant."""
    remainder = Remainder(least)
    reached = motion(0.0, 0.0)
    beyond = 0.0
    highest = np.zeros(3)  # of position, velocity and acceleration
    for number, (p, v, a, factor) in enumerate(pieces):
        begin = START + 2.0 * number * PERIOD
        remainder.add(begin, reached.minus(motion(p, v)), factor * least)
        for t in (0.0, PERIOD, 2.0 * PERIOD):
            reached = motion(p + v * t + 0.5 * a * t * t, v + a * t)
            magnitudes = np.abs((reached.position.x, reached.velocity.x, a))
            highest = np.maximum(highest, magnitudes)
            total = reached.plus(remainder.at(begin + t))
            beyond = max(beyond, abs(total.position.x))
    position, velocity, acceleration = highest
    from_velocity = 4.0 * least * velocity
    from_acceleration = 2.0 * least**2 * acceleration
    bound = 4.0 * (2.0 * position + from_velocity + from_acceleration)
    assert beyond <= bound + 1e-9


@given(
    st.lists(st.floats(1.0, 5.8), min_size=200, max_size=200), st.floats(0.002, 0.02)
)
def test_remainder_decays_for_any_change_of_its_time_constant(factors, step):
    """The measure of the remainder is the Lyapunov function of the proof."""
    least = 0.015
    before = math.inf
    remainder = Remainder(least)
    scale = least * math.sqrt(5.8)
    remainder.add(START, motion(1.0, 0.0))
    for number, factor in enumerate(factors):
        time = START + number * step
        remainder.add(time, ZERO_STATE, least * factor)
        left = remainder.at(time)
        x = left.position.x
        v = scale * left.velocity.x
        measure = x * x + math.sqrt(2.0) * x * v + v * v
        assert measure <= before * (1.0 + 1e-9)
        before = measure


def motion(x, vx):
    return MotionState(Pose(x, 0.0, 0.0), Twist(vx, 0.0, 0.0))
