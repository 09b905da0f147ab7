from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
from mechanism import DESIGN, NO_GAP, VARIANTS
import numpy as np
import pytest

from facade_manipulator.errors import LimitError, ParameterError
from facade_manipulator.kinematics import (
    certify,
    compose,
    inverse_kinematics,
    lci_grid,
    local_conditioning_index,
    mechanism_of,
    parallel_singularity,
    Pose,
    pose_map,
    x_intervals,
)
from facade_manipulator.lab.study.reach import y_range

GEOMETRIES = (DESIGN, NO_GAP, *VARIANTS)


def scalar(function, *arguments):
    try:
        return function(*arguments)
    except LimitError:
        return math.nan


@given(st.sampled_from(GEOMETRIES), st.lists(st.floats(-0.4, 0.4), min_size=1, max_size=5),
       st.lists(st.floats(-1.5, 1.5), min_size=1, max_size=5))
def test_maps_are_the_scalar_functions_pose_by_pose(geometry, y, theta):
    of = pose_map(geometry, np.array(y)[:, None], np.array(theta), 0.348)
    for row, column in np.ndindex(len(y), len(theta)):
        pose = Pose(0.0, y[row], theta[column])
        assert of.conditioning[row, column] == pytest.approx(
            scalar(local_conditioning_index, geometry, pose, 0.348), rel=1e-9, nan_ok=True)
        assert of.number[row, column] == pytest.approx(
            scalar(parallel_singularity, geometry, pose), abs=1e-12, nan_ok=True)
    assert np.array_equal(of.lower, x_intervals(
        geometry, np.array(y)[:, None], theta)[0], equal_nan=True)
    assert (of.width >= 0.0).all()


@given(st.sampled_from(GEOMETRIES), st.floats(0.01, 0.99), st.floats(-1.0, 1.0))
def test_the_interval_of_a_map_is_that_of_the_limits_where_certify_agrees(geometry, up, theta):
    y = up * geometry.link_length
    (lower,), (upper,) = x_intervals(geometry, y, theta)
    if math.isnan(lower):
        assert all(math.isnan(scalar(lambda at: certify(geometry, at, 0.0).q1,
                                     Pose(x, y, theta))) for x in np.linspace(-0.6, 0.6, 31))
    else:
        ends = (inverse_kinematics(geometry, Pose(lower, y, theta)).q1,
                inverse_kinematics(geometry, Pose(upper, y, theta)).q2)
        assert ends == pytest.approx(geometry.stroke)


@pytest.mark.parametrize('length', [0.0, -1.0, math.nan])
def test_a_map_needs_a_characteristic_length(length):
    with pytest.raises(ParameterError, match='characteristic_length'):
        pose_map(DESIGN, 0.2, 0.0, length)


@given(st.sampled_from(GEOMETRIES), st.floats(-0.6, 0.6), st.floats(0.004, 0.03))
def test_a_cell_of_the_grid_is_reachable_exactly_where_certify_says(geometry, theta, resolution):
    cells, (x0, y0, _) = lci_grid(geometry, theta, resolution)
    assert cells.dtype == np.int8 and cells.min() >= -1 and cells.max() in (-1, 100)
    random = np.random.default_rng(7)
    for row, column in zip(random.integers(0, cells.shape[0], 60),
                           random.integers(0, cells.shape[1], 60), strict=True):
        pose = Pose(x0 + (column + 0.5) * resolution, y0 + (row + 0.5) * resolution, theta)
        reachable = not math.isnan(scalar(lambda at: certify(geometry, at, 0.0).q1, pose))
        assert (cells[row, column] >= 0) == reachable


def test_the_grid_scales_the_index_to_its_greatest_and_covers_stroke_and_links():
    cells, origin = lci_grid(DESIGN, 0.0, 0.01)
    assert cells.shape == (36, 100) and origin == (-0.5, 0.0, 0.0)
    middle = cells[:, 50]
    y = 0.01 * (np.arange(36) + 0.5)
    lower, _ = y_range(DESIGN)
    index = [local_conditioning_index(DESIGN, Pose(0.0, at, 0.0))
             for at in y if lower < at < 0.352]
    expected = np.rint(100.0 * np.array(index) / max(index))
    assert middle[middle >= 0].tolist() == expected.tolist()


def test_the_grid_lies_where_the_head_of_a_machine_with_tool_and_rail_angle_can_be():
    made, theta, resolution = replace(
        DESIGN, tool=(0.03, 0.08, 0.1), rail_angle=0.1), 0.05, 0.005
    cells, origin = lci_grid(made, theta, resolution)
    machine, random = mechanism_of(made), np.random.default_rng(3)
    for row, column in random.integers((0, 0), cells.shape, (300, 2)):
        middle = compose(origin, Pose((column + 0.5) * resolution, (row + 0.5) * resolution, 0.0))
        reachable = not math.isnan(scalar(
            lambda at: machine.certify(at, 0.0).q1, middle._replace(theta=theta)))
        assert (cells[row, column] >= 0) == reachable


def test_beyond_the_greatest_angle_the_grid_is_empty_and_keeps_its_size():
    cells, _ = lci_grid(DESIGN, 0.6, 0.01)
    assert cells.shape == (36, 100) and (cells == -1).all()


@pytest.mark.parametrize(('theta', 'resolution', 'words'), [
    (0.0, 0.0, 'resolution'), (0.0, -0.01, 'resolution'), (0.0, math.nan, 'resolution'),
    (0.0, 1e-5, 'cells'), (math.nan, 0.01, 'theta'), (math.inf, 0.01, 'theta')])
def test_a_grid_that_cannot_be_is_rejected(theta, resolution, words):
    with pytest.raises(ParameterError, match=words):
        lci_grid(DESIGN, theta, resolution)


@pytest.mark.parametrize(('module', 'needless'), [
    ('kinematics.maps', ('matplotlib', 'scipy', 'rich')), ('lab.study', ('matplotlib', 'scipy'))])
def test_maps_and_study_are_imported_without_what_they_do_not_need(module, needless):
    import subprocess
    import sys
    code = (f'import sys, facade_manipulator.{module}; '
            f'print([name for name in {needless} if name in sys.modules])')
    shown = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True,
                           check=True, timeout=60)
    assert shown.stdout.strip() == '[]'
