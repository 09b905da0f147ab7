"""Bounds of the correction for bounded estimates, through the whole compensator."""

import math

from compensation.compensated_head import CompensatedHead
from hypothesis import given, settings, target
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.kinematics import Pose

pytestmark = pytest.mark.long

LATENCY = 0.005  # s
REST = 0.6  # s, with the gondola at rest before the estimates of an example
LARGEST = 0.5  # m, m, rad: bound of the estimates
# m, m, rad, by which the correction may leave it: at 10 Hz the prediction overshoots jumps of 1 m
MARGIN = 1.0
LATE_MARGIN = 0.1  # m, of an axis found late: its correction fades in

places = st.floats(-LARGEST, LARGEST)
small_deviations = st.floats(-4.0, -2.0).map(lambda power: 10.0**power)
deviations = st.one_of(small_deviations, st.just(1.0))
poses = st.builds(Pose, places, places, places)
deviations_of_axes = st.tuples(deviations, deviations, deviations)
# number of successive estimates, their pose, and the standard deviation of each axis
estimates = st.tuples(st.integers(1, 10), poses, deviations_of_axes)
sequences = st.lists(estimates, min_size=1, max_size=6)
rates = st.sampled_from([10.0, 20.0, 30.0, 50.0, 100.0, 200.0])


def correct(estimates, rate, extra=0.0):
    """Return the corrections until all estimates and an extra time [s] are over."""
    estimates = list(estimates)
    head = CompensatedHead(goal=Pose(0.0, 0.25, 0.0), rate=rate, age=LATENCY)

    def add(stamp):
        for estimate in estimates[head.count - 1 : head.count]:
            head.compensator.add_estimate(head.now, stamp, *estimate)

    head.add_estimate = add
    return head.run(len(estimates) / rate + extra).all('disturbance')


def found_late(place, sway, rate, unknown, uncertain, duration, seed=0):
    """Return poses and variances of a swaying x that is unknown, then uncertain, then good."""
    random = np.random.default_rng(seed)
    for number in range(round(duration * rate)):
        if number < unknown:
            yield Pose(0.0, 0.0, 0.0), (1.0, 1e-8, 1e-8)
            continue
        deviation = 0.015 if number < unknown + uncertain else 0.0005
        x = place + sway * math.sin(0.6 * number / rate)
        estimate = x + deviation * random.standard_normal()
        yield Pose(estimate, 0.0, 0.0), (deviation**2, 1e-8, 1e-8)


@settings(max_examples=25)
@given(
    places,
    st.floats(0.0, 0.05),
    rates,
    st.integers(0, 50),
    st.integers(0, 20),
    st.integers(0, 99),
)
def test_axis_found_at_any_time_keeps_the_correction_bounded(
    place, sway, rate, unknown, uncertain, seed
):
    found = correct(found_late(place, sway, rate, unknown, uncertain, 2.5, seed), rate)
    target(beyond := abs(found[:, 0]).max() - abs(place) - sway)
    assert beyond < LATE_MARGIN


@settings(max_examples=25)
@given(sequences, rates)
def test_any_bounded_estimates_give_a_bounded_correction(sequence, rate):
    count_at_rest = math.ceil(REST * rate)
    rest = (count_at_rest, Pose(0.0, 0.0, 0.0), (1e-3, 1e-3, 1e-3))
    estimates = []
    for count, pose, each in (rest, *sequence):
        for _ in range(count):
            estimates.append((pose, [one**2 for one in each]))
    target(largest := abs(correct(estimates, rate, 0.3)).max())
    assert largest < LARGEST + MARGIN
