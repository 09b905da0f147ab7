import math

from cycle_checks import require_limits
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.motion.limits import CarriageMotion, MotionLimits, PathLimiter

PERIOD = 0.01
LIMITS = MotionLimits(speed=0.5, acceleration=3.0, jerk=150.0)
ORIGIN = CarriageMotion((0.0, 0.0, 0.0))

vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


def positions_of(motions):
    return [motion.position for motion in motions]


def path_to_rest(limiter, motion):
    motions = [motion]
    for state in limiter.stop(motion)[1:]:
        motions.append(limiter.advance(motions[-1], state))
    return motions[1:]


def follow(limiter, motion, target, velocity):
    return limiter.reach(motion, target, velocity) or limiter.chase(
        motion, target, velocity
    )


@given(
    st.lists(
        st.tuples(
            st.sampled_from(('far', 'near', 'near', 'near', 'stop')), vectors, vectors
        ),
        min_size=1,
        max_size=60,
    )
)
def test_targets_and_stops_keep_speed_acceleration_and_jerk(steps):
    limiter = PathLimiter(LIMITS, PERIOD)
    motions = [ORIGIN] * 3
    stop = []
    target = (0.0, 0.0, 0.0)
    velocity = target
    for kind, place, push in steps:
        if kind == 'stop' and stop:
            motions.append(stop.pop(0))
            require_limits(positions_of([*motions[-4:], *stop]), LIMITS, PERIOD, 1e-6)
            continue
        if kind == 'near':  # a target within or just beyond the limits
            change = 0.0315 * np.array(push)
            velocity = np.clip(velocity + change, -0.52, 0.52)
            target = np.add(target, PERIOD * velocity)
        else:
            target = 0.4 * np.array(place)
            velocity = 2.0 * np.array(push)
        motion = follow(limiter, motions[-1], target.tolist(), velocity.tolist())
        motions.append(motion)
        stop = path_to_rest(limiter, motions[-1])
        assert len(stop) < 100
        assert [*motions, *stop][-1].at_rest
        require_limits(positions_of([*motions[-4:], *stop]), LIMITS, PERIOD, 1e-6)


def test_reversing_carriage_is_not_at_rest():
    at_origin = (0.0, 0.0, 0.0)
    turning = CarriageMotion(at_origin, at_origin, (3.0, 0.0, 0.0))
    assert not turning.at_rest
    assert path_to_rest(PathLimiter(LIMITS, PERIOD), turning)


def test_chase_from_rest_is_straight():
    limiter = PathLimiter(LIMITS, PERIOD)
    motion = ORIGIN
    target = (0.2, -0.1, 0.05)
    for _ in range(200):
        motion = follow(limiter, motion, target, (0.0, 0.0, 0.0))
        x, y, z = motion.position
        assert y == pytest.approx(-0.5 * x, abs=1e-9)
        assert z == pytest.approx(0.25 * x, abs=1e-9)
    assert motion.position == pytest.approx(target, abs=1e-12)
    assert motion.at_rest


def test_moving_target_is_caught_and_then_reached_exactly():
    limiter = PathLimiter(LIMITS, PERIOD)
    motion = ORIGIN
    for cycle in range(1, 200):
        wave = math.sin(2.0 * cycle * PERIOD)
        rate = 2.0 * math.cos(2.0 * cycle * PERIOD)
        target = 0.1 + 0.1 * wave, -0.05 * wave, 0.02
        motion = follow(limiter, motion, target, (0.1 * rate, -0.05 * rate, 0.0))
        assert cycle < 99 or motion.position == target


def test_jerk_below_the_acceleration_is_rejected():
    with pytest.raises(ParameterError, match='jerk = 1 m/s'):
        MotionLimits(acceleration=3.0, jerk=1.0)


@pytest.mark.parametrize(
    ('velocity', 'acceleration', 'is_allowed'),
    [
        (0.49, -2.9, True),
        (0.505, -2.9, False),  # too fast, although it brakes
        (0.495, 2.9, False),  # its acceleration ends at 0.523 m/s
    ],
)
def test_motion_must_be_inside_the_speed_and_remain_there(
    velocity, acceleration, is_allowed
):
    motion = CarriageMotion(
        ORIGIN.position, (velocity, 0.0, 0.0), (acceleration, 0.0, 0.0)
    )
    assert PathLimiter(LIMITS, PERIOD).allows(motion, LIMITS.speed) is is_allowed
