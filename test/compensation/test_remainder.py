"""Remainder of a trajectory that has jumped."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.compensation.correction import Remainder
from facade_manipulator.kinematics import MotionState, Pose, Twist, ZERO_STATE

START = 100.0
PERIOD = 0.005
poses = st.tuples(*[st.floats(-0.2, 0.2)] * 3).map(lambda values: Pose(*values))
motions = st.tuples(poses, poses).map(lambda parts: MotionState(parts[0], Twist(*parts[1])))
constants = st.floats(0.02, 2.0)


def remainder_of(*jumps, constant=0.1):
    """Return the remainder of jumps, each with its time after the start [s]."""
    remainder = Remainder()
    for after, jump in jumps:
        remainder.add(START + after, jump, constant)
    return remainder


@given(motions, constants)
def test_remainder_begins_with_the_jump_and_decays(jump, constant):
    remainder = remainder_of((0.0, jump), constant=constant)
    begun, late = remainder.at(START), remainder.at(START + 20.0 * constant)
    assert begun.position == pytest.approx(tuple(jump.position), abs=1e-12)
    assert begun.velocity == pytest.approx(tuple(jump.velocity), abs=1e-12)
    assert late.position == pytest.approx((0.0,) * 3, abs=1e-7)
    assert remainder.at(START + 41.0 * constant) == ZERO_STATE


@given(motions, constants, st.floats(0.01, 2.0))
def test_velocity_is_the_derivative_of_the_position(jump, constant, elapsed):
    remainder = remainder_of((0.0, jump), constant=constant)
    time, step = START + elapsed, 1e-5
    slope = [(b - a) / (2.0 * step) for a, b in zip(
        remainder.at(time - step).position, remainder.at(time + step).position, strict=True)]
    assert remainder.at(time).velocity == pytest.approx(slope, abs=1e-3)


@given(motions, motions, st.floats(0.0, 0.5), st.floats(0.0, 0.5))
def test_remainders_of_two_jumps_add(first, second, between, after):
    both = remainder_of((0.0, first), (between, second))
    alone = [remainder_of((0.0, first)), remainder_of((between, second))]
    time = START + between + after
    expected = alone[0].at(time).plus(alone[1].at(time))
    assert both.at(time).position == pytest.approx(tuple(expected.position), abs=1e-12)
    assert both.at(time).velocity == pytest.approx(tuple(expected.velocity), abs=1e-10)


@given(st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-1.0, 1.0), st.floats(-5.0, 5.0)),
                min_size=2, max_size=60), st.floats(0.005, 0.1))
def test_trajectory_with_its_remainder_stays_within_the_bound(pieces, constant):
    """Each piece of the trajectory begins with a position, velocity and acceleration."""
    remainder, reached, beyond = Remainder(), MotionState(Pose(0.0, 0.0, 0.0), Twist(0, 0, 0)), 0.0
    highest = np.zeros(3)  # of position, velocity and acceleration
    for number, (p, v, a) in enumerate(pieces):
        begin = START + 2.0 * number * PERIOD
        trajectory = motion(p, v)
        remainder.add(begin, reached.minus(trajectory), constant)
        for t in (0.0, PERIOD, 2.0 * PERIOD):
            reached = motion(p + v * t + 0.5 * a * t * t, v + a * t)
            highest = np.maximum(highest, np.abs((reached.position.x, reached.velocity.x, a)))
            beyond = max(beyond, abs(reached.position.x + remainder.at(begin + t).position.x))
    position, velocity, acceleration = highest
    assert beyond <= position + 2.0 * constant * velocity + constant ** 2 * acceleration + 1e-9


def motion(x, vx):
    return MotionState(Pose(x, 0.0, 0.0), Twist(vx, 0.0, 0.0))


@pytest.mark.long
@given(st.lists(st.floats(0.01, 10.0), min_size=2, max_size=20), st.floats(0.0, 1.0))
def test_longer_time_constants_keep_the_remainder_bounded(constants, share):
    remainder, time = Remainder(), START
    remainder.add(time, motion(0.1, 0.0), constants[0])
    for constant in constants[1:]:
        time += share * constant
        remainder.add(time, ZERO_STATE, constant)
        assert -1e-9 <= remainder.at(time + share).position.x <= 0.1 + 1e-9
