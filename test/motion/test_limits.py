import math

from cycle_checks import differences
from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.motion.limits import CarriageMotion, MotionLimits, PathLimiter

PERIOD = 0.01
LIMITS = MotionLimits(speed=0.5, acceleration=3.0, jerk=150.0)
ORIGIN = CarriageMotion((0.0, 0.0, 0.0))

positions = st.tuples(*[st.floats(-0.4, 0.4)] * 3)
speeds = st.tuples(*[st.floats(-2.0, 2.0)] * 3)


def requires_limits(motions):
    bounds = LIMITS.speed, LIMITS.acceleration, LIMITS.jerk
    for found, bound in zip(
            differences([one.position for one in motions], PERIOD), bounds, strict=True):
        assert found <= bound * (1.0 + 1e-6)


def path_to_rest(limiter, motion):
    motions = [motion]
    for state in limiter.stop(motion)[1:]:
        motions.append(limiter.advance(motions[-1], state))
    return motions[1:]


def follow(limiter, motion, target, velocity):
    return limiter.reach(motion, target, velocity) or limiter.chase(motion, target, velocity)


@given(targets=st.lists(st.tuples(positions, speeds, st.booleans()), min_size=1, max_size=30))
def test_targets_and_stops_keep_speed_acceleration_and_jerk(targets):
    limiter, motions, stop = PathLimiter(LIMITS, PERIOD), [ORIGIN] * 3, []
    for target, velocity, is_stopping in targets:
        if is_stopping and stop:
            motions.append(stop.pop(0))
        else:
            motions.append(follow(limiter, motions[-1], target, velocity))
            stop = path_to_rest(limiter, motions[-1])
            assert len(stop) < 100 and [*motions, *stop][-1].at_rest
        requires_limits([*motions[-4:], *stop])


@given(stream=st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 3), min_size=20, max_size=60))
def test_near_targets_reached_and_chased_keep_the_limits(stream):
    limiter, motions = PathLimiter(LIMITS, PERIOD), [ORIGIN] * 3
    target, velocity = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for pushes in stream:  # a target within limits, or just beyond
        velocity = tuple(
            min(max(v + 1.05 * LIMITS.acceleration * PERIOD * push, -0.52), 0.52)
            for v, push in zip(velocity, pushes, strict=True))
        target = tuple(p + PERIOD * v for p, v in zip(target, velocity, strict=True))
        motions.append(follow(limiter, motions[-1], target, velocity))
    requires_limits([*motions, *path_to_rest(limiter, motions[-1])])


def test_reversing_carriage_is_not_at_rest():
    turning = CarriageMotion((0.0,) * 3, (0.0,) * 3, (3.0, 0.0, 0.0))
    assert not turning.at_rest
    assert path_to_rest(PathLimiter(LIMITS, PERIOD), turning)


def test_chase_from_rest_is_straight():
    limiter, motion, target = PathLimiter(LIMITS, PERIOD), ORIGIN, (0.2, -0.1, 0.05)
    for _ in range(200):
        motion = follow(limiter, motion, target, (0.0, 0.0, 0.0))
        x, y, z = motion.position
        assert (y, z) == pytest.approx((-0.5 * x, 0.25 * x), abs=1e-9)
    assert motion.position == pytest.approx(target, abs=1e-12)
    assert motion.at_rest


def test_moving_target_is_caught_and_then_reached_exactly():
    limiter, motion = PathLimiter(LIMITS, PERIOD), ORIGIN
    for cycle in range(1, 200):
        wave, rate = math.sin(2.0 * cycle * PERIOD), 2.0 * math.cos(2.0 * cycle * PERIOD)
        target = 0.1 + 0.1 * wave, -0.05 * wave, 0.02
        motion = follow(limiter, motion, target, (0.1 * rate, -0.05 * rate, 0.0))
        assert cycle < 99 or motion.position == target


def test_jerk_below_the_acceleration_is_rejected():
    with pytest.raises(ParameterError, match='jerk = 1 m/s'):
        MotionLimits(acceleration=3.0, jerk=1.0)
