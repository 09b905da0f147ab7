"""Whether a measured force is true, held and in time."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.compensation.force_watch import (
    CREEPING,
    ForceWatch,
    HOLD_TIME,
    LatencyCheck,
    LEAST_AMPLITUDE,
    MEMORY,
    MOST_AMPLITUDE,
    MOST_CHATTERS,
    NOISE,
    ODD,
    PULL_TIME,
    RATES,
    WINDOW,
)

PERIOD, STIFFNESS, DESIRED = 0.01, 2000.0, 30.0


def watched(*parts, watch=None, desired=DESIRED, stiffness=STIFFNESS, period=PERIOD):
    """Return a watch that has seen each force for so long."""
    watch = watch or ForceWatch()
    stamp = max(watch.stamp, 0.0)
    for duration, force in parts:
        for _ in range(round(duration / period)):
            stamp += period
            watch.add(stamp, force, desired, stiffness, 0.0)
    return watch


@pytest.mark.parametrize('period', [0.01, 0.1])
@pytest.mark.parametrize(('before', 'after'), [(30.0, 26.0), (28.0, 0.0), (0.1, 33.0)])
def test_the_figures_are_means_of_the_last_seconds(before, after, period):
    watch = watched((8.0 * MEMORY, before), (MEMORY, after), period=period)
    old = math.exp(-1.0)

    def mean(of):
        return pytest.approx(old * of(before) + (1.0 - old) * of(after), rel=0.01, abs=0.01)

    assert watch.mean == mean(lambda force: force)
    assert watch.rms ** 2 == mean(lambda force: (force - DESIRED) ** 2)
    assert watch.share_off == mean(lambda force: force < NOISE)
    assert watch.low == pytest.approx(after, abs=0.01)


def test_a_wall_that_pulls_is_no_wall_but_a_moment_of_it_is_nothing():
    watch = watched((1.0, 0.0), (0.8 * PULL_TIME, -1.1 * ODD))
    assert watch.fault == ''
    assert 'pulls with 3.3 N' in watched((PULL_TIME, -1.1 * ODD), watch=watch).fault
    watch.begin()
    assert watch.fault == watched((9.0, -0.9 * ODD), watch=watch).fault == ''


@pytest.mark.parametrize(('unanswered', 'is_stuck'), [(0.9 * ODD, False), (1.1 * ODD, True)])
def test_a_force_that_should_have_changed_is_stuck(unanswered, is_stuck):
    watch = watched((1.0, 27.0))
    watch.add(1.01, 27.0, DESIRED, STIFFNESS, unanswered)
    assert ('stuck at 27.0 N' in watch.fault) == is_stuck


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize(('desired', 'stiffness', 'bound'), [
    (5.0, 1e3, 10.0), (50.0, 1e3, 20.0), (5.0, 2e4, 30.0), (0.0, 1e3, math.inf)])
def test_a_jump_is_what_neither_force_nor_stiffness_explains(desired, stiffness, bound, sign):
    for jump in (0.9 * bound, 1.1 * bound) if bound < math.inf else (100.0,):
        watch = watched((1.0, 5.0), (PERIOD, 5.0 + sign * jump),
                        desired=desired, stiffness=stiffness)
        assert ('jumped by' in watch.fault) == (jump > bound)


@pytest.mark.parametrize(('final', 'most'), [(5.0, 20.0), (30.0, 60.0)])
def test_a_force_far_above_the_desired_one_is_not_held(final, most):
    for force in (0.98 * most, 1.02 * most):
        reason = watched((0.5, force)).not_held(final, final, math.inf)
        assert (f'bound {most:.1f} N' in reason) == (force > most)


@pytest.mark.parametrize('error', [-6.0, 6.0])
def test_a_force_that_misses_the_desired_one_is_found_in_some_seconds(error):
    watch = watched((HOLD_TIME, DESIRED + error))
    missed = abs(error) * math.sqrt(1.0 - math.exp(-1.0))
    assert watch.not_held(DESIRED, DESIRED, 1.02 * missed) == ''
    assert f'misses the desired 30.0 N by {missed:.1f} N RMS' in watch.not_held(
        DESIRED, DESIRED, 0.98 * missed)
    watched((HOLD_TIME, 0.0), watch=watch)  # a wall that is gone counts for nothing
    assert watch.not_held(DESIRED, DESIRED, 1.02 * missed) == ''
    watch.begin_contact()
    assert watch.not_held(DESIRED, DESIRED, 0.01) == ''


@pytest.mark.parametrize(('final', 'bound'), [(10.0, 3.0), (50.0, 10.0)])
def test_a_force_chatters_where_it_changes_faster_than_the_loop_and_by_much(final, bound):
    for amplitude in (0.8 * bound, 1.3 * bound):
        watch = ForceWatch()
        for k in range(300):
            watch.add(k * PERIOD, final + amplitude * (-1) ** k, final, 1e5, 0.0)
        assert watch.chatters(final) == (amplitude > bound)
        assert watch.low == pytest.approx(final, abs=0.1 * amplitude)


@pytest.mark.parametrize(('pause', 'is_held'), [(0.5, False), (10.5, True)])
def test_chatter_is_not_held_once_it_has_come_too_often_and_is_forgotten_after_a_pause(
        pause, is_held):
    watch, count = ForceWatch(), 0
    for k in range(1000):
        watch.add(k * PERIOD, 20.0 + 15.0 * (-1) ** k, 20.0, 1e5, 0.0)
        count += watch.chatters(20.0)
        if count == MOST_CHATTERS:
            break
    assert watch.not_held(20.0, 20.0, 99.0) == ''
    watched((pause, 20.0), watch=watch, desired=20.0, stiffness=1e5)
    for k in range(200):
        watch.add(watch.stamp + PERIOD, 20.0 + 15.0 * (-1) ** k, 20.0, 1e5, 0.0)
        if watch.chatters(20.0):
            break
    assert ('chatters by' in watch.not_held(20.0, 20.0, 99.0)) != is_held


# --- the watermark


def listened(latency, windows=6.0, noise=0.3, stiffness=STIFFNESS, period=PERIOD):
    """Return a check of a contact whose force comes so late, with fresh stamps."""
    check, random = LatencyCheck(), np.random.default_rng(1)
    for stamp in np.arange(0.0, windows * WINDOW + 2.0 * period, period):
        late, now = (0.2 * np.sin(RATES * time).sum() for time in (stamp - latency, stamp))
        sway = 2.0 * math.sin(1.7 * stamp)
        check.add(stamp, DESIRED + late + sway + noise * random.standard_normal(),
                  now / stiffness)
    return check


@given(st.floats(0.0, 1.5))
def test_a_latency_that_is_not_in_the_stamps_is_found_but_for_a_little(latency):
    assert latency - 0.03 < listened(latency, noise=0.02).latency <= latency + 0.005


def test_a_force_that_leads_is_not_late():
    assert listened(-0.04, noise=0.02).latency == 0.0


def test_what_the_scatter_explains_is_no_latency_and_the_scatter_fades_with_time():
    soon, late = (listened(0.1, windows, noise=1.0).latency for windows in (6.0, 41.0))
    assert soon < late
    assert 0.06 < late < 0.105


@pytest.mark.parametrize('stiffness', [500.0, 5000.0])
def test_the_contact_is_no_stiffer_than_the_force_answers(stiffness):
    check = listened(0.0, stiffness=stiffness)
    assert stiffness < check.stiffness < 2.0 * stiffness
    check.forget_stiffness()
    assert check.stiffness == math.inf


@pytest.mark.parametrize('sparse', [{'windows': 4.0}, {'period': 0.1}])
def test_few_samples_show_neither_latency_nor_stiffness(sparse):
    check = listened(0.5, **sparse)
    assert (check.latency, check.stiffness) == (0.0, math.inf)


@given(st.floats(0.0, 100.0), st.floats(0.0, 100.0))
def test_the_watermark_is_small_and_its_rate_its_derivative(time, desired):
    check, step = LatencyCheck(), 1e-4
    before, after = (check.modulation(time + s, desired)[0] for s in (-step, step))
    wave, rate = check.modulation(time, desired)
    assert rate == pytest.approx((after - before) / (2.0 * step), abs=1e-3)
    assert abs(wave) <= 2.0 * LEAST_AMPLITUDE


def test_the_watermark_grows_with_the_scatter_to_a_share_of_the_force():
    checks = [listened(0.0, 15.0, noise=noise) for noise in (0.0, 1.5, 3.0, 60.0)]
    most = [max(check.modulation(time, DESIRED)[0] for time in np.arange(0.0, 10.0, 0.01))
            for check in checks]
    assert most[0] == pytest.approx(2.0 * LEAST_AMPLITUDE, rel=0.02)
    assert most[0] < most[1] < most[2] < most[3]
    assert most[3] == pytest.approx(2.0 * MOST_AMPLITUDE * DESIRED, rel=0.02)


@pytest.mark.parametrize('windows', [CREEPING - 1, CREEPING + 2])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_an_offset_creeps_where_it_goes_one_way_window_by_window(windows, sign):
    found = []
    for way in (lambda stamp: stamp, lambda stamp: math.sin(0.2 * stamp), lambda _: 0.0):
        check = LatencyCheck()
        for stamp in np.arange(0.0, windows * WINDOW + 0.1, PERIOD):
            wave = 1e-5 * math.sin(RATES[0] * stamp) * math.cos(RATES[1] * stamp)
            check.add(stamp, DESIRED, sign * 1e-3 * way(stamp) + wave)
        found.append(check.creep)
    assert found == [pytest.approx(1e-3 if windows >= CREEPING else 0.0, rel=0.02), 0.0, 0.0]
    check.begin()
    assert check.creep == 0.0
