"""What is accepted of the estimator and what is rejected."""

from dataclasses import replace
import itertools
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction.estimate import (
    ALL_KNOWN,
    Estimate,
    EstimateGate,
    EstimateMean,
    EstimateSettings,
    LEARNING_PERIOD,
    LEAST_NOISE,
)

SETTINGS = EstimateSettings()
NOW = 1000.0
STILL = Pose(0.0, 0.0, 0.0)
VARIANCES = Pose(1e-6, 1e-6, 3e-6)


def rejection(gate, now, stamp, pose):
    with pytest.raises(InputError) as caught:
        gate.check(now, stamp, pose)
    return caught.value


@given(st.tuples(*[st.floats(-0.5, 0.5)] * 3), st.floats(0.0, 0.29))
def test_a_first_plausible_estimate_passes_unchanged(values, age):
    pose = Pose(*values)
    estimate = EstimateGate(SETTINGS).check(NOW, NOW - age, pose, (1e-6, 4e-6, 9e-6))
    assert estimate == (NOW - age, pose, Pose(1e-6, 4e-6, 9e-6), ALL_KNOWN)


LOST = (1.0, 1e-6, 1e-6)  # x is not known


def test_an_axis_that_is_not_known_keeps_its_last_value_and_is_found_again_anywhere():
    gate = EstimateGate(SETTINGS)
    gate.check(NOW, NOW, Pose(0.05, 0.01, 0.0), VARIANCES)
    for number, x in enumerate((0.05, 0.4, 1.3)):
        stamp = NOW + 0.01 * number + 0.01
        estimate = gate.check(stamp, stamp, Pose(x, 0.011, 0.0), LOST)
        assert estimate == (stamp, (0.05, 0.011, 0.0), (1e-6, 1e-6, 1e-6), (False, True, True))
    found = gate.check(NOW + 0.04, NOW + 0.04, Pose(-0.06, 0.012, 0.0), VARIANCES)
    assert found.known == ALL_KNOWN and found.pose.x == -0.06
    with pytest.raises(InputError, match='disturbance y jumps'):  # that was known all the time
        gate.check(NOW + 0.05, NOW + 0.05, Pose(0.4, 0.1, 0.0), LOST)


def test_an_axis_that_is_not_known_may_be_anywhere_without_the_others_being_rejected():
    gate = EstimateGate(EstimateSettings())
    assert gate.check(NOW, NOW, Pose(7.0, 0.01, 0.0), LOST).pose == (0.0, 0.01, 0.0)
    with pytest.raises(InputError, match='disturbance x = 7'):
        gate.check(NOW + 0.1, NOW + 0.1, Pose(7.0, 0.01, 0.0), (1e-6, 1e-6, 1e-6))
    with pytest.raises(InputError) as rejected:
        gate.check(NOW + 0.1, NOW + 0.1, Pose(math.nan, 0.01, 0.0), LOST)
    assert rejected.value.reason == 'not_finite'


@pytest.mark.parametrize(('settings', 'known'), [
    ({}, (True, True, False)),
    ({'mounting': (0.5, 0.0, 0.0)}, (True, False, False)),
    ({'mounting': (0.0, 0.5, 0.0)}, (False, True, False))])
def test_without_the_yaw_nobody_knows_what_is_beside_the_estimator(settings, known):
    gate = EstimateGate(replace(SETTINGS, **settings))
    assert gate.check(NOW, NOW, STILL, (1e-6, 1e-6, 1e6)).known == known


def test_along_turned_axes_two_are_lost_at_once():
    gate = EstimateGate(replace(SETTINGS, axes=0.3))
    assert gate.check(NOW, NOW, STILL, LOST).known == (False, False, True)


@pytest.mark.parametrize('axis', Pose._fields)
@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_is_rejected_by_its_name(axis, value):
    error = rejection(EstimateGate(SETTINGS), NOW, NOW, STILL._replace(**{axis: value}))
    assert error.reason == 'not_finite'
    assert axis in str(error)


@pytest.mark.parametrize('pose', [Pose(2.1, 0.0, 0.0), Pose(0.0, -3.0, 0.0), Pose(0.0, 0.0, 0.7)])
def test_a_gondola_that_far_away_is_not_accepted(pose):
    error = rejection(EstimateGate(SETTINGS), NOW, NOW, pose)
    assert error.reason == 'range'
    assert 'm' in str(error) or 'rad' in str(error)


@pytest.mark.parametrize(('age', 'reason'), [(0.31, 'stale'), (-0.02, 'future')])
def test_age_and_lead_have_bounds(age, reason):
    error = rejection(EstimateGate(SETTINGS), NOW, NOW - age, STILL)
    assert error.reason == reason
    assert f'{abs(age):.3f} s' in str(error)


@pytest.mark.parametrize('age', [0.299, 0.0, -0.009])
def test_age_and_lead_within_their_bounds_pass(age):
    EstimateGate(SETTINGS).check(NOW, NOW - age, STILL)


@pytest.mark.parametrize('step', [0.0, -0.02])
def test_an_estimate_that_is_not_newer_is_out_of_order(step):
    gate = EstimateGate(SETTINGS)
    gate.check(NOW, NOW - 0.05, STILL)
    assert rejection(gate, NOW, NOW - 0.05 + step, STILL).reason == 'out_of_order'
    gate.check(NOW, NOW - 0.03, STILL)


@pytest.mark.parametrize('pose', [Pose(0.1, 0.0, 0.0), Pose(0.0, -0.1, 0.0), Pose(0.0, 0.0, 0.1)])
def test_a_jump_is_rejected_and_what_follows_on_the_old_course_passes(pose):
    gate = EstimateGate(SETTINGS)
    gate.check(NOW, NOW, STILL)
    error = rejection(gate, NOW + 0.02, NOW + 0.02, pose)
    assert error.reason == 'jump'
    assert 'bound' in str(error)
    gate.check(NOW + 0.04, NOW + 0.04, STILL)


def test_an_estimate_that_is_late_by_less_than_a_period_of_learning_counts():
    gate = EstimateGate(SETTINGS)
    gate.check(NOW, NOW, STILL)
    for late in (0.005, 0.01, 0.014):  # the newest alone says what is late
        assert gate.check(NOW, NOW - late, STILL, VARIANCES).stamp == NOW - late
    assert rejection(gate, NOW, NOW - 0.004, Pose(0.04, 0.0, 0.0)).reason == 'jump'
    assert rejection(gate, NOW, NOW - 0.016, STILL).reason == 'out_of_order'


def test_a_jump_that_lasts_is_accepted_once_the_gondola_could_be_there():
    gate = EstimateGate(SETTINGS)
    gate.check(NOW, NOW, STILL)
    there, outcomes = Pose(0.2, 0.0, 0.0), []
    for k in range(1, 20):
        try:
            gate.check(NOW + 0.02 * k, NOW + 0.02 * k, there)
            outcomes.append('accepted')
        except InputError as error:
            outcomes.append(error.reason)
    accepted = outcomes.index('accepted')
    assert set(outcomes[:accepted]) == {'jump'}
    assert set(outcomes[accepted:]) == {'accepted'}
    assert accepted * 0.02 == pytest.approx(0.17, abs=0.021)


@pytest.mark.parametrize('variance', [0.0, -1.0, math.nan, math.inf])
def test_an_unknown_variance_becomes_the_configured_one_an_infinite_one_an_unknown_axis(variance):
    estimate = EstimateGate(SETTINGS).check(NOW, NOW, STILL, (variance,) * 3)
    assert estimate.known == (variance != math.inf,) * 3
    assert estimate.variances == pytest.approx(
        (SETTINGS.position_noise ** 2, SETTINGS.position_noise ** 2, SETTINGS.yaw_noise ** 2))


def test_a_variance_too_good_to_be_true_is_raised():
    estimate = EstimateGate(SETTINGS).check(NOW, NOW, STILL, (1e-30,) * 3)
    assert estimate.variances == pytest.approx((LEAST_NOISE ** 2,) * 3)


def test_other_variances_or_bounds_are_accepted_from_the_next_estimate_on():
    gate, pose = EstimateGate(SETTINGS), Pose(0.0, 0.0, 0.0)
    given = [
        gate.check(1000.0 + 0.02 * k, 1000.0 + 0.02 * k, pose, variances).variances
        for k, variances in enumerate([(1e-6,) * 3, (1e-6,) * 3, (4e-6, 0.0, 1e-6)])]
    assert given[0] == given[1] == pytest.approx((1e-6,) * 3)
    assert given[2] == pytest.approx((4e-6, SETTINGS.position_noise ** 2, 1e-6))
    gate.change_settings(replace(SETTINGS, position_noise=0.1))
    estimate = gate.check(1000.06, 1000.06, pose, (4e-6, 0.0, 1e-6))
    assert estimate.variances == pytest.approx((4e-6, 0.01, 1e-6))


def estimates(*stamps):
    """Return one estimate per stamp, which says its number."""
    return [Estimate(NOW + stamp, Pose(float(k), 0.0, -float(k)), VARIANCES)
            for k, stamp in enumerate(stamps)]


def learnt(given):
    mean = EstimateMean()
    return [one for one in map(mean.add, given) if one is not None]


@pytest.mark.parametrize('rate', [20.0, 50.0, 60.0])
def test_an_estimate_that_comes_in_its_time_is_learnt_as_it_is(rate):
    given = estimates(*(k / rate for k in range(20)))
    assert learnt(given) == given


@given(st.lists(st.floats(-5e-4, 5e-4), min_size=100, max_size=100))
def test_jitter_at_60_hz_loses_no_estimate(jitter):
    given = estimates(*(k / 60.0 + late for k, late in enumerate(jitter)))
    used = sum(round(VARIANCES[0] / one.variances[0]) for one in learnt(given))
    assert used >= len(given) - 1  # the last may wait for its next


def test_of_faster_estimates_the_mean_is_learnt():
    first, second = learnt(estimates(0.0, 0.004, 0.008, 0.012, 0.016))
    assert first.stamp == NOW
    assert second.stamp == pytest.approx(NOW + 0.010)
    assert second.pose == pytest.approx((2.5, 0.0, -2.5))
    assert second.variances == pytest.approx([v / 4 for v in VARIANCES])


@given(st.lists(st.floats(-0.01, 0.01), min_size=400, max_size=400))
def test_of_200_hz_that_come_10_ms_sooner_or_later_none_is_lost(jitter):
    stamps = [k / 200.0 for k in range(len(jitter))]
    gate, mean, used, last = EstimateGate(SETTINGS), EstimateMean(), 0, -math.inf
    for arrival, stamp in sorted(zip(np.add(stamps, jitter), stamps, strict=True)):
        try:
            one = mean.add(gate.check(NOW + arrival, NOW + stamp, STILL, VARIANCES))
        except InputError:
            continue
        if one is not None:
            assert one.stamp > last
            used, last = used + round(VARIANCES[0] / one.variances[0]), one.stamp
    assert used > 0.95 * len(stamps)


@given(st.lists(st.floats(0.001, 0.1), min_size=1, max_size=60))
def test_whatever_their_rate_means_follow_closely_and_in_order(steps):
    mean, last = EstimateMean(), -math.inf
    for estimate in estimates(*itertools.accumulate(steps)):
        one = mean.add(estimate)
        if one is not None:
            assert last < one.stamp <= estimate.stamp
            assert estimate.stamp - one.stamp < 2 * LEARNING_PERIOD
            last = one.stamp


def test_what_was_kept_before_a_silence_is_in_no_mean():
    *_, last = learnt(estimates(0.0, 0.01, 5.0))
    assert last == estimates(0.0, 0.01, 5.0)[-1]


def test_with_the_clock_set_back_the_next_estimate_is_learnt_at_once():
    *_, last = learnt(estimates(0.0, 0.01, -100.0))
    assert last == estimates(0.0, 0.01, -100.0)[-1]
