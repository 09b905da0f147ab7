import math

from hypothesis import given
from hypothesis import strategies as st
from mechanism import certify, DESIGN, NO_GAP, passes, VARIANTS
import numpy as np
import pytest

from facade_manipulator.errors import LimitError, ParameterError
from facade_manipulator.kinematics import (
    inverse_kinematics,
    local_conditioning_index,
    parallel_singularity,
    Pose,
)
from facade_manipulator.kinematics.maps import pose_map, x_intervals

GEOMETRIES = (DESIGN, NO_GAP, *VARIANTS)


def scalar(function, *arguments):
    try:
        return function(*arguments)
    except LimitError:
        return math.nan


@given(
    st.sampled_from(GEOMETRIES),
    st.lists(st.floats(-0.4, 0.4), min_size=1, max_size=5),
    st.lists(st.floats(-1.5, 1.5), min_size=1, max_size=5),
)
def test_maps_equal_the_scalar_functions(geometry, y, theta):
    rows = np.array(y)[:, None]
    of = pose_map(geometry, rows, np.array(theta), 0.348)
    for row, column in np.ndindex(len(y), len(theta)):
        pose = Pose(0.0, y[row], theta[column])
        index = scalar(local_conditioning_index, geometry, pose, 0.348)
        number = scalar(parallel_singularity, geometry, pose)
        same_index = pytest.approx(index, rel=1e-9, nan_ok=True)
        same_number = pytest.approx(number, abs=1e-12, nan_ok=True)
        assert of.conditioning[row, column] == same_index
        assert of.number[row, column] == same_number
    lower, _ = x_intervals(geometry, rows, theta)
    assert np.array_equal(of.lower, lower, equal_nan=True)
    assert (of.width >= 0.0).all()


@given(st.sampled_from(GEOMETRIES), st.floats(0.01, 0.99), st.floats(-1.0, 1.0))
def test_interval_of_x_ends_where_certify_rejects(geometry, up, theta):
    y = up * geometry.link_length
    (lower,), (upper,) = x_intervals(geometry, y, theta)
    if math.isnan(lower):
        for x in np.linspace(-0.6, 0.6, 31):
            assert not passes(certify, geometry, Pose(x, y, theta), 0.0)
    else:
        left = inverse_kinematics(geometry, Pose(lower, y, theta)).q1
        right = inverse_kinematics(geometry, Pose(upper, y, theta)).q2
        assert (left, right) == pytest.approx(geometry.stroke)


@pytest.mark.parametrize('length', [0.0, -1.0, math.nan, math.inf])
def test_characteristic_length_must_be_positive(length):
    for index in (
        lambda: pose_map(DESIGN, 0.2, 0.0, length),
        lambda: local_conditioning_index(DESIGN, Pose(0.0, 0.25, 0.0), length),
    ):
        with pytest.raises(ParameterError, match='characteristic_length'):
            index()
