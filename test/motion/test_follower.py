from contextlib import suppress
from dataclasses import replace
import itertools
import math

from cycle_checks import differences
from hypothesis import example, given, settings
from hypothesis import strategies as st
import pytest

from facade_manipulator.errors import (
    CarriageGapError,
    InputError,
    ManipulatorError,
    SetpointLimitError,
    StrokeLimitError,
)
from facade_manipulator.motion.follower import (
    Activity,
    SetpointFollower,
    StreamSettings,
    TOLERATED,
)
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import Setpoint

PERIOD = 0.01
LIMITS = MotionLimits(speed=0.5, acceleration=3.0, jerk=150.0)
HOME = (-0.1, 0.1, 0.0)


def inside(*path):
    for q in itertools.chain(*path):
        if abs(q) > 0.5:
            raise StrokeLimitError('q', q, math.copysign(0.5, q), 'm', 'above')


def follower(check=inside):
    made = SetpointFollower(StreamSettings(), LIMITS, PERIOD, check)
    made.reset(HOME)
    return made


def sine(time, amplitude=0.05):
    wave, rate = amplitude * math.sin(time), amplitude * math.cos(time)
    return Setpoint(time, (HOME[0] + wave, HOME[1] + wave, HOME[2]), (rate, rate, 0.0))


def run(made, start, end, stream=sine, ahead=0.03):
    """Stream and sample for a while, as the driver does; return the positions and their times."""
    cycles = range(round(start / PERIOD), round(end / PERIOD))
    commanded = []
    for k in cycles:
        now = k * PERIOD
        if stream is not None:
            made.add(stream(now + ahead), now)
        commanded.append((now + 0.02, made.sample(now + 0.02)))
    return commanded


def test_carriages_follow_the_stream_between_its_points():
    made = follower()
    made.add(sine(0.0), 0.0)
    for time, position in run(made, 0.0, 3.0)[60:]:
        # off the grid of the stream: ahead and the sampling instants differ by one period
        assert position == pytest.approx(sine(time).position, abs=1e-7)
    assert made.activity is Activity.FOLLOWING


@pytest.mark.parametrize(('ahead', 'is_smooth'), [(0.06, True), (0.03, False)])
def test_mean_velocities_smoothed_by_later_setpoints_make_no_jerk(ahead, is_smooth):
    period, interval = PERIOD / 5, PERIOD
    made = SetpointFollower(StreamSettings(), LIMITS, period, inside)
    made.reset(HOME)
    for k in range(1500):
        now = k * period
        if k % 5 == 0:
            here, before = sine(now + ahead, 0.2), sine(now + ahead - interval, 0.2)
            mean = tuple((b - a) / interval for a, b in zip(
                before.position, here.position, strict=True))
            made.add(here._replace(velocity=mean), now)
        if k == 500:
            made.limited_cycles = 0
        made.sample(now + 0.02)
    assert (made.limited_cycles == 0) is is_smooth


def test_smoothed_velocity_stays_near_that_of_the_sender():
    made = SetpointFollower(StreamSettings(), LIMITS, PERIOD / 5, inside)
    made.reset(HOME)
    for k, step in enumerate((0.0, 0.0, 0.0005)):  # 50 mm/s: more than a mean velocity is late by
        position = tuple(q + step for q in HOME)
        made.add(Setpoint(0.05 + 0.01 * k, position, (0.0,) * 3), 0.0)
    assert made._stream.newest(2)[0][1].velocity == pytest.approx(
        [0.5 * LIMITS.acceleration * 0.01] * 3)


def test_silent_stream_brakes_and_is_followed_again():
    made = follower()
    run(made, 0.0, 1.0)
    assert not made.at_rest
    silent = run(made, 1.0, 2.0, stream=None)
    assert made.activity is Activity.HOLDING
    assert made.at_rest
    assert made.brakes == 1
    assert silent[-1][1] == silent[-2][1]
    run(made, 2.0, 3.0)
    assert made.activity is Activity.FOLLOWING


def test_hold_forgets_the_stream():
    made = follower()
    run(made, 0.0, 1.0)
    made.hold()
    run(made, 1.0, 1.3, stream=None)
    assert made.at_rest


def test_nothing_moves_before_the_first_setpoint():
    made = follower()
    assert {position for _, position in run(made, 0.0, 0.5, stream=None)} == {HOME}


def test_follower_without_reset_commands_nothing():
    made = SetpointFollower(StreamSettings(), LIMITS, PERIOD, inside)
    assert made.at_rest
    with pytest.raises(InputError, match='reset first'):
        made.sample(0.0)
    with pytest.raises(InputError, match='holds no position'):
        made.add(sine(0.0), 0.0)


@pytest.mark.parametrize('setpoint, reason', [
    (Setpoint(1.0, (math.nan, 0.1, 0.0), (0.0,) * 3), 'far_setpoint'),
    (Setpoint(1.0, HOME, (0.0, math.nan, 0.0)), 'far_setpoint'),
    (Setpoint(1.0, HOME, (0.0, math.inf, 0.0)), 'far_setpoint'),
    (Setpoint(0.7, HOME, (0.0,) * 3), 'stale'),
    (Setpoint(math.nan, HOME, (0.0,) * 3), 'stale'),
    (Setpoint(2.5, HOME, (0.0,) * 3), 'future'),
])
def test_bad_setpoint_is_rejected_with_its_reason(setpoint, reason):
    made = follower()
    with pytest.raises(ManipulatorError) as rejection:
        made.add(setpoint, 1.0)
    assert rejection.value.reason == reason
    assert made.sample(1.0) == HOME


def test_setpoint_for_a_commanded_time_is_rejected():
    made = follower()
    run(made, 0.0, 1.0)
    for late in (1.005, 0.98):
        with pytest.raises(InputError, match='commanded already') as rejection:
            made.add(sine(late), 1.0)
        assert rejection.value.reason == 'out_of_order'
    run(made, 1.0, 1.1)
    assert made.activity is Activity.FOLLOWING


@pytest.mark.parametrize('strays', [[50], [50, 51, 52, 53]])
def test_setpoints_far_ahead_give_way_to_later_ones(strays):
    made, farthest = follower(), 0.0
    for k in range(100):
        now = k * PERIOD
        if k in strays:
            ahead = sine(now + 0.5)
            made.add(ahead._replace(position=tuple(q + 0.02 for q in ahead.position)), now)
        made.add(sine(now + 0.03), now)
        away = [abs(a - b) for a, b in zip(
            made.sample(now + 0.02), sine(now + 0.02).position, strict=True)]
        farthest = max(farthest, *away) if k > 30 else 0.0
    assert farthest < 1e-4
    assert made.activity is Activity.FOLLOWING


def test_rejected_setpoint_leaves_the_stream_unchanged():
    made = follower()
    made.add(sine(0.03), 0.0)
    with pytest.raises(SetpointLimitError):
        made.add(Setpoint(0.02, (0.1, 0.3, 0.2), (0.0,) * 3), 0.0)
    assert [time for time, _ in made._stream.newest(9)] == [0.03]


@pytest.mark.parametrize('interval', [0.01, 0.03, 0.1])
@pytest.mark.parametrize('velocity', [0.1, 0.15, 0.2, 0.3, 0.45])
def test_velocity_with_constant_positions_moves_little(interval, velocity):
    made, farthest = follower(), 0.0
    for k in range(200):
        now = k * PERIOD
        if k % round(interval / PERIOD) == 0:
            with suppress(InputError):
                made.add(Setpoint(now + 0.03, HOME, (0.0, velocity, 0.0)), now)
        farthest = max(farthest, abs(made.sample(now + 0.02)[1] - HOME[1]))
    # 0.15 m/s are possible where a setpoint comes every 0.1 s, which are bridged before a brake
    most, silence = 0.25 * TOLERATED * LIMITS.acceleration * 0.1, 0.1
    assert farthest < most * silence + 0.5 * most ** 2 / LIMITS.acceleration + 0.003


@pytest.mark.parametrize('step', [-30.0, -5.0, 5.0, 30.0])
def test_stream_continues_when_the_clock_was_set(step):
    made = follower()
    run(made, 0.0, 1.0)
    positions = [made.motion.position] * 3
    for k in range(100, 200):
        now, true = k * PERIOD + step, k * PERIOD
        made.add(sine(true + 0.03)._replace(time=now + 0.03), now)
        positions.append(made.sample(now + 0.02))
    assert positions[-1] == pytest.approx(sine(2.01).position, abs=1e-6)
    assert made.activity is Activity.FOLLOWING
    assert differences(positions[3:], PERIOD)[1] <= LIMITS.acceleration * 1.001


@pytest.mark.parametrize(('position', 'error', 'reason'), [
    ((-0.1, 0.1, 0.06), SetpointLimitError, 'q3 to the setpoint = 0.06 m is above.*0.05 m'),
    ((-0.1, 0.6, 0.0), StrokeLimitError, '0.6')])
def test_far_or_impossible_first_setpoint_is_rejected(
        position, error, reason):
    with pytest.raises(error, match=reason):
        follower().add(Setpoint(1.0, position, (0.0,) * 3), 1.0)


@pytest.mark.parametrize('speed', [0.01, 0.5, 5.0])
def test_velocities_to_twice_the_highest_limit_are_accepted(speed):
    made = SetpointFollower(StreamSettings(), replace(LIMITS, speed=speed), PERIOD, inside)
    made.reset(HOME)
    made.change_limits(replace(LIMITS, speed=0.5 * speed))
    with pytest.raises(SetpointLimitError, match=f'above the bound {TOLERATED * speed:g} m/s'):
        made.add(Setpoint(0.1, HOME, (0.0, 1.001 * TOLERATED * speed, 0.0)), 0.0)
    made.add(Setpoint(0.1, HOME, (0.0, 0.999 * TOLERATED * speed, 0.0)), 0.0)


@pytest.mark.parametrize(('start', 'end', 'is_possible'), [  # by the most that a carriage can
    (-0.9, 0.9, True), (0.0, 0.9, True), (0.0, 1.1, False), (0.2, 0.9, False), (0.4, 0.4, True),
    (0.6, 0.6, False), (-0.6, -0.6, False)])
@pytest.mark.parametrize('mean', [-0.1, 0.0, 0.2])
def test_velocity_differs_from_its_mean_by_possible_accelerations(
        start, end, is_possible, mean):
    made, interval = follower(), 0.05
    most = 0.5 * TOLERATED * LIMITS.acceleration * interval
    made.add(Setpoint(0.1, HOME, (mean + start * most, 0.0, 0.0)), 0.0)
    after = Setpoint(0.1 + interval, (HOME[0] + mean * interval, *HOME[1:]), (
        mean + end * most, 0.0, 0.0))
    if is_possible:
        made.add(after, 0.0)
        return
    with pytest.raises(InputError, match='m/s, but its positions change by') as rejection:
        made.add(after, 0.0)
    assert rejection.value.reason == 'inconsistent'


@given(amplitude=st.floats(0.0, 0.2), rate=st.floats(0.5, 4.0), interval=st.floats(0.001, 0.09),
       backlash=st.floats(0.0, 0.0005))
def test_possible_motion_with_mean_velocities_is_accepted(
        amplitude, rate, interval, backlash):
    share = min(1.0, 0.5 / max(amplitude * rate, 1e-9), 3.0 / max(amplitude * rate ** 2, 1e-9))

    def at(time):
        position = HOME[0] + share * amplitude * math.sin(rate * time)
        return position + math.copysign(backlash, math.cos(rate * time))

    made = SetpointFollower(StreamSettings(first_step=0.5), LIMITS, PERIOD, inside)
    made.reset((at(0.0), *HOME[1:]))
    for k in range(1, 100):
        now = k * interval
        mean = (at(now) - at(now - interval)) / interval if k > 1 else 0.0
        made.add(Setpoint(now, (at(now), *HOME[1:]), (mean, 0.0, 0.0)), now)


def test_velocity_out_of_the_stroke_brakes_inside_it():
    made = SetpointFollower(StreamSettings(), LIMITS, PERIOD, inside)
    made.reset((-0.1, 0.45, 0.0))
    for k in range(60):
        now = k * PERIOD
        if 0.45 + 0.3 * now < 0.499:
            made.add(Setpoint(now + 0.03, (-0.1, 0.45 + 0.3 * now, 0.0), (0.0, 0.3, 0.0)), now)
        assert made.sample(now + 0.02)[1] <= 0.5
    assert 'q = 0.5' in made.last_rejection
    assert made.brakes >= 1


def reject(*_):
    raise StrokeLimitError('q1', 9.0, 0.5, 'm', 'above')


def test_rejected_path_ends_in_the_stop_checked_before():
    made = follower()
    run(made, 0.0, 1.0)
    made._check = reject
    run(made, 1.0, 2.0, stream=None)
    assert made.activity is Activity.HOLDING
    assert made.brakes == 1


def test_motion_without_a_path_brakes(monkeypatch):
    made = follower()
    run(made, 0.0, 1.0)

    def no_path(*_):
        raise ManipulatorError('no path inside the motion limits: Result.Error')

    monkeypatch.setattr(made._limiter, 'reach', lambda *_: None)
    monkeypatch.setattr(made._limiter, 'chase', no_path)
    run(made, 1.0, 2.0)
    assert made.activity is Activity.HOLDING
    assert 'no path' in made.last_rejection


def keeps_gap(*path):
    gap, bound = min(min(q3 - q1, q2 - q3) for q1, q2, q3 in path), 0.02
    if gap < bound:
        raise CarriageGapError('gap', gap, bound, 'm', 'below')


@given(swing=st.floats(0.0, 0.15), rate=st.floats(1.0, 5.0), phase=st.floats(0.0, 6.3),
       gaps=st.lists(st.integers(0, 149), max_size=4),
       holds=st.lists(st.integers(0, 149), max_size=2))
def test_every_path_to_rest_keeps_gap_and_limits(
        swing, rate, phase, gaps, holds):
    made = SetpointFollower(StreamSettings(), LIMITS, PERIOD, keeps_gap)
    made.reset((-0.03, 0.1, 0.0))

    def approach(time):  # the carriages swing, two of them against each other
        place, speed = swing * math.sin(rate * time + phase), swing * rate * math.cos(
            rate * time + phase)
        start = swing * math.sin(phase)
        return Setpoint(time, (-0.03 + place - start, 0.1, 0.5 * (start - place)),
                        (speed, 0.0, -0.5 * speed))

    commanded = [made.motion.position] * 3
    for cycle in range(150):
        now = cycle * PERIOD
        if cycle in holds:
            made.hold()
        if all(not 0 <= cycle - gap < 15 for gap in gaps):
            with suppress(ManipulatorError):
                made.add(approach(now + 0.03), now)
        commanded.append(made.sample(now + 0.02))
        keeps_gap(commanded[-1])
    for greatest, limit in zip(
            differences(commanded, PERIOD),
            (LIMITS.speed, LIMITS.acceleration, LIMITS.jerk), strict=True):
        assert greatest <= limit * 1.001


@given(st.lists(st.tuples(
    st.floats(allow_nan=True, allow_infinity=True),
    st.tuples(*[st.floats(-1.0, 1.0) | st.just(math.nan)] * 3),
    st.tuples(*[st.floats(-5.0, 5.0) | st.just(math.inf)] * 3)), max_size=20))
def test_arbitrary_setpoints_command_finite_targets_inside_the_limits(stream):
    made = follower()
    before = HOME
    for k, (time, position, velocity) in enumerate(stream):
        now = k * PERIOD
        for stamp in (time, now + 0.01):
            try:
                made.add(Setpoint(stamp, position, velocity), now)
            except ManipulatorError:
                pass
        after = made.sample(now + 0.02)
        for p, q in zip(before, after, strict=True):
            assert math.isfinite(q) and abs(q) <= 0.5
            assert abs(q - p) <= LIMITS.speed * PERIOD * (1 + 1e-9)
        before = after


def towards_the_border(time):
    """Two carriages that reach 0.4 m/s and brake at 2 m/s² to come to rest 5 mm inside."""
    fast, hard, end = 0.4, 2.0, 0.495 - HOME[1]
    ramp = fast / hard
    last = end / fast - ramp  # when it begins to brake, after it began to move
    up, down = min(max(time, 0.0), ramp), min(max(time - last - ramp, 0.0), ramp)
    way = 0.5 * hard * up ** 2 + fast * max(0.0, min(time, last + ramp) - ramp) + (
        fast * down - 0.5 * hard * down ** 2)
    speed = hard * (up - down)
    return Setpoint(time, (HOME[0] + way, HOME[1] + way, HOME[2]), (speed, speed, 0.0))


lowered = st.builds(
    lambda speed, acceleration, ramp: MotionLimits(speed, acceleration, acceleration / ramp),
    st.floats(0.01, 0.5), st.floats(0.1, 3.0), st.floats(0.02, 1.0))


@pytest.mark.long
@settings(max_examples=25)
@given(st.floats(0.01, 1.2), lowered)
@example(0.06, MotionLimits(0.2, 1.0, 3.0))  # at 0.16 m/s, and still accelerating
@example(0.08, MotionLimits(0.5, 3.0, 5.0))
def test_lowered_limits_never_accelerate_nor_leave_the_stroke(
        time, limits):
    made, unchanged = follower(), follower()
    for one in (made, unchanged):
        one.add(towards_the_border(0.0), 0.0)
        before = run(one, 0.0, time, towards_the_border)
    to_rest = run(unchanged, round(time / PERIOD) * PERIOD, time + 0.4, stream=None)
    most = max(limits.speed, *speeds_of(before[-2:]), *speeds_of([*before[-1:], *to_rest]))
    made.change_limits(limits)
    after = run(made, round(time / PERIOD) * PERIOD, time + 2.0, towards_the_border)
    assert max(speeds_of([*before[-1:], *after])) <= most + 1e-6
    assert max(speeds_of(after[40:])) <= limits.speed + 1e-6
    for _, position in after:
        inside(position)


def speeds_of(commanded):
    return [abs(b - a) / PERIOD for (_, before), (_, after) in itertools.pairwise(commanded)
            for a, b in zip(before, after, strict=True)]


@pytest.mark.parametrize('held', [1, 3, 7, 10])
def test_held_commands_continue_with_the_velocity_after_braking(held):
    made = follower()

    def fast(time):
        return sine(time, 0.39)

    made.reset(fast(-0.5).position)
    run(made, -0.5, 0.0, fast)
    before, speed = made.motion.position, made.motion.velocity[0]
    pause = held * PERIOD
    made.wait(pause)
    after = [position for _, position in run(made, pause, pause + 1.5, fast)]
    left = max(0.0, speed - LIMITS.acceleration * pause)
    assert 0.0 <= after[0][0] - before[0] <= (left + 0.01 * LIMITS.jerk * PERIOD) * PERIOD
    start = tuple(p - left * PERIOD * share for p, share in zip(before, (1, 1, 0), strict=True))
    for found, limit in zip(differences([start, before, *after], PERIOD),
                            (LIMITS.speed, LIMITS.acceleration, LIMITS.jerk), strict=True):
        assert found <= limit * 1.001
    assert made.activity is Activity.FOLLOWING
    assert after[-1] == pytest.approx(fast(pause + 1.51).position, abs=1e-6)


def test_held_commands_without_path_end_at_rest():
    made = follower()
    run(made, -0.5, 0.0)
    made._check = reject
    made.wait(PERIOD)
    assert made.at_rest
    made.wait(PERIOD)


@given(stall_at=st.floats(0.0, 0.6), stall=st.floats(0.0, 0.08), late=st.floats(0.0, 0.026),
       late_cycle=st.integers(0, 80))
def test_delayed_stream_ends_at_rest_at_its_end(
        stall_at, stall, late, late_cycle):
    made, way = follower(), (0.05, 0.05, 0.05)

    def smooth(time):
        share = min(max(time / 0.5, 0.0), 1.0)
        blend, slope = share * share * (3.0 - 2.0 * share), 12.0 * share * (1.0 - share)
        return Setpoint(time, tuple(q + blend * w for q, w in zip(HOME, way, strict=True)),
                        tuple(slope * w for w in way))

    sent = 0
    for cycle in range(250):
        now = cycle * PERIOD
        if not stall_at < now < stall_at + stall:
            while sent <= cycle:  # the delayed targets arrive together
                made.add(smooth(sent * PERIOD + 0.06), now)
                sent += 1
        delay = late if cycle == late_cycle else 0.0
        position = made.sample(now + 0.02 + delay)
    assert position == pytest.approx([q + w for q, w in zip(HOME, way, strict=True)], abs=1e-9)
    assert made.activity is Activity.FOLLOWING
