"""The force law beside what control theory says of it."""

import cmath
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.compensation.impedance import FILTER_TIME, ForceLaw, TIME_CONSTANT

PERIOD, HORIZON, LATENCY = 0.01, 6, 1  # s, cycles
DELAY = PERIOD * (HORIZON + LATENCY)
STIFFNESS = 2000.0


def hold(ratio, wall, duration=30.0):
    """Return the force's error on a wall that is so many times as stiff as the law believes."""
    law, offsets, forces = ForceLaw(), [], []
    for k in range(round(duration / PERIOD)):
        time = (k + HORIZON) * PERIOD
        offset = law.offset + PERIOD * law.velocity(0.0, STIFFNESS / ratio, time)
        law.move(time, offset)
        offsets.append(offset)
        forces.append(STIFFNESS * (offsets[max(k - HORIZON, 0)] + wall(k * PERIOD)))
        if k >= LATENCY:
            law.add_measurement((k - LATENCY) * PERIOD, forces[k - LATENCY])
    return np.array(forces)


def sensitivity(ratio, frequency):
    s = 2j * math.pi * frequency
    late = cmath.exp(-s * DELAY)
    return abs(1.0 / (1.0 + ratio * late / (s * TIME_CONSTANT * DELAY + 1.0 - late)))


@pytest.mark.parametrize('ratio', [1.0 / 1.3, 1.0])
@pytest.mark.parametrize('frequency', [0.1, 0.33, 1.0, 3.0])
def test_the_wall_s_motion_is_let_through_as_the_loop_gain_says(ratio, frequency):
    force = hold(ratio, lambda time: 1e-3 * math.sin(math.tau * frequency * time))
    passed = force[1000:].std() * math.sqrt(2.0) / (STIFFNESS * 1e-3)
    assert passed == pytest.approx(sensitivity(ratio, frequency), rel=0.15)


@pytest.mark.parametrize(
    ('ratio', 'settles'), [(0.1, True), (1.0, True), (3.5, True), (5.0, False)])
def test_a_wall_may_be_four_times_as_stiff_as_the_law_believes(ratio, settles):
    force = abs(hold(ratio, lambda time: 1e-3 * min(time, 1.0)))
    assert (force[-300:].max() < 0.1 * force[:300].max()) == settles


@given(st.floats(-0.1, 0.1), st.floats(-0.04, 0.04), st.floats(0.0, 0.3))
def test_a_force_belongs_to_the_offset_of_its_stamp_and_both_are_filtered_alike(
        begin, speed, stamp):
    law = ForceLaw()
    law.begin(begin)
    for time in (0.1, 0.13, 0.2):
        law.move(time, begin + speed * time)

    def then(time):
        return begin + speed * min(max(time, 0.1), 0.2)

    law.add_measurement(stamp, 20.0)
    assert (law.force, law.offset_then) == pytest.approx((20.0, then(stamp)))
    law.add_measurement(stamp + FILTER_TIME, 10.0)
    old, new = math.exp(-1.0), 1.0 - math.exp(-1.0)
    assert (law.force, law.offset_then) == pytest.approx(
        (10.0 + 10.0 * old, old * then(stamp) + new * then(stamp + FILTER_TIME)))
