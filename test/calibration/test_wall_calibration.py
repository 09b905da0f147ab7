"""The wall, found from where the head has touched it."""

import csv
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import yaml

from facade_manipulator.calibration import fit_wall, touched_points
from facade_manipulator.calibration.__main__ import main
from facade_manipulator.errors import CalibrationError
from facade_manipulator.kinematics import Geometry, mechanism_of, Pose, relative

GEOMETRY = Geometry()
ALONG = np.array([-0.25, -0.1, 0.05, 0.15, 0.25])


def wall(distance, angle, x=ALONG):
    return np.column_stack([x, distance + x * math.tan(angle)])


def touch(points, rail):
    """Return rows of the carriages that touch points while the rail is somewhere."""
    rows = [(*mechanism_of(GEOMETRY).inverse_kinematics(relative(rail, Pose(*point, rail.theta))),
             *rail) for point in points.tolist()]
    return np.array(rows)


@given(st.floats(0.2, 0.3), st.floats(-0.3, 0.3))
def test_a_straight_wall_is_found(distance, angle):
    found = fit_wall(wall(distance, angle))
    assert (found.distance, found.angle) == pytest.approx((distance, angle), abs=1e-7)
    assert found.outliers == []


def test_walls_are_found_within_their_deviations():
    random, off = np.random.default_rng(4), []
    for _ in range(100):
        points = wall(0.25, 0.05) + [0.0, 1e-3] * random.standard_normal((len(ALONG), 2))
        found = fit_wall(points)
        off.append(np.subtract((found.distance, found.angle), (0.25, 0.05)) / found.deviations)
    assert (np.abs(off) < 3.0).mean() >= 0.98
    assert np.std(off) == pytest.approx(1.0, rel=0.2)


def test_a_wall_is_the_same_from_a_rail_that_has_moved():
    table = touch(wall(0.27, 0.02), Pose(0.03, 0.02, -0.04))
    assert touched_points(GEOMETRY, table[:, :3], table[:, 3:]) == pytest.approx(wall(0.27, 0.02))
    at_rest = touch(wall(0.27, 0.02), Pose(0.0, 0.0, 0.0))
    at_rest[:, 3:] = np.nan
    assert touched_points(GEOMETRY, at_rest[:, :3], at_rest[:, 3:]) == pytest.approx(
        wall(0.27, 0.02))


def test_a_touch_on_a_window_sill_is_an_outlier():
    points = wall(0.25, 0.0)
    points[1, 1] -= 0.03
    found = fit_wall(points)
    assert found.outliers == [1]
    assert found.distance == pytest.approx(0.25, abs=2e-3)


@pytest.mark.parametrize(('points', 'message'), [
    (wall(0.25, 0.0)[:2], '2 touches: 3 are needed'),
    (wall(0.25, 0.0, np.array([0.0, 0.01, 0.02])), 'lie within 0.02 m'),
    (np.array([[-0.2, 0.25], [0.0, 0.29], [0.2, 0.25]]), 'no straight wall'),
])
def test_touches_that_show_no_wall_are_rejected(points, message):
    with pytest.raises(CalibrationError, match=message):
        fit_wall(points)


def test_carriages_at_which_the_links_do_not_close_are_named():
    table = np.array([[-0.1, 0.1, 0.0], [-0.5, 0.5, 0.0], [-0.1, 0.1, 0.0]])
    with pytest.raises(CalibrationError, match='row 2'):
        touched_points(GEOMETRY, table, np.full((3, 3), np.nan))


@pytest.mark.parametrize('sill', [0.0, 0.03])
def test_the_command_writes_the_distance_unless_a_touch_contradicts(tmp_path, capsys, sill):
    points = wall(0.28, 0.01)
    points[2, 1] -= sill
    path, target = tmp_path / 'touches.csv', tmp_path / 'calibrated.yaml'
    with path.open('w', newline='') as file:
        rows = csv.writer(file)
        rows.writerow(['q1', 'q2', 'q3', 'rail_x', 'rail_y', 'rail_theta'])
        rows.writerows(touch(points, Pose(0.0, 0.01, 0.0)).tolist())
    assert main(['wall', str(path), '--output', str(target)]) == bool(sill)
    assert target.exists() is not bool(sill)
    said = capsys.readouterr()
    if sill:
        assert 'contradict' in said.err and 'row 3' in said.out
    else:
        content = yaml.safe_load(target.read_text())
        linkage = content['/**/ik_service']['ros__parameters']['linkage']
        assert linkage['wall_distance'] == pytest.approx(0.28, abs=1e-6)
