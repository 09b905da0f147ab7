"""Courses near one instant, as polynomials."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.prediction.polynomial import PolynomialMotion

CENTRE, REACH = 1000.0, 0.02
numbers = st.floats(-10.0, 10.0)
coefficients = st.lists(st.tuples(*[numbers] * 4), min_size=3, max_size=3)


@given(coefficients, st.floats(-REACH, REACH))
def test_place_and_velocity_are_the_polynomial_and_its_derivative(axes, elapsed):
    time = CENTRE + elapsed
    course = PolynomialMotion(CENTRE, REACH, list(zip(*axes, strict=True))).at(time)
    elapsed = time - CENTRE
    assert course.position == pytest.approx([np.polyval(axis, elapsed) for axis in axes])
    assert course.velocity == pytest.approx(
        [np.polyval(np.polyder(axis), elapsed) for axis in axes])


@pytest.mark.parametrize(('elapsed', 'covered'), [
    (0.0, True), (0.019, True), (-0.019, True), (0.021, False), (-0.021, False)])
def test_a_course_is_good_for_its_reach_alone(elapsed, covered):
    course = PolynomialMotion(CENTRE, REACH, [(0.0,) * 3])
    assert course.covers(CENTRE + elapsed) is covered
