import math

from hypothesis import given
from hypothesis import strategies as st
from mechanism import DESIGN, regular_poses, workspace_poses
import numpy as np
import pytest

from facade_manipulator.errors import UnreachableError
from facade_manipulator.kinematics import (
    Geometry,
    inverse_kinematics,
    jacobian,
    links,
    local_conditioning_index,
    parallel_singularity,
    Pose,
)


def paper_matrices(geometry, pose):
    """Return the matrices A and B of eqs 15-16, as printed."""
    b = geometry.platform_half_length
    s = math.sin(pose.theta)
    c = math.cos(pose.theta)
    q1, q2, q3 = inverse_kinematics(geometry, pose)
    y = pose.y
    p = q1 - q3
    r = q2 - q3
    first = 2 * b * c + 2 * p
    second = 2 * b * c - 2 * r
    a = np.zeros((3, 3))
    a[0] = (first, 0.0, -first)
    a[1] = (0.0, second, -second)
    a[2] = (0.0, 0.0, 1.0)
    matrix_b = np.zeros((3, 3))
    matrix_b[0] = (0.0, 2 * b * s - 2 * y, 2 * b * s * p + 2 * b * y * c)
    matrix_b[1] = (0.0, 2 * b * s + 2 * y, 2 * b * s * r + 2 * b * y * c)
    matrix_b[2] = (1.0, 0.0, 0.0)
    return a, matrix_b


@given(regular_poses())
def test_jacobian_equals_eqs_15_and_16(drawn):
    geometry, pose = drawn
    a, b = paper_matrices(geometry, pose)
    matrix = jacobian(geometry, pose)
    number = parallel_singularity(geometry, pose)
    *_, s1, s2 = links(geometry, pose)
    half = geometry.platform_half_length
    expected = np.linalg.solve(a, b)
    assert np.allclose(matrix, expected, rtol=1e-9, atol=1e-9)
    assert np.linalg.det(a) == pytest.approx(4.0 * s1 * s2, rel=1e-9)
    serial = -4.0 * half * number
    assert np.linalg.det(b) == pytest.approx(serial, rel=1e-9, abs=1e-12)
    quotient = -half * number / (s1 * s2)
    assert np.linalg.det(matrix) == pytest.approx(quotient, rel=1e-7)


@given(workspace_poses(Geometry(carriage_gap=0.0)))
def test_branch_number_of_the_design_exceeds_5600_mm2(pose):
    assert parallel_singularity(DESIGN, pose) > 5600e-6 - 1e-9


def test_jacobian_beyond_reach_is_rejected():
    for function in (jacobian, parallel_singularity, local_conditioning_index):
        with pytest.raises(UnreachableError):
            function(DESIGN, Pose(0.0, 0.4, 0.0))
        with pytest.raises(ValueError, match='theta = nan'):
            function(DESIGN, Pose(0.0, 0.2, math.nan))


def weighted_norm(matrix):
    """Return the Frobenius norm of a matrix with the weight 1/3."""
    return math.sqrt(np.trace(matrix.T @ matrix) / 3.0)


@given(regular_poses(), st.floats(1e-3, 2.0), st.floats(-0.3, 0.3))
def test_conditioning_index_equals_the_matrix_formula(drawn, length, shift):
    geometry, pose = drawn
    matrix = jacobian(geometry, pose) / [1.0, 1.0, length]
    product = weighted_norm(matrix) * weighted_norm(np.linalg.inv(matrix))
    index = local_conditioning_index(geometry, pose, length)
    assert index == pytest.approx(1.0 / product, rel=1e-7)
    moved = pose._replace(x=pose.x + shift)
    mirrored = pose._replace(theta=-pose.theta)
    assert local_conditioning_index(geometry, moved, length) == index
    assert local_conditioning_index(geometry, mirrored, length) == pytest.approx(
        index, rel=1e-12
    )


def test_conditioning_index_of_the_folded_platform_is_zero():
    assert local_conditioning_index(DESIGN, Pose(0.0, 0.0, 0.0)) == 0.0
