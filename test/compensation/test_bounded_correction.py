"""Bounds of the correction for bounded estimates, through the whole compensator."""

from collections import deque
from contextlib import suppress
import math
from typing import NamedTuple

from hypothesis import given, settings, target
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.compensation import correction
from facade_manipulator.compensation.compensator import Compensator, CompensatorSettings
from facade_manipulator.compensation.correction import CorrectionMode, CorrectionSettings
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Geometry, Pose

START, PERIOD, LATENCY = 1000.0, 0.01, 0.005  # s
REST = 0.6  # s, with the gondola at rest before the estimates of an example
LARGEST = 0.5  # m, m, rad: bound of the estimates
# m, m, rad, by which the correction may leave it: at 10 Hz the prediction overshoots jumps of 1 m
MARGIN = 1.0
LATE_MARGIN = 0.1  # m, of an axis found late: its correction fades in


class Part(NamedTuple):
    """Successive estimates with one pose, and the standard deviation of each axis."""

    count: int
    pose: Pose
    deviations: tuple[float, ...]


places = st.floats(-LARGEST, LARGEST)
deviations = st.one_of(st.floats(-4.0, -2.0).map(lambda power: 10.0 ** power), st.just(1.0))


def sequences(deviation):
    """Return a strategy of sequences of parts, for a strategy of standard deviations."""
    return st.lists(st.builds(
        Part, st.integers(1, 10), st.builds(Pose, places, places, places),
        st.tuples(deviation, deviation, deviation)), min_size=1, max_size=6)


rates = st.sampled_from([10.0, 20.0, 30.0, 50.0, 100.0, 200.0])


def correct(estimates, rate, extra=0.0, **changes):
    """Return the compensator and its poses until all estimates and an extra time [s] are over."""
    compensator = Compensator(
        Geometry(), CompensatorSettings(correction=CorrectionSettings(**changes)))
    compensator.set_goal(Pose(0.0, 0.25, 0.0))
    coming = deque((START + number / rate, *one) for number, one in enumerate(estimates))
    now, steps = START, []
    end = coming[-1][0] + LATENCY + extra
    while now < end:
        now += PERIOD
        while coming and coming[0][0] + LATENCY <= now:
            with suppress(InputError):  # a jump
                compensator.add_estimate(now, *coming.popleft())
        steps.append(compensator.update(now))
    return compensator, steps


def greatest(steps):
    """Return the largest correction of each axis [m, m, rad]."""
    return np.abs([step.disturbance for step in steps]).max(axis=0)


def estimates_of(sequence, rate):
    """Return the poses and variances of parts, after a rest."""
    rest = Part(math.ceil(REST * rate), Pose(0.0, 0.0, 0.0), (1e-3, 1e-3, 1e-3))
    return [(part.pose, [deviation ** 2 for deviation in part.deviations])
            for part in (rest, *sequence) for _ in range(part.count)]


def found_late(place, sway, rate, unknown, uncertain, duration, seed=0):
    """Return poses and variances of a swaying x that is unknown, then uncertain, then good."""
    random = np.random.default_rng(seed)
    for number in range(round(duration * rate)):
        if number < unknown:
            yield Pose(0.0, 0.0, 0.0), (1.0, 1e-8, 1e-8)
            continue
        deviation = 0.015 if number < unknown + uncertain else 0.0005
        x = place + sway * math.sin(0.6 * number / rate)
        yield (Pose(x + deviation * random.standard_normal(), 0.0, 0.0),
               (deviation ** 2, 1e-8, 1e-8))


@pytest.mark.long
@settings(max_examples=25)
@given(places, st.floats(0.0, 0.05), rates, st.integers(0, 50), st.integers(0, 20),
       st.integers(0, 99))
def test_axis_found_at_any_time_keeps_the_correction_bounded(
        place, sway, rate, unknown, uncertain, seed):
    _, steps = correct(found_late(place, sway, rate, unknown, uncertain, 2.5, seed), rate)
    target(beyond := greatest(steps)[0] - abs(place) - sway)
    assert beyond < LATE_MARGIN


@pytest.mark.long
@settings(max_examples=25)
@given(sequences(deviations), rates)
def test_any_bounded_estimates_give_a_bounded_correction(sequence, rate):
    _, steps = correct(estimates_of(sequence, rate), rate, 0.3)
    target(largest := greatest(steps).max())
    assert largest < LARGEST + MARGIN
    assert np.isfinite([step.pose for step in steps]).all()


@pytest.mark.long
@settings(max_examples=25)
@given(sequences(st.just(1e-3)), rates)
def test_distance_from_the_prediction_decays(sequence, rate):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(correction, 'SILENCE', 2.0)  # jumps are rejected for up to 1 s
        compensator, (*_, last) = correct(estimates_of(sequence, rate), rate, 0.5, fade_time=0.1)
        assert compensator.correction.mode is CorrectionMode.ACTIVE
        predicted = compensator.correction.motion(last.time + compensator.following.lag)
        assert last.disturbance == pytest.approx(
            tuple(predicted.position), rel=0.0, abs=1e-3 * LARGEST)
