"""Equations, tables and singular loci of the paper."""

from hypothesis import given
from mechanism import regular_poses
import numpy as np
import pytest

from facade_manipulator import kinematics
from facade_manipulator.kinematics import Geometry, inverse_kinematics, pose_map
from facade_manipulator.study import singularities
from facade_manipulator.study.paper import design, table2


def matrices(geometry, pose):
    """Return A and B of eqs 15 and 16."""
    q1, q2, q3 = inverse_kinematics(geometry, pose)
    b, y = geometry.platform_half_length, pose.y
    s, c = np.sin(pose.theta), np.cos(pose.theta)
    first, second = 2 * b * c + 2 * q1 - 2 * q3, 2 * b * c - 2 * q2 + 2 * q3
    a = np.array([[first, 0, -first], [0, second, -second], [0, 0, 1]])
    return a, np.array([
        [0, 2 * b * s - 2 * y, 2 * b * s * (q1 - q3) + 2 * b * y * c],
        [0, 2 * b * s + 2 * y, 2 * b * s * (q2 - q3) + 2 * b * y * c],
        [1, 0, 0]])


@given(regular_poses())
def test_jacobian_and_index_follow_from_equations_15_to_25(drawn):
    geometry, pose = drawn
    a, b = matrices(geometry, pose)
    jacobian = np.linalg.solve(a, b)
    (number,) = pose_map(geometry, pose.y, pose.theta).number
    *_, s1, s2 = kinematics.links(geometry, pose)
    assert jacobian == pytest.approx(
        np.array(kinematics.jacobian(geometry, pose)), rel=1e-9, abs=1e-9)
    assert np.linalg.det(a) == pytest.approx(4.0 * s1 * s2, abs=1e-12)
    assert np.linalg.det(b) == pytest.approx(
        -4.0 * geometry.platform_half_length * number, abs=1e-12)
    norms = [np.sqrt(np.trace(one.T @ one) / 3.0) for one in (jacobian, np.linalg.inv(jacobian))]
    assert kinematics.local_conditioning_index(geometry, pose) == pytest.approx(
        1.0 / np.prod(norms), rel=1e-6)


def test_table_2_changes_little_with_one_metre_stroke():
    for row in table2(1.0):
        assert row['ratio'] == pytest.approx(row['paper']['ratio'], abs=0.0011)


@pytest.mark.parametrize('length', [0.2, 0.3, 0.34])
def test_determinants_vanish_on_the_singular_curves(length):
    geometry = Geometry(length, 0.7 - length, carriage_gap=0.0)
    theta = np.linspace(-0.5, 0.5, 41)
    for curve in singularities.parallel_curves(geometry, theta):
        number = pose_map(geometry, curve, theta).number[~np.isnan(curve)]
        assert np.abs(number).max(initial=0.0) < 1e-8
    edge = singularities.serial_curve(geometry, theta)
    inside = pose_map(geometry, edge * (1.0 - 1e-9), theta)
    outside = pose_map(geometry, edge * (1.0 + 1e-9), theta)
    assert np.isfinite(inside.conditioning[~np.isnan(edge)]).all()
    assert np.isnan(outside.conditioning).all()


def test_figure_7_configurations_are_singular_as_titled():
    geometry = design(0.25, 0.45)
    for title, pose in singularities.configurations(geometry).items():
        (number,) = pose_map(geometry, pose.y, pose.theta).number
        if 'det A = 0' in title:
            assert pose.y == geometry.link_length
        else:
            assert (abs(number) < 1e-9) == ('det B = 0' in title)
            assert number < -1e-4 or 'beyond' not in title
