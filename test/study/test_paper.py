"""Equations, tables and singular loci of the paper."""

import numpy as np
import pytest

from facade_manipulator.kinematics import Geometry
from facade_manipulator.kinematics.maps import pose_map
from facade_manipulator.study import singularities
from facade_manipulator.study.paper import design, table2


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
