import math

from hypothesis import assume, given
from hypothesis import strategies as st
from mechanism import DESIGN, NO_GAP, VARIANTS
import pytest

from facade_manipulator.errors import CarriageGapError, LimitError, UnreachableError
from facade_manipulator.kinematics import certify, Geometry, Pose, x_intervals
from facade_manipulator.lab.study.reach import theta_max, y_range

HAIR = 1e-7
WIDE = (-2.0, 2.0)  # a stroke that never limits
geometries = st.sampled_from((DESIGN, NO_GAP, *VARIANTS))


def unlimited(geometry):
    return Geometry(
        geometry.link_length, geometry.platform_half_length, WIDE, geometry.carriage_gap)


def certified(geometry, x, y, theta):
    try:
        certify(geometry, Pose(x, y, theta), min_conditioning=0.0)
    except LimitError:
        return False
    return True


@pytest.mark.parametrize(('y', 'degrees'), [
    (60, 1.10), (100, 5.94), (150, 10.88), (200, 15.50), (238.6, 19.02), (260, 15.33),
    (280, 11.94), (340, 1.98),
])
def test_the_design_turns_as_far_as_the_design_page_says(y, degrees):
    assert math.degrees(theta_max(NO_GAP, y / 1e3)) == pytest.approx(degrees, abs=5.1e-3)


@given(geometries, st.floats(0.001, 0.999))
def test_the_greatest_angle_is_exactly_where_certify_changes_its_mind(geometry, fraction):
    geometry = unlimited(geometry)
    lower, upper = y_range(geometry)
    y = lower + fraction * (upper - lower)
    bound = theta_max(geometry, y)
    assume(bound > HAIR)
    for sign in (-1.0, 1.0):
        assert certified(geometry, 0.0, y, sign * (bound - HAIR))
        assert not certified(geometry, 0.0, y, sign * (bound + HAIR))
        assert all(certified(geometry, 0.0, y, sign * bound * k / 40) for k in range(40))
        assert not any(certified(geometry, 0.0, y, sign * (bound + HAIR + 0.02 * k))
                       for k in range(140))


@given(geometries)
def test_the_range_of_y_is_exactly_where_certify_changes_its_mind(geometry):
    geometry = unlimited(geometry)
    lower, upper = y_range(geometry)
    assume(upper - lower > 3 * HAIR)
    assert certified(geometry, 0.0, lower + HAIR, 0.0)
    assert certified(geometry, 0.0, upper - HAIR, 0.0)
    assert not certified(geometry, 0.0, upper + HAIR, 0.0)
    assert lower < 2 * HAIR or not certified(geometry, 0.0, lower - HAIR, 0.0)


@given(geometries, st.floats(0.001, 0.999), st.floats(-0.999, 0.999))
def test_the_interval_of_x_is_exactly_where_certify_changes_its_mind(geometry, up, turn):
    lower, upper = y_range(geometry)
    y = lower + up * (upper - lower)
    theta = turn * theta_max(geometry, y)
    (least,), (greatest,) = x_intervals(geometry, y, theta)
    if math.isnan(least):
        assert not any(certified(geometry, k * 0.01, y, theta) for k in range(-100, 100))
        return
    assume(greatest - least > 3 * HAIR)
    assert certified(geometry, least + HAIR, y, theta)
    assert certified(geometry, greatest - HAIR, y, theta)
    assert not certified(geometry, least - HAIR, y, theta)
    assert not certified(geometry, greatest + HAIR, y, theta)


def test_beyond_the_range_of_y_the_bound_that_is_passed_is_named():
    with pytest.raises(CarriageGapError, match='y = 0.1 m is below the bound 0.12775 m'):
        theta_max(DESIGN, 0.1)
    with pytest.raises(UnreachableError, match='y = 0.4 m is not below the bound 0.352 m'):
        theta_max(DESIGN, 0.4)


@pytest.mark.parametrize('bad', [math.nan, math.inf])
def test_limits_of_numbers_that_are_not_finite_are_value_errors(bad):
    with pytest.raises(ValueError, match='is not a finite number'):
        theta_max(DESIGN, bad)
