from contextlib import suppress
from dataclasses import replace
import itertools
import math

from cycle_checks import differences, require_limits
from hypothesis import example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.drives.guard import MechanismCheck
from facade_manipulator.errors import ManipulatorError, StrokeLimitError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.follower import (
    Activity,
    SetpointFollower,
    StreamSettings,
)
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import Setpoint

PERIOD = 0.01  # s
LEAD = 0.02  # s, after which a command is reached
LIMITS = MotionLimits(speed=0.5, acceleration=3.0, jerk=150.0)
HOME = (-0.1, 0.1, 0.0)
REST = (0.0,) * 3


def inside(*path):
    for q in itertools.chain(*path):
        if abs(q) > 0.5:
            raise StrokeLimitError('q', q, math.copysign(0.5, q), 'm', 'above')


class ReplaceableCheck:
    """Check of a path that a test replaces during the motion."""

    def __init__(self):
        self.check = inside

    def __call__(self, *path):
        self.check(*path)


def follower(check=inside, start=HOME, period=PERIOD, limits=LIMITS, **stream):
    made = SetpointFollower(StreamSettings(**stream), limits, period, check)
    made.reset(start)
    return made


def sine(time, amplitude=0.05):
    wave = amplitude * math.sin(time)
    rate = amplitude * math.cos(time)
    position = (HOME[0] + wave, HOME[1] + wave, HOME[2])
    return Setpoint(time, position, (rate, rate, 0.0))


def run(made, start, end, stream=sine, *allowed):
    """Feed a stream and sample it as the driver does; return the commanded positions [m]."""
    commanded = []
    for cycle in range(round(start / PERIOD), round(end / PERIOD)):
        now = cycle * PERIOD
        if stream is not None:
            with suppress(*allowed):
                made.add(stream(now + 0.03), now)
        commanded.append(made.sample(now + LEAD))
    return commanded


def move(time, way=0.05, duration=0.5):
    """Return a setpoint of a common displacement [m] with maximum acceleration at both ends."""
    share = min(max(time / duration, 0.0), 1.0)
    moved = way * share * share * (3.0 - 2.0 * share)
    speed = 6.0 * way / duration * share * (1.0 - share)
    return Setpoint(time, tuple(q + moved for q in HOME), (speed,) * 3)


# --- the stream


def test_carriages_follow_the_stream_between_its_points():
    made = follower()
    made.add(sine(0.0), 0.0)
    for cycle, position in enumerate(run(made, 0.0, 3.0)):
        # The sampling instants are between the points of the stream, one period apart.
        wanted = sine(cycle * PERIOD + LEAD).position
        assert cycle < 60 or position == pytest.approx(wanted, abs=1e-7)
    assert made.activity is Activity.FOLLOWING


@pytest.mark.parametrize(('ahead', 'is_smooth'), [(0.06, True), (0.03, False)])
def test_mean_velocities_smoothed_by_later_setpoints_avoid_jerk(ahead, is_smooth):
    made = follower(period=PERIOD / 5)
    counts = []
    for cycle in range(1500):
        now = cycle * PERIOD / 5
        if cycle % 5 == 0:
            here = sine(now + ahead, 0.2)
            before = sine(now + ahead - PERIOD, 0.2)
            mean = np.subtract(here.position, before.position) / PERIOD
            made.add(here._replace(velocity=tuple(mean.tolist())), now)
        made.sample(now + LEAD)
        counts.append(made.limited_cycles)
    assert (counts[-1] == counts[500]) is is_smooth


def test_sudden_start_of_a_stream_hardly_moves_carriages_backwards():
    """Smoothing changes a mean velocity by at most half an interval of full acceleration."""
    interval = 2.0 * PERIOD
    made = follower(start=REST)
    number = 0
    positions = []
    for cycle in range(100):
        now = cycle * PERIOD
        while number * interval <= now + 0.06:
            time = number * interval
            speed = 0.1 if time > 0.5 else 0.0
            way = 0.1 * max(time - 0.5, 0.0)
            made.add(Setpoint(time, (way,) * 3, (speed,) * 3), now)
            number += 1
        positions += made.sample(now + LEAD)
    assert min(positions) >= -0.25 * LIMITS.acceleration * interval**2
    assert max(positions) > 0.03


def test_silent_or_forgotten_stream_brakes_and_resumes():
    made = follower()
    assert set(run(made, 0.0, 0.5, stream=None)) == {HOME}
    for number, forget in enumerate((lambda: None, made.hold), start=1):
        run(made, number, number + 0.5)
        assert made.activity is Activity.FOLLOWING
        assert not made.at_rest
        forget()
        silent = run(made, number + 0.5, number + 1.0, stream=None)
        assert made.activity is Activity.HOLDING
        assert made.at_rest
        assert made.brakes == number
        assert silent[-1] == pytest.approx(silent[-2], abs=0.0)


def test_follower_without_reset_rejects_sampling():
    made = SetpointFollower(StreamSettings(), LIMITS, PERIOD, inside)
    assert made.at_rest
    with pytest.raises(ManipulatorError, match='call reset'):
        made.sample(0.0)
    with pytest.raises(ManipulatorError, match='no position is held'):
        made.add(sine(0.0), 0.0)


@pytest.mark.parametrize('strays', [[50], [50, 51, 52, 53]])
def test_later_setpoints_replace_setpoints_far_ahead(strays):
    made = follower()
    for cycle in range(100):
        now = cycle * PERIOD
        if cycle in strays:
            stray = sine(now + 0.5)
            position = tuple(q + 0.02 for q in stray.position)
            made.add(stray._replace(position=position), now)
        (position,) = run(made, now, now + PERIOD)
        assert cycle <= 30 or position == pytest.approx(
            sine(now + LEAD).position, abs=1e-4
        )


@given(
    stall_at=st.floats(0.0, 0.6),
    stall=st.floats(0.0, 0.08),
    late=st.floats(0.0, 0.026),
    late_cycle=st.integers(0, 80),
)
def test_delayed_stream_still_reaches_its_end(stall_at, stall, late, late_cycle):
    made = follower()
    sent = 0
    for cycle in range(250):
        now = cycle * PERIOD
        if not stall_at < now < stall_at + stall:
            while sent <= cycle:  # the delayed targets arrive together
                made.add(move(sent * PERIOD + 0.06), now)
                sent += 1
        position = made.sample(now + LEAD + (late if cycle == late_cycle else 0.0))
    assert position == pytest.approx([q + 0.05 for q in HOME], abs=1e-9)
    assert made.activity is Activity.FOLLOWING


# --- rejected setpoints


@pytest.mark.parametrize(
    ('setpoint', 'reason', 'message'),
    [
        (
            Setpoint(2.03, (math.nan, 0.1, 0.0), REST),
            'far_setpoint',
            'step of q1 = nan',
        ),
        (
            Setpoint(2.03, (-0.1, 0.1, 0.06), REST),
            'far_setpoint',
            'q3 = 0.06 m is above .* 0.05 m',
        ),
        (Setpoint(2.03, (-0.1, 0.6, 0.0), REST), 'stroke', '0.6'),
        (
            Setpoint(2.03, HOME, (0.0, math.nan, 0.0)),
            'far_setpoint',
            'velocity of q2 = nan',
        ),
        (
            Setpoint(2.03, HOME, (0.0, 0.4, 0.0)),
            'inconsistent',
            'm/s contradicts the mean velocity',
        ),
        (Setpoint(1.7, HOME, REST), 'stale', 'setpoint is 0.300 s old'),
        (Setpoint(math.nan, HOME, REST), 'stale', 'setpoint is nan s old'),
        (Setpoint(2.51, HOME, REST), 'future', 'setpoint is 0.510 s from the future'),
        (Setpoint(2.015, HOME, REST), 'out_of_order', 'present command'),
        (Setpoint(1.98, HOME, REST), 'out_of_order', 'present command'),
    ],
)
def test_bad_setpoint_is_rejected_and_changes_nothing(setpoint, reason, message):
    made = follower()
    unchanged = follower()
    for one in (made, unchanged):
        run(one, 0.0, 2.01, lambda time: Setpoint(time, HOME, REST))
    with pytest.raises(ManipulatorError, match=message) as rejection:
        made.add(setpoint, 2.0)
    assert rejection.value.reason == reason

    def later(time):
        return sine(time - 2.04)._replace(time=time)

    assert run(made, 2.01, 2.5, later) == run(unchanged, 2.01, 2.5, later)


@pytest.mark.parametrize('speed', [0.01, 0.5, 5.0])
def test_velocities_to_twice_the_speed_limit_are_accepted(speed):
    made = follower(limits=replace(LIMITS, speed=speed))
    made.change_limits(replace(LIMITS, speed=0.5 * speed))
    with pytest.raises(ManipulatorError, match=f'above the limit {2.0 * speed:g} m/s'):
        made.add(Setpoint(0.1, HOME, (0.0, 2.001 * speed, 0.0)), 0.0)
    made.add(Setpoint(0.1, HOME, (0.0, 1.999 * speed, 0.0)), 0.0)


@given(
    amplitude=st.floats(0.0, 0.2),
    rate=st.floats(0.5, 4.0),
    interval=st.floats(0.001, 0.09),
    backlash=st.floats(0.0, 0.0005),
)
def test_possible_motion_with_mean_velocities_is_accepted(
    amplitude, rate, interval, backlash
):
    by_speed = 0.5 / max(amplitude * rate, 1e-9)
    by_acceleration = 3.0 / max(amplitude * rate**2, 1e-9)
    share = min(1.0, by_speed, by_acceleration)

    def at(time):
        position = HOME[0] + share * amplitude * math.sin(rate * time)
        return position + math.copysign(backlash, math.cos(rate * time))

    made = follower(start=(at(0.0), *HOME[1:]), first_step=0.5)
    for number in range(1, 100):
        now = number * interval
        mean = (at(now) - at(now - interval)) / interval if number > 1 else 0.0
        position = (at(now), *HOME[1:])
        made.add(Setpoint(now, position, (mean, 0.0, 0.0)), now)


@pytest.mark.parametrize('interval', [0.01, 0.03, 0.1])
@pytest.mark.parametrize('velocity', [0.1, 0.15, 0.2, 0.3, 0.45])
def test_velocity_contradicting_constant_positions_moves_little(interval, velocity):
    made = follower()
    farthest = 0.0
    for cycle in range(200):
        now = cycle * PERIOD
        if cycle % round(interval / PERIOD) == 0:
            with suppress(ManipulatorError):
                made.add(Setpoint(now + 0.03, HOME, (0.0, velocity, 0.0)), now)
        commanded = made.sample(now + LEAD)[1]
        farthest = max(farthest, abs(commanded - HOME[1]))
    # 0.15 m/s are possible if setpoints arrive every 0.1 s, the longest interval without a brake
    most = 0.5 * LIMITS.acceleration * 0.1
    silence = 0.1
    assert farthest < most * silence + 0.5 * most**2 / LIMITS.acceleration + 0.003


# --- the path to rest


def reject(*_):
    raise ManipulatorError('no path')


def test_motion_without_allowed_path_brakes_on_previous_path(monkeypatch):
    made = follower()
    before = run(made, 0.0, 1.0)
    monkeypatch.setattr(made._limiter, 'stop', reject)
    commanded = run(made, 1.0, 2.0)
    assert made.activity is Activity.HOLDING
    assert made.brakes == 1
    assert made.last_brake == 'no path'
    require_limits(before + commanded, LIMITS, PERIOD)


@pytest.mark.parametrize('rate', [50, 100, 250, 333, 500])
def test_every_position_of_a_brake_was_checked(rate):
    period = 1.0 / rate
    checked = set()
    made = follower(lambda *path: checked.update(map(tuple, path)), period=period)
    braked = []
    for cycle in range(2 * rate):
        now = cycle * period
        if now % 0.4 < 0.2:
            with suppress(ManipulatorError):
                made.add(sine(now + 0.03, 0.2), now)
        else:
            made.hold()
        position = made.sample(now + LEAD)
        if made.activity is Activity.BRAKING:
            braked.append(position)
    assert len(braked) > 10
    assert [position for position in braked if position not in checked] == []


@settings(max_examples=12)
@given(
    rate=st.sampled_from((50, 100, 250, 333, 500)),
    amplitude=st.floats(0.02, 0.1),
    speed=st.floats(0.1, 0.4),
    silence=st.floats(0.2, 0.9),
)
def test_stream_along_the_gap_never_commands_a_rejected_target(
    rate, amplitude, speed, silence
):
    check = MechanismCheck(Geometry())
    period = 1.0 / rate
    start = (-0.021, 0.021, 0.0)
    made = follower(check, start, period)
    frequency = speed / amplitude
    for cycle in range(rate):
        now = cycle * period
        time = now + 0.03
        way = amplitude * (1.0 - math.cos(frequency * time))
        rate_of_way = amplitude * frequency * math.sin(frequency * time)
        nearer = 0.001 * math.sin(20.0 * time)
        nearing = 0.02 * math.cos(20.0 * time)
        target = (start[0] + way + nearer, start[1] + way, way)
        if now < silence:
            with suppress(ManipulatorError):
                made.add(
                    Setpoint(
                        time,
                        target,
                        (rate_of_way + nearing, rate_of_way, rate_of_way),
                    ),
                    now,
                )
        check.exact(made.sample(now + LEAD))


def keeps_gap(*path):
    gap = min(min(q3 - q1, q2 - q3) for q1, q2, q3 in path)
    if gap < 0.02:
        raise ManipulatorError(f'gap {gap}')


numbers = st.floats() | st.floats(-1.0, 1.0)
triples = st.tuples(numbers, numbers, numbers)
hostile = st.builds(Setpoint, numbers, triples, triples)


@given(
    swing=st.floats(0.0, 0.15),
    rate=st.floats(1.0, 5.0),
    phase=st.floats(0.0, 6.3),
    gaps=st.lists(st.integers(0, 149), max_size=4),
    strays=st.dictionaries(st.integers(0, 149), st.just(None) | hostile, max_size=10),
)
def test_every_path_to_rest_keeps_gap_and_limits(swing, rate, phase, gaps, strays):
    made = follower(keeps_gap, (-0.03, 0.1, 0.0))

    def approach(time):  # the carriages oscillate, two of them against each other
        way = swing * (math.sin(rate * time + phase) - math.sin(phase))
        speed = swing * rate * math.cos(rate * time + phase)
        position = (-0.03 + way, 0.1, -0.5 * way)
        return Setpoint(time, position, (speed, 0.0, -0.5 * speed))

    commanded = [made.motion.position] * 3
    for cycle in range(150):
        now = cycle * PERIOD
        stray = strays.get(cycle, approach(cycle * PERIOD + 0.02))
        if stray is None:
            made.hold()
        else:
            with suppress(ManipulatorError):
                made.add(stray._replace(time=now + stray.time % 0.5), now)
        stream = approach if all(not 0 <= cycle - gap < 15 for gap in gaps) else None
        commanded += run(made, now, now + PERIOD, stream, ManipulatorError)
        keeps_gap(commanded[-1])
    require_limits(commanded, LIMITS, PERIOD)


@st.composite
def lowered(draw):
    """Draw limits and the time [s] in which the acceleration rises to its limit."""
    speed = draw(st.floats(0.01, 0.5))
    acceleration = draw(st.floats(0.1, 3.0))
    ramp = draw(st.floats(0.02, 1.0))
    return MotionLimits(speed, acceleration, acceleration / ramp)


@pytest.mark.long
@settings(max_examples=25)
@given(st.floats(0.01, 1.2), lowered())
@example(0.1, MotionLimits(0.2, 1.0, 3.0))  # the carriages still accelerate
@example(0.12, MotionLimits(0.5, 3.0, 5.0))
def test_lowered_limits_never_accelerate_nor_leave_the_stroke(time, limits):
    def towards_the_border(time):  # at up to 0.49 m/s, to rest 5 mm inside the stroke
        return move(time, 0.395, 1.2)

    made = follower()
    unchanged = follower()
    for one in (made, unchanged):
        one.add(towards_the_border(0.0), 0.0)
        before = run(one, 0.0, time, towards_the_border)
    to_rest = run(unchanged, round(time / PERIOD) * PERIOD, time + 0.4, stream=None)
    made.change_limits(limits)
    after = run(made, round(time / PERIOD) * PERIOD, time + 2.0, towards_the_border)
    (fastest, *_) = differences([*before[-2:], *to_rest], PERIOD)
    most = max(limits.speed, fastest)
    assert differences([*before[-1:], *after], PERIOD)[0] <= most + 1e-6
    assert differences(after[40:], PERIOD)[0] <= limits.speed + 1e-6
    inside(*after)


@pytest.mark.parametrize('held', [1, 3, 7, 10])
def test_held_commands_continue_with_the_velocity_after_braking(held):
    def fast(time):
        return sine(time, 0.39)

    made = follower(start=fast(-0.5).position)
    pause = held * PERIOD
    run(made, -0.5, 0.0, fast)
    before = made.motion.position
    speed = made.motion.velocity[0]
    made.wait(pause)
    after = run(made, pause, pause + 1.5, fast)
    left = max(0.0, speed - LIMITS.acceleration * pause)
    farthest = (left + 0.01 * LIMITS.jerk * PERIOD) * PERIOD
    assert 0.0 <= after[0][0] - before[0] <= farthest
    moved = left * PERIOD
    start = (before[0] - moved, before[1] - moved, before[2])
    require_limits([start, before, *after], LIMITS, PERIOD)
    assert after[-1] == pytest.approx(fast(pause + 1.51).position, abs=1e-6)


def lower_the_limits(made, _):
    made.change_limits(replace(LIMITS, speed=0.01))


def reject_every_path(_, check):
    check.check = reject


@pytest.mark.parametrize(
    ('begin', 'cause'),
    [
        (lambda made, _: made.hold(), 'the driver ended the stream of setpoints'),
        (lambda made, _: None, 'no valid setpoint was received'),
        (lower_the_limits, 'faster than the lowered limits'),
        (reject_every_path, 'no path'),
    ],
)
def test_last_brake_names_the_cause_of_each_brake(begin, cause):
    check = ReplaceableCheck()
    made = follower(check)
    made.last_brake = 'an earlier brake'
    run(made, -0.5, 0.0)
    assert made.activity is Activity.FOLLOWING
    begin(made, check)
    for cycle in range(30):
        run(made, cycle * PERIOD, (cycle + 1) * PERIOD, None)
        if made.activity is Activity.BRAKING:
            break
    assert made.brakes == 1
    assert cause in made.last_brake


def test_carriages_brake_before_a_place_with_a_lower_speed():
    def fastest(*places):
        """Return the allowed speed [m/s] of a carriage that comes near its neighbour."""
        return 0.02 if max(q1 for q1, _, _ in places) > -0.08 else math.inf

    made = SetpointFollower(StreamSettings(), LIMITS, PERIOD, inside, fastest)
    made.reset(HOME)
    run(made, 0.0, 2.0)
    assert made.brakes
    assert 'at this distance from its neighbour' in made.last_brake


def test_held_commands_without_path_end_at_rest():
    check = ReplaceableCheck()
    made = follower(check)
    run(made, -0.5, 0.0)
    check.check = reject
    for _ in range(2):
        made.wait(PERIOD)
        assert made.at_rest
