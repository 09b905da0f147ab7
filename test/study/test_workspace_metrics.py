"""Limits, areas and volumes, compared with `certify`, grids and the numbers of the paper."""

from hypothesis import assume, given
from hypothesis import strategies as st
from mechanism import DESIGN, NO_GAP, theta_max, VARIANTS
import numpy as np
import pytest

from facade_manipulator.errors import LimitError
from facade_manipulator.kinematics import Geometry, Mechanism, Pose
from facade_manipulator.kinematics.maps import pose_map
from facade_manipulator.study import workspace_metrics
from facade_manipulator.study.paper import design
from facade_manipulator.study.workspace_metrics import Good, measure, y_range

pytestmark = pytest.mark.long

HAIR = 1e-7
fractions = st.floats(1e-6, 1.0 - 1e-6)
geometries = st.sampled_from((DESIGN, NO_GAP, *VARIANTS))
links = st.floats(0.15, 0.4)
platforms = st.floats(0.3, 0.55)
designs = st.builds(design, links, platforms, st.floats(0.5, 1.5), st.floats(0.0, 0.1))


def is_certified(geometry, x, y, theta):
    try:
        Mechanism(geometry).certify(Pose(x, y, theta), min_conditioning=0.0)
    except LimitError:
        return False
    return True


@given(geometries, fractions)
def test_ranges_of_y_and_theta_match_certify(geometry, fraction):
    geometry = Geometry(
        geometry.link_length,
        geometry.platform_half_length,
        (-2.0, 2.0),
        geometry.carriage_gap,
    )
    lower, upper = y_range(geometry)
    y = lower + fraction * (upper - lower)
    bound = theta_max(geometry, y)
    assume(bound > HAIR)
    assert not is_certified(geometry, 0.0, upper + HAIR, 0.0)
    assert lower < 2 * HAIR or not is_certified(geometry, 0.0, lower - HAIR, 0.0)
    for sign in (-1.0, 1.0):
        assert is_certified(geometry, 0.0, y, sign * (bound - HAIR))
        for k in range(40):
            assert is_certified(geometry, 0.0, y, sign * bound * k / 40)
        for k in range(140):
            turn = sign * (bound + HAIR + 0.02 * k)
            assert not is_certified(geometry, 0.0, y, turn)


@given(
    designs,
    st.sampled_from(
        [None, Good(), Good(0.004, 0.001), Good(0.2, 1.0), Good(0.35, 0.348)]
    ),
)
def test_section_area_equals_the_sum_of_widths(geometry, good):
    nodes = 40_000
    y = (np.arange(nodes) + 0.5) * geometry.link_length / nodes
    at = pose_map(geometry, y, 0.0, good.characteristic_length if good else 1.0)
    is_good = at.conditioning >= (good.threshold if good else 0.0)
    expected = (at.width * is_good).sum() * geometry.link_length / nodes
    assert workspace_metrics.section_area(geometry, good) == pytest.approx(
        expected, abs=2e-5
    )


def test_union_area_equals_area_of_fine_grid():
    y = (np.arange(300) + 0.5) * 0.352 / 300
    at = pose_map(NO_GAP, y[:, None], np.linspace(-0.34, 0.34, 681))
    right = np.fmax.reduce(at.upper, axis=1)
    left = np.fmin.reduce(at.lower, axis=1)
    area = np.nansum(right - left) * 0.352 / 300
    assert workspace_metrics.union_area(NO_GAP) == pytest.approx(area, rel=2e-3)


@pytest.mark.parametrize(
    'geometry',
    [
        NO_GAP,
        design(0.3, 0.4, 0.8, 0.01),
        design(0.15, 0.55),
        design(0.34, 0.36, 1.0, 0.03),
    ],
)
@pytest.mark.parametrize('good', [Good(), Good(0.2, 1.0)])
def test_volume_equals_the_sum_over_a_fine_grid(geometry, good):
    y = (np.arange(700) + 0.5) * geometry.link_length / 700
    theta = (np.arange(-1000, 1000) + 0.5) * 1.5e-3
    at = pose_map(geometry, y[:, None], theta, good.characteristic_length)
    total = at.width.sum()
    found = measure(geometry, good)
    cell = geometry.link_length / 700 * 1.5e-3
    good_share = at.width[at.conditioning >= good.threshold].sum() / total
    beyond_share = at.width[at.number <= 0.0].sum() / total
    assert found.volume == pytest.approx(total * cell, rel=3e-3)
    assert found.ratio == pytest.approx(good_share, abs=3e-3)
    assert found.beyond_share == pytest.approx(beyond_share, abs=3e-3)
