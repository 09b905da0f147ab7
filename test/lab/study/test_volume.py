import math

from hypothesis import given
from hypothesis import strategies as st
from mechanism import NO_GAP
import numpy as np
import pytest

from facade_manipulator.kinematics import Geometry, pose_map
from facade_manipulator.lab.study import singularities
from facade_manipulator.lab.study.section import Designs, section_area, section_bounds
from facade_manipulator.lab.study.volume import measure, union_area

designs = st.builds(
    Designs, st.floats(0.15, 0.4), st.floats(0.3, 0.55), st.floats(0.5, 1.5), st.floats(0.0, 0.1))


def of_section(design, threshold=0.0, characteristic_length=1.0, nodes=40_000):
    """The section θ = 0 summed numerically over y."""
    length, half, stroke, gap = design
    geometry = Geometry(length, half, (-0.5 * stroke, 0.5 * stroke), gap)
    y = (np.arange(nodes) + 0.5) * length / nodes
    of = pose_map(geometry, y, 0.0, characteristic_length)
    return float((of.width * (of.conditioning >= threshold)).sum() * length / nodes)


@given(designs)
def test_the_section_area_is_its_closed_form(design):
    assert section_area(design) == pytest.approx(of_section(design), abs=2e-5)


@given(designs, st.sampled_from([(0.001, 0.001), (0.004, 0.001), (0.2, 1.0), (0.35, 0.348)]))
def test_the_good_section_area_is_its_closed_form(design, good):
    assert section_area(design, *good) == pytest.approx(of_section(design, *good), abs=2e-5)


def test_the_section_of_the_design_begins_at_the_order_and_ends_at_the_reach():
    assert section_bounds(NO_GAP) == pytest.approx((math.sqrt(0.0028), 0.352))
    lower, upper = section_bounds(Designs(0.352, 0.348, 0.05, 0.02))
    assert upper < 0.352 and lower < upper


def test_the_union_over_theta_is_what_a_fine_grid_covers():
    y = (np.arange(300) + 0.5) * 0.352 / 300
    theta = np.linspace(-0.34, 0.34, 681)
    of = pose_map(NO_GAP, y[:, None], theta)
    lower = np.nanmin(np.where(np.isnan(of.lower), np.inf, of.lower), axis=1)
    upper = np.nanmax(np.where(np.isnan(of.upper), -np.inf, of.upper), axis=1)
    covered = np.maximum(0.0, np.where(np.isfinite(lower), upper - lower, 0.0)).sum()
    assert union_area(NO_GAP) == pytest.approx(covered * 0.352 / 300, rel=2e-3)


def test_a_good_share_lies_between_nothing_and_everything():
    assert measure(NO_GAP, 0.0).ratio == pytest.approx(1.0)
    assert measure(NO_GAP, 1.0).ratio == pytest.approx(0.0, abs=1e-9)
    assert math.isnan(measure(Geometry(0.15, 0.55, (-0.3, 0.3), 0.0), 0.1).ratio)


@pytest.mark.parametrize('length', [0.2, 0.3, 0.34])
def test_on_the_singular_curves_the_determinants_vanish(length):
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


def test_the_design_has_no_parallel_singularity_before_the_rail():
    lower, upper = singularities.parallel_curves(NO_GAP, np.linspace(-0.3, 0.3, 31))
    assert np.isnan(lower).all() and np.isnan(upper).all()


def test_the_drawn_configurations_are_singular_or_regular_as_their_notes_say():
    by_name = {case.name[0]: case for case in singularities.configurations()}
    folded = pose_map(by_name['a'].geometry, by_name['a'].pose.y, by_name['a'].pose.theta)
    assert folded.number[0] == 0.0
    for name in 'bd':
        case = by_name[name]
        of = pose_map(case.geometry, case.pose.y, case.pose.theta)
        assert abs(of.number[0]) > 1e-4 and of.conditioning[0] > 0.0
    assert by_name['c'].pose.y == by_name['c'].geometry.link_length
    missed = by_name['e']
    assert abs(pose_map(missed.geometry, missed.pose.y, missed.pose.theta).number[0]) < 1e-9
