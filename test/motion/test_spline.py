from itertools import accumulate, pairwise

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.motion.spline import inner_slopes

STEPS = st.lists(st.floats(0.5, 2.0), min_size=1, max_size=12)
NUMBERS = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


def times_of(steps):
    return list(accumulate(steps, initial=0.0))


def acceleration(side, a, b, slope_a, slope_b, step):
    """Second derivative at an end of the cubic between two points, of one coordinate."""
    rise = 6.0 * (b - a) / step ** 2
    if side == 'begin':
        return rise - (4.0 * slope_a + 2.0 * slope_b) / step
    return (2.0 * slope_a + 4.0 * slope_b) / step - rise


@given(STEPS, st.tuples(*[NUMBERS] * 4))
def test_a_cubic_is_given_back(steps, coefficients):
    def at(time, power=0):
        return tuple(
            sum(c * time ** k for k, c in enumerate(one)) if power == 0 else
            sum(k * c * time ** (k - 1) for k, c in enumerate(one) if k)
            for one in zip(*coefficients, strict=True))

    times = times_of(steps)
    slopes = inner_slopes(
        times, [at(time) for time in times], at(times[0], 1), at(times[-1], 1))
    assert len(slopes) == len(times) - 2
    for time, slope in zip(times[1:-1], slopes, strict=True):
        assert slope == pytest.approx(at(time, 1), rel=1e-6, abs=1e-6)


@given(STEPS, st.data())
def test_at_no_inner_point_does_the_acceleration_jump(steps, data):
    times = times_of(steps)
    points = [data.draw(NUMBERS) for _ in times]
    ends = data.draw(NUMBERS), data.draw(NUMBERS)
    slopes = [ends[0], *inner_slopes(times, points, *ends), ends[1]]
    pieces = list(pairwise(zip(points, slopes, strict=True)))
    for (left, right), (before, after) in zip(
            pairwise(pieces), pairwise(steps), strict=True):
        for axis in range(3):
            ends = [
                acceleration(side, *(point[axis] for point in (a[0], b[0], a[1], b[1])), step)
                for side, (a, b), step in (('end', left, before), ('begin', right, after))]
            assert ends[0] == pytest.approx(ends[1], abs=1e-9)


def test_two_points_have_no_inner_slope():
    assert inner_slopes([0.0, 1.0], [(0.0,) * 3] * 2, (1.0,) * 3, (1.0,) * 3) == []
