import math
import sys

from cycle_checks import differences
from hypothesis import given
from hypothesis import strategies as st
import pytest
from ruckig import InputParameter, Ruckig, Trajectory

from facade_manipulator.errors import ManipulatorError, ParameterError
from facade_manipulator.motion.limits import calculate, CarriageMotion, MotionLimits, PathLimiter

PERIOD = 0.01
LIMITS = MotionLimits(speed=0.5, acceleration=3.0, jerk=150.0)
SLACK = 1.0 + 1e-6

positions = st.tuples(*[st.floats(-0.4, 0.4)] * 3)
speeds = st.tuples(*[st.floats(-2.0, 2.0)] * 3)


def within_limits(*motions):
    """Tell whether a drive that is sent these positions is within limits."""
    speed, acceleration, jerk = differences([one.position for one in motions], PERIOD)
    return (speed <= LIMITS.speed * SLACK and acceleration <= LIMITS.acceleration * SLACK
            and jerk <= LIMITS.jerk * SLACK)


def way_to_rest(limiter, motion):
    motions = [motion]
    for state in limiter.stop(motion):
        motions.append(limiter.advance(motions[-1], state))
    return motions[1:]


def follow(limiter, motion, target, velocity):
    return limiter.reach(motion, target, velocity) or limiter.chase(motion, target, velocity)


@given(targets=st.lists(st.tuples(positions, speeds, st.booleans()), min_size=1, max_size=30))
def test_targets_and_stops_keep_speed_acceleration_and_jerk(
        targets):
    limiter, motions, stop = PathLimiter(LIMITS, PERIOD), [CarriageMotion((0.0, 0.0, 0.0))] * 3, ()
    for target, velocity, stops in targets:
        if stops and stop:
            motions.append(stop[0])
            stop = stop[1:]
        else:
            motions.append(follow(limiter, motions[-1], target, velocity))
            stop = way_to_rest(limiter, motions[-1])
        assert within_limits(*motions[-4:], *stop)


@given(stream=st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 3), min_size=20, max_size=60))
def test_near_targets_reached_and_chased_keep_the_limits(stream):
    limiter, motions = PathLimiter(LIMITS, PERIOD), [CarriageMotion((0.0, 0.0, 0.0))] * 3
    target, velocity = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for pushes in stream:  # a target within limits, or just beyond
        velocity = tuple(
            min(max(v + 1.05 * LIMITS.acceleration * PERIOD * push, -0.52), 0.52)
            for v, push in zip(velocity, pushes, strict=True))
        target = tuple(p + PERIOD * v for p, v in zip(target, velocity, strict=True))
        motions.append(follow(limiter, motions[-1], target, velocity))
    assert within_limits(*motions, *way_to_rest(limiter, motions[-1]))


@given(target=positions, velocity=speeds)
def test_stop_ends_at_rest(target, velocity):
    limiter, motion = PathLimiter(LIMITS, PERIOD), CarriageMotion((0.0, 0.0, 0.0))
    for _ in range(20):
        motion = follow(limiter, motion, target, velocity)
    stop = way_to_rest(limiter, motion)
    assert len(stop) < 100
    assert not stop or stop[-1].at_rest
    assert limiter.stop((stop or [motion])[-1]) == []


def test_reversing_carriage_is_not_at_rest():
    turning = CarriageMotion((0.0,) * 3, (0.0,) * 3, (3.0, 0.0, 0.0))
    assert not turning.at_rest
    assert PathLimiter(LIMITS, PERIOD).stop(turning)


def test_target_inside_the_limits_is_reached_exactly():
    limiter = PathLimiter(LIMITS, PERIOD)
    motion = CarriageMotion((0.1, 0.2, 0.3))
    after = limiter.reach(motion, (0.1 + 1e-5, 0.2, 0.3), (0.0,) * 3)
    assert after.position == (0.1 + 1e-5, 0.2, 0.3)


def test_chase_from_rest_is_straight():
    limiter, motion = PathLimiter(LIMITS, PERIOD), CarriageMotion((0.0, 0.0, 0.0))
    target = (0.2, -0.1, 0.05)
    for _ in range(200):
        motion = follow(limiter, motion, target, (0.0, 0.0, 0.0))
        x, y, z = motion.position
        assert y == pytest.approx(-0.5 * x, abs=1e-9)
        assert z == pytest.approx(0.25 * x, abs=1e-9)
    assert motion.position == pytest.approx(target, abs=1e-12)
    assert motion.at_rest


def test_chase_catches_and_follows_a_moving_target():
    limiter, motion = PathLimiter(LIMITS, PERIOD), CarriageMotion((0.0, 0.0, 0.0))
    exact = 0
    for k in range(1, 200):
        t = k * PERIOD
        target = (0.1 + 0.1 * math.sin(2.0 * t), -0.05 * math.sin(2.0 * t), 0.02)
        velocity = (0.2 * math.cos(2.0 * t), -0.1 * math.cos(2.0 * t), 0.0)
        motion = follow(limiter, motion, target, velocity)
        exact = exact + 1 if motion.position == target else 0
    assert exact > 100


small = st.floats(-1e-12, 1e-12)


@given(speed=st.floats(-0.49, 0.49), apart=st.tuples(small, small, small),
       sign=st.sampled_from((-1.0, 1.0)), beyond=st.tuples(*[st.integers(-4, 4)] * 3))
def test_acceleration_rounded_beyond_its_limit_has_a_path(
        speed, apart, sign, beyond):
    limiter = PathLimiter(LIMITS, PERIOD)
    acceleration = tuple(
        sign * LIMITS.acceleration * (1.0 + n * sys.float_info.epsilon) for n in beyond)
    motion = CarriageMotion((-0.1, 0.1, 0.0), tuple(speed + a for a in apart), acceleration)
    assert way_to_rest(limiter, motion)[-1].at_rest
    limiter.chase(motion, (-0.05, 0.15, 0.05), (0.0, 0.0, 0.0))


def test_jerk_below_the_acceleration_is_rejected():
    with pytest.raises(ParameterError, match='jerk = 1 m/s'):
        MotionLimits(acceleration=3.0, jerk=1.0)


# inputs of one axis that users of ruckig have reported as "error in step 1" (issues 100 and 160)
@pytest.mark.parametrize(('position', 'velocity', 'acceleration', 'target', 'limits'), [
    (0.02853333333333339, 0.6800000000000006, 7.999999999999993, 0.0, (1.0, 10.0, 100.0)),
    (-0.04895883258572608, 1.425883388427091e-14, -2.370282711878416e-12, -0.04895883258572691,
     (5.0, 10.0, 150.0)),
    (0.0, 0.0, 0.0, 0.012, (0.2, 0.6, 6.0))])
def test_path_is_found_where_ruckig_has_none(
        position, velocity, acceleration, target, limits):
    plan, trajectory = InputParameter(1), Trajectory(1)
    plan.current_position, plan.target_position = [position], [target]
    plan.current_velocity, plan.current_acceleration = [velocity], [acceleration]
    plan.max_velocity, plan.max_acceleration, plan.max_jerk = ([limit] for limit in limits)
    calculate(Ruckig(1), plan, trajectory)
    assert trajectory.at_time(trajectory.duration)[0] == pytest.approx([target], abs=1e-8)
    assert plan.max_jerk == [limits[2]]


def test_negative_speed_limit_has_no_path():
    plan = InputParameter(1)
    plan.max_velocity, plan.max_acceleration, plan.max_jerk = [-1.0], [1.0], [1.0]
    with pytest.raises(ManipulatorError, match='no path inside the motion limits'):
        calculate(Ruckig(1), plan, Trajectory(1))
