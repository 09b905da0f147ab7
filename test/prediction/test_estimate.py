"""What is accepted of the estimator and what is rejected."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction.estimate import (
    ALL_KNOWN,
    EstimateGate,
    EstimateSettings,
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


@given(st.lists(st.floats(-0.01, 0.01), min_size=400, max_size=400))
def test_200_hz_estimates_with_10_ms_jitter_are_accepted(jitter):
    stamps, gate, rejected = [k / 200.0 for k in range(len(jitter))], EstimateGate(SETTINGS), 0
    for arrival, stamp in sorted(zip(np.add(stamps, jitter), stamps, strict=True)):
        try:
            gate.check(NOW + arrival, NOW + stamp, STILL, VARIANCES)
        except InputError:
            rejected += 1
    assert rejected < 0.05 * len(stamps)
