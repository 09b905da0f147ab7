"""Gate that rejects impossible estimates and converts the others to the rail."""

import math

from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mechanism import published_motion
import numpy as np
import pytest

from facade_manipulator.covariance import MIN_DEVIATION
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Pose, ZERO_POSE
from facade_manipulator.prediction.estimate import (
    ALL_KNOWN,
    EstimateGate,
    EstimateSettings,
)

NOW = 1000.0
NOISE = (1e-6, 1e-6, 3e-6)
LOST = (1.0, 1e-6, 1e-6)  # x is not known
MOUNTING = (0.5, 0.3, 0.01)
places = st.floats(-1.0, 1.0)
poses = st.builds(Pose, places, places, st.floats(-0.5, 0.5))


def gate(**settings):
    return EstimateGate(EstimateSettings(**settings))


@pytest.mark.parametrize('age', [0.299, 0.0, -0.009])
@given(st.builds(Pose, *[st.floats(-0.5, 0.5)] * 3))
def test_possible_estimate_passes_unchanged(age, pose):
    variances = (1e-6, 4e-6, 9e-6)
    stamp = NOW - age
    tilt = EstimateGate.LARGEST_TILT
    estimate = gate().check(NOW, stamp, pose, variances, tilt)
    assert estimate == (stamp, pose, variances, ALL_KNOWN)


def not_finite_estimates():
    """Return a pose and its rejection for each axis and each number that is not finite."""
    rows = []
    for axis in Pose._fields:
        for value in (math.nan, math.inf):
            pose = ZERO_POSE._replace(**{axis: value})
            rows.append((pose, NOW, 0.0, 'not_finite', f'{axis} = {value}'))
    return rows


@pytest.mark.parametrize(
    ('pose', 'stamp', 'tilt', 'reason', 'message'),
    [
        *not_finite_estimates(),
        (
            Pose(2.1, 0.0, 0.0),
            NOW,
            0.0,
            'range',
            'disturbance x = 2.1 m is beyond the limit ±2 m',
        ),
        (Pose(0.0, -3.0, 0.0), NOW, 0.0, 'range', 'disturbance y = -3 m'),
        (Pose(0.0, 0.0, 0.7), NOW, 0.0, 'range', 'disturbance theta = 0.7 rad'),
        (ZERO_POSE, NOW - 0.31, 0.0, 'stale', '0.310 s old, above the limit 0.3 s'),
        (ZERO_POSE, NOW + 0.02, 0.0, 'future', '0.020 s from the future'),
        (
            ZERO_POSE,
            NOW,
            0.051,
            'out_of_plane',
            '0.051 rad out of the plane, above the limit 0.05 rad',
        ),
    ],
)
def test_impossible_estimate_is_rejected_with_its_bound(
    pose, stamp, tilt, reason, message
):
    with pytest.raises(InputError, match=message) as rejected:
        gate().check(NOW, stamp, pose, tilt=tilt)
    assert rejected.value.reason == reason


@pytest.mark.parametrize(
    ('pose', 'elapsed', 'reason'),
    [
        (ZERO_POSE, 0.0, 'out_of_order'),
        (ZERO_POSE, -0.016, 'out_of_order'),
        *((ZERO_POSE._replace(**{axis: -0.1}), 0.02, 'jump') for axis in Pose._fields),
        (Pose(0.05, 0.0, 0.0), -0.004, 'jump'),
    ],
)
def test_change_that_no_gondola_makes_is_rejected(pose, elapsed, reason):
    checked = gate()
    checked.check(NOW, NOW, ZERO_POSE)
    with pytest.raises(InputError) as rejected:
        checked.check(NOW + 0.02, NOW + elapsed, pose)
    assert rejected.value.reason == reason
    checked.check(NOW + 0.04, NOW + 0.04, ZERO_POSE)


@pytest.mark.long
@settings(max_examples=20)  # each has 400 estimates
@given(st.lists(st.floats(-0.01, 0.01), min_size=400, max_size=400))
def test_200_hz_estimates_with_10_ms_jitter_are_accepted(jitter):
    stamps = [k / 200.0 for k in range(len(jitter))]
    checked = gate()
    rejected = 0
    for arrival, stamp in sorted(zip(np.add(stamps, jitter), stamps, strict=True)):
        try:
            checked.check(NOW + arrival, NOW + stamp, ZERO_POSE, NOISE)
        except InputError:
            rejected += 1
    assert rejected < 0.05 * len(stamps)


def test_lasting_jump_is_accepted_after_a_possible_time():
    checked = gate()
    accepted = []
    checked.check(NOW, NOW, ZERO_POSE)
    for stamp in NOW + 0.02 * np.arange(1, 20):
        try:
            checked.check(stamp, stamp, Pose(0.2, 0.0, 0.0))
            accepted.append(stamp)
        except InputError as error:
            assert error.reason == 'jump'
            assert not accepted
    assert accepted[0] == pytest.approx(NOW + 0.18)


def test_axis_known_again_may_be_anywhere():
    checked = gate()
    checked.check(NOW, NOW, Pose(0.05, 0.01, 0.0), NOISE)
    for number, x in enumerate((0.05, 0.4, 7.0), 1):
        stamp = NOW + 0.01 * number
        estimate = checked.check(stamp, stamp, Pose(x, 0.011, 0.0), LOST)
        assert estimate.stamp == stamp
        assert estimate.pose == (0.05, 0.011, 0.0)
        assert estimate.variances == (1e-6, 1e-6, 1e-6)
        assert estimate.known == (False, True, True)
    stamp = NOW + 0.04
    found = checked.check(stamp, stamp, Pose(-0.06, 0.012, 0.0), NOISE)
    assert found.known == ALL_KNOWN
    assert found.pose.x == -0.06
    with pytest.raises(InputError, match='disturbance y jumps'):
        checked.check(NOW + 0.05, NOW + 0.05, Pose(0.4, 0.1, 0.0), LOST)


@pytest.mark.parametrize(
    ('settings', 'variances', 'known'),
    [
        ({}, (1e-6, 1e-6, 1e6), (True, True, False)),
        ({'mounting': (0.5, 0.0, 0.0)}, (1e-6, 1e-6, 1e6), (True, False, False)),
        ({'mounting': (0.0, 0.5, 0.0)}, (1e-6, 1e-6, 1e6), (False, True, False)),
        ({'axes': 0.3}, LOST, (False, False, True)),
        ({'axes': 0.5 * math.pi}, LOST, (True, False, True)),
    ],
)
def test_unknown_axis_makes_dependent_axes_unknown(settings, variances, known):
    assert gate(**settings).check(NOW, NOW, ZERO_POSE, variances).known == known


@pytest.mark.parametrize(
    ('variance', 'expected', 'is_known'),
    [
        (0.0, None, True),
        *((value, None, False) for value in (-1.0, math.nan, math.inf, -math.inf, 1.0)),
        (1e-30, MIN_DEVIATION**2, True),
    ],
)
def test_missing_or_small_variances_are_replaced(variance, expected, is_known):
    settings = EstimateSettings()
    estimate = EstimateGate(settings).check(NOW, NOW, ZERO_POSE, (variance,) * 3)
    noise = settings.position_noise, settings.position_noise, settings.yaw_noise
    assert estimate.known == (is_known,) * 3
    assert estimate.variances == pytest.approx([expected or one**2 for one in noise])


@given(poses, poses, st.floats(-math.pi, math.pi))
def test_rail_is_recovered_for_any_mounting(rail, mounting, axes):
    published = published_motion(rail, mounting, axes)
    estimate = gate(mounting=tuple(mounting), axes=axes).check(NOW, NOW, published)
    assert estimate.pose == pytest.approx(rail, abs=1e-12)


@given(
    st.floats(-math.pi, math.pi),
    st.floats(-0.7, 0.7),
    st.lists(st.floats(-0.01, 0.01), min_size=2, max_size=5),
)
def test_range_limit_applies_to_the_rail_at_any_yaw(yaw, theta, turns):
    """The published angle is wrapped, as each angle from a quaternion."""
    checked = gate(mounting=(0.0, 0.0, yaw))
    for number, turn in enumerate(turns):
        rail = theta + turn
        assume(abs(abs(rail) - 0.6) > 1e-9)  # rounding decides at the limit
        published = Pose(0.0, 0.0, math.remainder(rail + yaw, math.tau))
        stamp = NOW + 0.02 * number
        if abs(rail) < 0.6:
            estimate = checked.check(stamp, stamp, published)
            assert estimate.pose.theta == pytest.approx(rail, abs=1e-12)
        else:
            with pytest.raises(InputError, match='disturbance theta') as rejected:
                checked.check(stamp, stamp, published)
            assert rejected.value.reason == 'range'


def test_turned_axes_swap_x_and_y_and_their_variances():
    published = Pose(0.02, -0.1, 0.03)
    turned = gate(axes=math.pi / 2.0)
    estimate = turned.check(NOW, NOW, published, (1e-6, 4e-6, 1e-6))
    assert estimate.pose == pytest.approx((0.1, 0.02, 0.03))
    assert estimate.variances == pytest.approx((4e-6, 1e-6, 1e-6))


def test_estimate_has_the_time_and_variances_of_the_rail():
    checked = gate(mounting=MOUNTING, delay=0.1)
    rail = Pose(0.1, 0.0, 0.02)
    published = published_motion(rail, Pose(*MOUNTING))
    estimate = checked.check(NOW, NOW + 0.05, published, (1e-6, 1e-6, 1e-6))
    assert estimate.stamp == pytest.approx(NOW - 0.05)
    assert estimate.pose == pytest.approx(rail)
    assert estimate.variances == pytest.approx((1.09e-6, 1.25e-6, 1e-6))
