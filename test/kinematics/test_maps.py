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
    of = pose_map(geometry, np.array(y)[:, None], np.array(theta), 0.348)
    for row, column in np.ndindex(len(y), len(theta)):
        pose = Pose(0.0, y[row], theta[column])
        assert of.conditioning[row, column] == pytest.approx(
            scalar(local_conditioning_index, geometry, pose, 0.348),
            rel=1e-9,
            nan_ok=True,
        )
        assert of.number[row, column] == pytest.approx(
            scalar(parallel_singularity, geometry, pose), abs=1e-12, nan_ok=True
        )
    assert np.array_equal(
        of.lower, x_intervals(geometry, np.array(y)[:, None], theta)[0], equal_nan=True
    )
    assert (of.width >= 0.0).all()


@given(st.sampled_from(GEOMETRIES), st.floats(0.01, 0.99), st.floats(-1.0, 1.0))
def test_interval_of_x_ends_where_certify_rejects(geometry, up, theta):
    y = up * geometry.link_length
    (lower,), (upper,) = x_intervals(geometry, y, theta)
    if math.isnan(lower):
        assert not any(
            passes(certify, geometry, Pose(x, y, theta), 0.0)
            for x in np.linspace(-0.6, 0.6, 31)
        )
    else:
        ends = (
            inverse_kinematics(geometry, Pose(lower, y, theta)).q1,
            inverse_kinematics(geometry, Pose(upper, y, theta)).q2,
        )
        assert ends == pytest.approx(geometry.stroke)


@pytest.mark.parametrize('length', [0.0, -1.0, math.nan, math.inf])
def test_characteristic_length_must_be_positive(length):
    for index in (
        lambda: pose_map(DESIGN, 0.2, 0.0, length),
        lambda: local_conditioning_index(DESIGN, Pose(0.0, 0.25, 0.0), length),
    ):
        with pytest.raises(ParameterError, match='characteristic_length'):
            index()
