"""The wall as a sensor: better than the estimator where it is known, never worse for long."""

import math

from hypothesis import given
from hypothesis import settings as tried
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.compensation.wall_sense import Deflection, WallPlace, WallSense
from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction.estimate import Estimate, Variances

INTERVAL = 0.02
NOISE = 1e-3, 1.75e-3
SEEN = 1e-4, 1.5e-4  # of a force of 0.5 N, at 5 N/mm
YAW = 0.02


def sensed(
    duration, swing=1.0, wall=lambda time: (0.19, 0.01), late=0, pressed=lambda time: True, seed=1,
    known=lambda time: True,
):
    """Return what is left of the errors in y and θ of a rail that sways, and the deviations."""
    random, sense, past, found = np.random.default_rng(seed), WallSense(), [], []
    for k in range(round(duration / INTERVAL)):
        time = k * INTERVAL
        rail = Pose(0.0, 0.015 * math.sin(1.3 * time), YAW)
        residual = swing * 5e-4 * math.sin(3.0 * time), 3e-4 * math.sin(4.0 * time)
        y, theta = (place + left for place, left in zip(wall(time), residual, strict=True))
        head = Pose(0.1 * math.sin(time), 0.0, theta - YAW)
        head = head._replace(y=(y - rail.y - math.sin(YAW) * head.x) / math.cos(YAW))
        deflection = [left + 0.004 + noise * random.standard_normal()
                      for left, noise in zip(residual, SEEN, strict=True)]
        past.append(Deflection(*deflection, *SEEN))
        estimate = Estimate(time, Pose(*(
            value + noise * random.standard_normal() for value, noise in zip(
                rail, (0.0, *NOISE), strict=True))), Variances(1e-6, *np.square(NOISE).tolist()),
            (True, known(time), True))
        fused = sense.fused(
            estimate, YAW, head, past[max(k - late, 0)] if pressed(time) else None)
        assert fused.pose.x == estimate.pose.x and fused.variances.x == estimate.variances.x
        assert fused.known[1] == (known(time) or pressed(time) and time > 1.0)
        found.append([
            (fused.pose.y - rail.y, fused.pose.theta - rail.theta), np.sqrt(fused.variances[1:]),
            (estimate.pose.y - rail.y, estimate.pose.theta - rail.theta)])
    return np.array(found).swapaxes(0, 1)


@tried(max_examples=5, deadline=None)
@given(st.integers(0, 2 ** 32 - 1))
def test_a_wall_that_is_known_is_many_times_better_than_the_estimator_and_knows_how_good(seed):
    errors, deviations, _ = sensed(20.0, seed=seed)[:, 500:]
    assert (np.sqrt((errors ** 2).mean(axis=0)) < 0.25 * np.array(NOISE)).all()
    assert ((abs(errors) < 3.0 * deviations).mean(axis=0) > 0.8).all()


def test_without_contact_the_estimate_stays_as_it_is_and_the_wall_is_learnt_again():
    errors, deviations, given_errors = sensed(
        20.0, wall=lambda time: (0.19 if time < 15.0 else 0.17, 0.01),
        pressed=lambda time: not 10.0 <= time < 15.0)
    np.testing.assert_array_equal(errors[500:750], given_errors[500:750])
    assert deviations[500:750] == pytest.approx(np.broadcast_to(NOISE, (250, 2)))
    assert (np.sqrt((errors[900:] ** 2).mean(axis=0)) < 0.5 * np.array(NOISE)).all()


def test_what_the_estimator_does_not_know_the_wall_tells_while_the_head_presses():
    errors, deviations, _ = sensed(
        20.0, known=lambda time: time < 10.0, pressed=lambda time: time < 15.0)
    lost = slice(500, 750)
    assert np.sqrt((errors[lost, 0] ** 2).mean()) < 0.5 * NOISE[0]
    assert (abs(errors[lost, 0]) < 3.0 * deviations[lost, 0]).mean() > 0.8


def test_a_frame_is_found_and_the_estimator_believed_until_the_wall_is_known_again():
    errors, _, _ = sensed(14.0, wall=lambda time: (0.19 if time < 10.0 else 0.17, 0.01))
    assert abs(errors[500:, 0]).max() < 5.0 * NOISE[0]
    assert np.sqrt((errors[-100:, 0] ** 2).mean()) < 0.5 * NOISE[0]


def test_a_force_that_is_late_where_the_head_swings_counts_for_less():
    _, sound, _ = sensed(20.0, swing=4.0)[:, 250:]
    errors, deviations, _ = sensed(20.0, swing=4.0, late=50)[:, 250:]
    assert deviations[:, 0].mean() > 2.0 * sound[:, 0].mean()
    assert np.sqrt((errors[:, 0] ** 2).mean()) < 1.5 * NOISE[0]


def test_a_surprise_is_forgotten_in_some_minutes():
    random, place, deviations = np.random.default_rng(1), WallPlace(), []
    for k in range(12000):
        odd = 3.0 * NOISE[0] * math.sin(0.3 * k) if 1000 <= k < 2000 else 0.0
        _, variance, _ = place.fused(
            k * INTERVAL, (NOISE[0] * random.standard_normal(), NOISE[0] ** 2, True), odd, SEEN[0])
        deviations.append(math.sqrt(variance))
    sure, unsure, again = deviations[900], deviations[2000], deviations[-1]
    assert unsure > 1.5 * sure
    assert again < 0.6 * unsure
