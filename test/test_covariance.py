"""Rule for the variances in messages."""

import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.covariance import is_measured, MIN_DEVIATION, used_variance

UNMEASURED = (-1.0, -1e-300, math.nan, math.inf, -math.inf, 1e-4 + 1e-12, 1e300)


@pytest.mark.parametrize('variance', UNMEASURED)
def test_unmeasured_value_is_marked_by_its_variance(variance):
    assert not is_measured(variance, largest_deviation=0.01)


@given(st.floats(0.0, 1e-4))
def test_variance_from_zero_to_the_limit_is_measured(variance):
    assert is_measured(variance, largest_deviation=0.01)


@pytest.mark.parametrize('zero', [0.0, -0.0])
def test_missing_variance_has_the_default_noise(zero):
    assert is_measured(zero)
    assert used_variance(zero, 0.002) == 0.002**2


@given(st.floats(1e-300, 1.0))
def test_given_variance_is_used_with_a_minimum(variance):
    assert used_variance(variance, 0.002) == max(variance, MIN_DEVIATION**2)
