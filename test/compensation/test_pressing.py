"""Pressing on walls of any stiffness: gently, as desired, or not at all and saying why."""

from collections import deque
from copy import deepcopy
from dataclasses import replace
from functools import cache
import math
from typing import NamedTuple

from hypothesis import given
from hypothesis import settings as tried
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.compensation.impedance import ImpedanceSettings, YawImpedanceSettings
from facade_manipulator.compensation.pressing import Pressing, PressMode, Surroundings
from facade_manipulator.kinematics import Pose

SETTINGS = ImpedanceSettings(enabled=True)
TURNING = YawImpedanceSettings(enabled=True)
STANDING = YawImpedanceSettings()
PERIOD = 0.01
HORIZON = 6  # cycles
LATENCY = 1
LATENCY_IN_ALL = 0.07  # s
WALL = -0.03
NOISE = 0.5


class Run(NamedTuple):
    """What a head did that reaches each offset when it should."""

    pressing: Pressing
    offsets: np.ndarray
    forces: np.ndarray
    desired: np.ndarray


def sound(_, force):
    return force


def press(
    stiffness, duration=25.0, settings=SETTINGS, wall=lambda time: WALL, sensor=sound,
    around=lambda time: Surroundings(), pressing=None, seed=1, noise=NOISE, damping=0.0,
):
    """Press on a wall; `sensor` takes time and force, returns what it tells or None."""
    pressing = pressing or Pressing(settings, STANDING)
    random, last, depth = np.random.default_rng(seed), None, 0.0
    offsets, forces, desired = [], [], []
    for k in range(round(duration / PERIOD)):
        now = k * PERIOD
        pressing.step(now, now + HORIZON * PERIOD, PERIOD, around(now))
        offsets.append(pressing.y.offset)
        desired.append(pressing.desired)
        before, depth = depth, offsets[max(k - HORIZON, 0)] - wall(now)
        rate = (depth - before) / PERIOD
        forces.append(max(stiffness * depth + damping * rate, 0.0) if depth > 0.0 else 0.0)
        late = k - LATENCY
        told = sensor(now, forces[max(late, 0)] + noise * random.standard_normal())
        if late >= 0 and told is not None:
            pressing.add_measurement(late * PERIOD, told, 0.0, is_repeated=last in (None, told))
            last = told
    return Run(pressing, np.array(offsets), np.array(forces), np.array(desired))


@cache
def held(stiffness):
    return press(stiffness, duration=20.0).pressing


def holding(stiffness=600.0):
    """Return what presses on a wall for a while."""
    return deepcopy(held(stiffness))


def stuck(time, force):
    return force if time < 20.0 else 27.0


def sways(time):
    return WALL + 5e-4 * math.sin(math.tau * 0.3 * time)


def restless(time):
    """Return a wall that moves by what the prediction leaves over."""
    return WALL + sum(
        amplitude * math.sin(math.tau * frequency * time + phase)
        for amplitude, frequency, phase in ((2e-4, 0.3, 0.0), (1e-4, 0.9, 1.0), (1e-4, 2.3, 2.0)))


@pytest.mark.parametrize('stiffness', [400.0, 600.0, 2e3, 1e4, 1e5])
def test_the_desired_force_is_reached_on_a_wall_of_unknown_stiffness(stiffness):
    run = press(stiffness)
    assert run.pressing.outcome == PressMode.HOLDING.value
    assert run.forces[-300:].mean() == pytest.approx(SETTINGS.force, rel=0.03)
    touched = np.flatnonzero(run.forces > 2.0)[0]
    assert run.forces.max() < 1.5 * SETTINGS.force
    assert (run.forces[touched + 200:] > 0.0).mean() > 0.9
    assert abs(np.diff(run.offsets)).max() <= SETTINGS.speed * PERIOD + 1e-12


@pytest.mark.parametrize('stiffness', [600.0, 1200.0, 2e3, 5e3])
def test_the_stiffness_is_learnt_rather_too_high_than_too_low(stiffness):
    learnt = press(stiffness, wall=sways).pressing.stiffness.value
    assert stiffness < learnt < 4.0 * stiffness


def test_the_head_waits_back_and_looks_for_the_wall_slowly():
    run = press(600.0, duration=2.0)
    assert run.offsets[0] == pytest.approx(-SETTINGS.retreat, abs=1e-3)
    assert np.diff(run.offsets).max() <= SETTINGS.approach_speed * PERIOD + 1e-12


def test_the_zero_is_not_taken_while_the_path_comes_from_beyond_the_wall():
    def around(time):
        return Surroundings(beyond=max(0.06 - 0.04 * time, 0.0))

    run = press(600.0, duration=4.0, around=around, sensor=lambda time, force: (
        force + 600.0 * max(0.06 - 0.04 * time - 0.02, 0.0)))
    assert run.pressing.mode is PressMode.SEARCHING
    assert abs(run.pressing.zero.force) < 0.5
    waiting = press(600.0, duration=4.0, around=lambda time: Surroundings(beyond=0.06))
    assert (waiting.pressing.mode, waiting.pressing.reason) == (PressMode.RETRACTED, '')


def test_the_force_rises_from_a_tenth_over_the_ramp_and_is_not_ahead_of_what_is_desired():
    run = press(600.0, noise=0.0, sensor=lambda time, force: force + 1e-6 * time)
    begin, end = np.flatnonzero(np.diff(run.desired == 0.0))[0] + 1, np.argmax(
        run.desired >= SETTINGS.force)
    ramp = run.desired[begin:end]
    assert len(ramp) * PERIOD == pytest.approx(SETTINGS.ramp_time, abs=0.05)
    assert ramp[0] == pytest.approx(0.1 * SETTINGS.force, rel=0.01)
    assert (np.diff(ramp) >= 0.0).all()
    assert ramp + ramp[::-1] == pytest.approx(np.full(len(ramp), 1.1 * SETTINGS.force), rel=0.01)
    assert (run.forces[begin + 50:end] < ramp[50:] + 0.1).all()
    assert (run.forces[begin + 50:end] > ramp[50:] - 0.2 * SETTINGS.force).all()


def test_a_small_force_that_rises_slowly_counts_as_a_touch():
    run = press(600.0, duration=60.0, settings=replace(SETTINGS, force=4.9, ramp_time=40.0))
    assert run.pressing.mode is PressMode.HOLDING
    assert run.forces[-300:].mean() == pytest.approx(4.9, rel=0.03)


def test_a_wall_out_of_reach_is_looked_for_no_further_than_the_range():
    run = press(600.0, duration=40.0, wall=lambda _: 1.0)
    assert run.pressing.mode is PressMode.SEARCHING
    assert run.offsets[-1] == pytest.approx(SETTINGS.range)


def test_a_step_of_the_wall_is_followed():
    run = press(600.0, wall=lambda time: WALL - 0.02 * min(max((time - 20.0) / 0.6, 0.0), 1.0))
    assert run.forces[2000:].max() < 1.5 * SETTINGS.force
    assert run.forces[2000:].min() > 0.5 * SETTINGS.force
    assert run.forces[-100:].mean() == pytest.approx(SETTINGS.force, rel=0.03)


def test_a_wall_that_falls_away_is_looked_for_and_touched_gently():
    run = press(1e4, duration=45.0, wall=lambda time: (
        WALL + min(max(0.1 * (time - 20.0), 0.0), 0.02)))
    assert run.pressing.mode is PressMode.HOLDING
    assert run.forces[2000:].max() < 1.5 * SETTINGS.force
    speed = np.diff(run.offsets[2020:2090]).max() / PERIOD  # nothing touches
    assert speed * LATENCY_IN_ALL * run.pressing.stiffness.value <= 0.26 * SETTINGS.force


def test_a_wall_that_sways_slowly_hardly_changes_the_force():
    run = press(600.0, wall=sways, duration=40.0)
    assert abs(run.forces[2500:] - SETTINGS.force).max() < 0.05 * SETTINGS.force


def test_a_soft_brush_that_damps_is_pressed_as_evenly_as_a_stiffer_one():
    soft, stiffer = (
        press(stiffness, wall=restless, duration=50.0, damping=25.0).forces[2000:].std()
        for stiffness in (300.0, 600.0))
    assert soft < 1.2 * stiffer


def test_what_the_prediction_leaves_of_a_stiff_wall_s_motion_does_not_end_the_first_rise():
    run = press(1e4, wall=lambda time: WALL + 5e-4 * math.sin(math.tau * 3.0 * time))
    assert run.pressing.mode is PressMode.HOLDING, run.pressing.outcome
    assert run.forces[2000:].std() < 5.0


def test_a_wall_too_stiff_to_be_held_is_hardly_hit_and_left():
    run = press(2e5)
    assert run.pressing.mode is PressMode.RETRACTED
    assert 'N' in run.pressing.reason
    assert run.forces.max() < 80.0
    assert (run.forces > 0.0).sum() * PERIOD < 5.0
    run = press(1e5, wall=lambda time: WALL + 5e-4 * math.sin(math.tau * time), duration=40.0)
    assert 'N' in run.pressing.reason
    assert run.offsets[-1] == pytest.approx(-SETTINGS.retreat)


@pytest.mark.parametrize(('sensor', 'reason'), [
    (lambda time, force: force if time < 20.0 else None, 'no contact_wrench'),
    (stuck, 'stuck'),
    (lambda time, force: force + (20.0 if time > 20.0 else 0.0), 'jumped by'),
    (lambda time, force: force - (20.0 if time > 20.0 else 0.0), 'jumped by -'),
    (lambda time, force: force if time < 20.0 else -force, 'jumped by -'),
    (lambda _, force: -force, 'the wall pulls'),
    (lambda time, force: force + min(max(time - 20.0, 0.0), 4.0) * 10.0, 'nothing should touch'),
])
def test_a_broken_sensor_makes_the_head_retract_no_faster_than_it_came_and_say_why(
        sensor, reason):
    run = press(600.0, duration=26.0, sensor=sensor)
    assert run.pressing.mode is PressMode.RETRACTED and not run.pressing.is_held
    assert reason in run.pressing.reason
    assert run.pressing.outcome == f'retracted: {run.pressing.reason}'
    assert run.offsets[-1] <= -SETTINGS.retreat
    assert run.forces.max() < 1.6 * SETTINGS.force
    assert abs(np.diff(run.offsets)).max() <= SETTINGS.speed * PERIOD + 1e-12


def late_from(begin, latency):
    """Return a sensor that gives old forces with fresh stamps from a time [s] on."""
    past = deque(maxlen=1 + round(latency / PERIOD))

    def sensor(time, force):
        past.append(force)
        return past[0] if time > begin else force

    return sensor


stiffnesses = st.floats(math.log(400.0), math.log(5e3)).map(math.exp)
seeds = st.integers(0, 2 ** 32 - 1)


@pytest.mark.long
@tried(max_examples=8, deadline=None)
@given(st.floats(0.2, 1.0), stiffnesses, st.sampled_from((0.0, 25.0)), seeds)
def test_a_force_that_is_late_with_fresh_stamps_makes_the_head_retract_and_say_so(
        latency, stiffness, begin, seed):
    run = press(stiffness, wall=restless, sensor=late_from(begin, latency), duration=90.0,
                seed=seed)
    assert run.pressing.mode is PressMode.RETRACTED
    reasons = ('late, bound 0.11 s',) if latency < 0.3 else (
        'late, bound 0.11 s', 'misses the desired', 'N on the wall')
    assert any(reason in run.pressing.reason for reason in reasons)
    assert abs(np.diff(run.offsets)).max() <= SETTINGS.speed * PERIOD + 1e-12


@pytest.mark.long
@tried(max_examples=4, deadline=None)
@given(st.floats(0.0, 0.1), stiffnesses, seeds)
def test_a_force_that_is_hardly_later_than_its_stamps_say_is_trusted(latency, stiffness, seed):
    run = press(stiffness, wall=restless, sensor=late_from(25.0, latency), duration=90.0,
                seed=seed)
    assert run.pressing.mode is PressMode.HOLDING
    assert abs(run.forces[-1000:] - SETTINGS.force).max() < 0.2 * SETTINGS.force


def test_in_search_of_the_wall_it_stands_still_without_measurements():
    run = press(600.0, duration=6.0, sensor=lambda time, force: force if time < 4.5 else None)
    assert np.ptp(run.offsets[480:]) == 0.0
    assert -SETTINGS.retreat < run.offsets[-1] < WALL


def test_when_measurements_come_again_the_wall_is_looked_for_again():
    run = press(600.0, duration=50.0, sensor=lambda time, force: (
        None if 20.0 < time < 21.0 else force))
    assert run.pressing.mode is PressMode.HOLDING
    assert run.pressing.reason == ''
    assert 'no contact_wrench' in run.pressing.last_reason


@pytest.mark.parametrize(('sensor', 'duration'), [
    (lambda time, force: force + (20.0 if 20.0 < time < 21.0 else 0.0), 25.0),
    (late_from(0.0, 0.25), 40.0)], ids=['jump', 'late'])
def test_a_fault_lasts_until_pressing_is_switched_off_and_on(sensor, duration):
    pressing = press(600.0, sensor=sensor, duration=duration).pressing
    assert pressing.mode is PressMode.RETRACTED
    pressing.press = replace(SETTINGS, enabled=False)
    press(600.0, duration=3.0, pressing=pressing)
    assert pressing.mode is PressMode.OFF
    pressing.press = SETTINGS
    press(600.0, pressing=pressing)
    assert pressing.mode is PressMode.HOLDING


@pytest.mark.parametrize(('most', 'reason'), [
    (Pose(0.0, 0.0, SETTINGS.most_yaw), 'the gondola yaws by 12.5 deg'),
    (Pose(-SETTINGS.most_sway, 0.0, 0.0), 'the gondola sways along the wall by 625 mm')])
def test_a_gondola_that_sways_far_is_pressed_less_and_one_that_sways_farther_not_at_all(
        most, reason):
    pressing = holding()

    def swaying(share, duration=5.0):
        around = Surroundings(rail=Pose(*(share * amount for amount in most)))
        return press(600.0, duration, pressing=pressing, around=lambda _: around)

    for share, left in ((0.99, 1.0), (1.5, 0.5)):
        assert swaying(share).forces[-50:].mean() == pytest.approx(
            left * SETTINGS.force, rel=0.05)
    swaying(2.5)
    assert pressing.mode is PressMode.RETRACTED
    assert reason in pressing.reason
    swaying(1.1, 12.0)
    assert pressing.mode is PressMode.RETRACTED  # it waits for less than it left for
    swaying(0.0, 4.0)
    assert pressing.mode is not PressMode.RETRACTED


def test_how_far_the_gondola_is_pushed_back_is_seen_while_the_head_presses():
    pressing, away = holding(), Surroundings(rail=Pose(0.0, -0.02, 0.0))
    press(600.0, 5.0, pressing=pressing, around=lambda _: away)
    pushed = pressing.sway.push_back
    assert 0.005 < pushed < 0.02
    press(600.0, 2.0, pressing=pressing, around=lambda _: away._replace(silence='silent'))
    assert pressing.sway.push_back < 0.1 * pushed


def test_with_stiffness_the_goal_pulls_back():
    settings = replace(SETTINGS, stiffness=600.0)
    run = press(600.0, settings=settings)
    assert run.forces[-100:].mean() + 600.0 * run.offsets[-1] == pytest.approx(
        settings.force, rel=0.05)


def test_at_the_workspace_limit_the_offset_goes_no_further():
    run = press(600.0, wall=lambda _: 1.0, around=lambda _: Surroundings(
        saturation_error=Pose(0.0, 0.001, 0.0)))
    assert (run.offsets == run.offsets[0]).all()


def test_switched_off_nothing_gives_way_and_what_was_given_comes_back():
    pressing = Pressing(replace(SETTINGS, enabled=False), STANDING)
    assert pressing.idle and pressing.is_held  # nothing is to be pressed
    assert not press(600.0, duration=2.0, pressing=pressing).offsets.any()
    pressing = press(600.0).pressing
    pressing.press = replace(SETTINGS, enabled=False)
    assert not pressing.idle
    press(0.0, duration=5.0, pressing=pressing)
    assert pressing.idle


@pytest.mark.parametrize('alone', [False, True])
@pytest.mark.parametrize(('change', 'place'), [
    ({}, 0.05), ({'force': -0.27}, 0.03), ({'stiffness': 13.5}, 0.025), ({'range': 0.02}, 0.02),
    ({'enabled': False}, 0.0)])
def test_the_yaw_turns_until_the_wall_makes_the_desired_moment(change, place, alone):
    pressing = Pressing(replace(SETTINGS, enabled=not alone), replace(TURNING, **change))
    turned = []
    for k in range(3000):
        now = k * PERIOD
        pressing.step(now, now + HORIZON * PERIOD, PERIOD, Surroundings())
        turned.append(pressing.theta.offset)
        force = 600.0 * max(pressing.y.offset - WALL, 0.0)
        moment = 13.5 * (turned[-1] - 0.05) if force else 0.0
        pressing.add_measurement(now, force + 1e-6 * (k % 7), moment, is_repeated=False)
    assert turned[-1] == pytest.approx(place, abs=1e-3)
    assert abs(np.diff(turned)).max() <= TURNING.speed * PERIOD + 1e-12


@pytest.mark.parametrize(('saturation_error', 'moves'), [(0.01, False), (-0.01, True)])
def test_at_the_workspace_limit_the_yaw_turns_no_further(saturation_error, moves):
    pressing = Pressing(replace(SETTINGS, enabled=False), TURNING)
    around = Surroundings(saturation_error=Pose(0.0, 0.0, saturation_error))
    for k in range(100):
        pressing.add_measurement(k * PERIOD, 30.0, -0.5, is_repeated=False)
        pressing.step(k * PERIOD, (k + HORIZON) * PERIOD, PERIOD, around)
    assert (pressing.theta.offset > 0.0) == moves


@pytest.mark.parametrize(
    ('frequency', 'most'), [(0.1, 0.2), (0.33, 0.55), (0.89, 1.05), (3.0, 1.26)])
def test_the_wall_s_motion_is_suppressed_below_a_third_of_a_hertz_and_hardly_amplified_above(
        frequency, most):
    stiffness, amplitude = 2e3, 1.5e-3
    run = press(stiffness, duration=34.0, wall=lambda time: (
        WALL + amplitude * math.sin(math.tau * frequency * max(time - 18.0, 0.0))))
    times = PERIOD * np.arange(2200, len(run.forces))
    waves = np.column_stack([wave(math.tau * frequency * times) for wave in (np.cos, np.sin)])
    forces = run.forces[2200:] - run.forces[2200:].mean()
    traces = np.linalg.lstsq(waves, forces, rcond=None)[0]
    assert np.hypot(*traces) < most * stiffness * amplitude
    assert (forces - waves @ traces).std() < 0.9  # the watermark, and the sensor's noise


def drifting(begin):
    return lambda time, force: force + 0.5 * max(time - begin, 0.0)


ORDINARY = {
    'a dead band of 1 N': lambda _, force: force if abs(force) > 1.0 else 0.0,
    'steps of 0.5 N': lambda _, force: 0.5 * round(2.0 * force),
    'a bias of 8 N': lambda _, force: force + 8.0,
    'a bias of -8 N': lambda _, force: force - 8.0,
}


@pytest.mark.parametrize('noise', [0.02, NOISE])
@pytest.mark.parametrize('sensor', ORDINARY.values(), ids=ORDINARY)
def test_an_ordinary_sensor_presses_as_desired(sensor, noise):
    def alive(time, force):
        return 5.0 if time < 0.05 else sensor(time, force)  # pushed by hand

    run = press(2000.0, sensor=alive, noise=noise, duration=22.0)
    assert run.pressing.mode is PressMode.HOLDING, run.pressing.outcome
    assert run.forces[-300:].mean() == pytest.approx(SETTINGS.force, abs=0.7)
    assert run.forces.max() < 1.2 * SETTINGS.force


def test_a_sensor_that_drifts_is_found_off_the_wall_and_in_contact():
    run = press(600.0, sensor=drifting(0.0), duration=8.0)
    assert 'drifts by +0.' in run.pressing.reason
    assert not run.forces.any()
    run = press(2000.0, sensor=drifting(15.0), duration=45.0)
    assert 'creeps as if contact_wrench drifted by 0.' in run.pressing.last_reason
    assert 'drifts by +0.' in run.pressing.reason
    assert run.forces[1500:-1000].max() < 1.3 * SETTINGS.force  # it fell; the head was called back
    stopped = np.flatnonzero(run.forces[1600:] == 0.0)[0] * PERIOD
    assert stopped < 22.0


def test_a_wall_that_creeps_is_left_once_and_then_believed():
    run = press(2000.0, wall=lambda time: WALL - 2e-4 * max(time - 15.0, 0.0), duration=75.0)
    assert 'creeps' in run.pressing.last_reason
    assert (np.diff((run.forces > 0.0).astype(int)) < 0).sum() < 5
    assert run.forces[-2500:].min() > 0.8 * SETTINGS.force


def test_a_sensor_that_was_never_heard_to_change_does_not_press():
    run = press(600.0, sensor=lambda *_: 0.0, duration=8.0)
    assert 'push the head by hand' in run.pressing.reason
    assert not run.forces.any()


def test_a_sensor_that_dies_off_the_wall_is_found_soon_after_where_the_wall_was():
    run = press(1000.0, duration=30.0, sensor=lambda time, force: None if 17.5 < time < 18.0 else (
        force if time < 18.0 else 0.0))
    assert 'stuck' in run.pressing.reason
    assert run.forces[1900:].max() < 0.7 * SETTINGS.force


def test_a_stiffness_learnt_from_a_glitch_is_forgotten_again():
    def wall(time):
        return WALL - 0.03 * max(1.0 - abs(time - 20.05) / 0.05, 0.0)

    pressing = press(600.0, wall=wall, duration=20.2).pressing
    assert pressing.stiffness.value > 4.0 * 600.0
    assert 600.0 < press(600.0, wall=wall, duration=50.0).pressing.stiffness.value < 2.0 * 600.0


def shaken(time):
    return WALL + (0.01 * math.sin(math.tau * time) if 20.0 < time < 22.0 else 0.0)


@pytest.mark.parametrize(('cause', 'wall'), [
    ({'silence': 'the estimator is silent'}, lambda time: WALL),
    ({'held_back': 'the head was held back in y'}, shaken)])
def test_what_is_no_fault_of_the_contact_is_named_first_and_waited_for(cause, wall):
    run = press(2000.0, wall=wall, duration=40.0, around=lambda time: Surroundings(
        **cause if 20.0 < time < 21.0 else {}))
    assert run.pressing.last_reason.startswith(*cause.values())
    assert run.pressing.mode is PressMode.HOLDING, run.pressing.outcome


@pytest.mark.parametrize('stiffness', [600.0, 1200.0, 5e3])
def test_a_wall_that_was_touched_before_is_pressed_again_within_four_seconds(stiffness):
    run = press(stiffness, duration=32.0, around=lambda time: Surroundings(
        silence='the estimator is silent' if 22.0 < time < 25.0 else ''))
    back = run.forces[2500:]
    assert run.pressing.mode is PressMode.HOLDING
    assert np.flatnonzero(back > 0.98 * SETTINGS.force)[0] * PERIOD < 4.0
    touches = [forces[np.flatnonzero(forces)[0]:][:15].max() for forces in (run.forces, back)]
    assert touches[1] < touches[0] + 1.0


def test_a_rise_that_is_slow_for_the_gondola_s_sake_is_so_again_after_a_retract():
    run = press(600.0, duration=60.0, settings=replace(SETTINGS, ramp_time=18.0), around=(
        lambda time: Surroundings(silence='no estimates' if 36.0 < time < 37.0 else '')))
    back = run.forces[3900:]
    assert run.pressing.mode is PressMode.HOLDING
    assert 9.0 < np.flatnonzero(back > 0.7 * SETTINGS.force)[0] * PERIOD < 15.0


def test_the_wall_says_where_it_is_only_while_it_is_pressed():
    pressing = press(600.0).pressing
    stamp = 24.9
    seen = pressing.deflection(stamp)
    assert seen is not None and seen[0] == pytest.approx(
        pressing.press.force / pressing.stiffness.likely, rel=0.1)
    for late in (0.1, 0.2):
        pressing.add_measurement(25.0 + late, 0.0, 0.0, is_repeated=False)
    assert pressing.deflection(25.15) is None  # nothing touches
    pressing.add_measurement(25.9, 30.0, 0.0, is_repeated=False)
    pressing.add_measurement(26.0, 30.0, 0.0, is_repeated=False)
    assert pressing.deflection(25.95) is not None
    pressing.add_measurement(26.5, 30.0, 0.0, is_repeated=False)
    assert pressing.deflection(26.2) is None  # too long between two wrenches


@pytest.mark.parametrize(('error', 'is_held'), [
    (4.0, True), (6.0, False), (-4.0, True), (-6.0, False)])
def test_a_force_that_misses_a_tenth_and_two_newton_is_not_held(error, is_held):
    pressing = holding()
    stamp, force = pressing.watch.stamp, SETTINGS.force + error + pressing.zero.force
    for k in range(1, 100):
        pressing.add_measurement(stamp + k * PERIOD, force, 0.0, is_repeated=False)
    assert pressing.mode is PressMode.HOLDING
    assert pressing.is_held == is_held


def test_off_the_wall_force_and_moment_are_zero_whatever_the_sensor_says():
    pressing = Pressing(SETTINGS, TURNING)
    for k in range(300):
        pressing.step(k * PERIOD, (k + HORIZON) * PERIOD, PERIOD, Surroundings())
        pressing.add_measurement(k * PERIOD, 2.0 + 1e-6 * k, -0.3, is_repeated=False)
    assert (pressing.y.measured, pressing.theta.measured) == pytest.approx((0.0, 0.0), abs=1e-3)
    assert (pressing.zero.force, pressing.zero.moment) == pytest.approx((2.0, -0.3), abs=1e-3)


def test_how_the_wall_is_pressed_in_is_force_and_moment_by_what_it_yields_to_both():
    pressing = press(2000.0, 22.0, pressing=Pressing(SETTINGS, TURNING)).pressing
    begin, arm, moment = pressing.watch.stamp + PERIOD, 0.5 * SETTINGS.brush_width, 0.1
    for k in range(2):
        pressing.add_measurement(begin + k * PERIOD, 30.0, moment, is_repeated=False)
    found, force = pressing.deflection(begin + 0.5 * PERIOD), 30.0 - pressing.zero.force
    stiffness = pressing.stiffness.likely
    assert (found.y * stiffness, found.theta * stiffness * arm ** 2) == pytest.approx(
        (force, moment))
    assert (found.y_noise, found.theta_noise) == pytest.approx(
        (NOISE / stiffness, NOISE / (stiffness * arm)))
