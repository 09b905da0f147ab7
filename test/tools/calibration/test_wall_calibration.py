"""The wall, found from where the head has touched it."""

import csv
import math

from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
import pytest
import yaml

from facade_manipulator.errors import CalibrationError
from facade_manipulator.kinematics import compose, Geometry, mechanism_of, Pose, relative
from facade_manipulator.prediction.estimate import EstimateSettings
from facade_manipulator.prediction.mounting import estimator_motion, rail_pose
from facade_manipulator.tools.calibration.__main__ import main
from facade_manipulator.tools.calibration.wall_fit import (
    along_wall,
    fit_wall,
    mean_by_second,
    touched_points,
)

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
@example(0.25, 1e-12)  # of which no step is a share
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


def test_what_gives_way_to_the_force_is_found_with_the_wall():
    forces = np.resize([3.0, 10.0, 30.0], len(ALONG))
    pressed = wall(0.25, 0.05) + np.outer(forces, [0.0, 5e-4])
    found = fit_wall(pressed, 1e-4, forces)
    assert (found.distance, found.angle) == pytest.approx((0.25, 0.05), abs=1e-4)
    assert found.yields == pytest.approx(5e-4, rel=0.01)
    with pytest.raises(CalibrationError, match='touch with less force too'):
        fit_wall(pressed, 1e-4, np.full(len(ALONG), 30.0))


@given(st.floats(-0.2, 0.2), st.tuples(*[st.floats(-1.0, 1.0)] * 2), st.floats(-0.5, 0.5))
def test_along_the_wall_estimates_put_it_at_its_distance(angle, place, axes):
    estimate, random = EstimateSettings(
        mounting=(*place, 0.02), axes=axes), np.random.default_rng(1)
    rails = [Pose(*row) for row in random.uniform(-0.03, 0.03, (len(ALONG), 3)).tolist()]
    heads = [relative(rail, Pose(*point, 0.0))
             for rail, point in zip(rails, wall(0.26, angle).tolist(), strict=True)]
    published = [estimator_motion(rail, Pose(*estimate.mounting), axes) for rail in rails]
    turned, distance = along_wall(estimate, fit_wall(wall(0.26, angle)))
    points = np.array([
        compose(rail_pose(seen, Pose(*turned.mounting), turned.axes), head)[:2]
        for seen, head in zip(published, heads, strict=True)])
    assert points[:, 1] == pytest.approx(distance, abs=1e-6)


def test_means_are_of_each_second():
    means = mean_by_second(np.array([10.2, 10.8, 12.1]), np.array([[1.0], [3.0], [7.0]]))
    assert means.tolist() == [[2.0], [7.0]]


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
def test_the_command_aligns_facade_unless_a_touch_contradicts(tmp_path, capsys, sill):
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
        assert '+280.00 +- ' in said.out
        parameters = yaml.safe_load(target.read_text())['/**/compensator']['ros__parameters']
        assert parameters['estimate']['axes'] == pytest.approx(-0.01, abs=1e-4)
        assert parameters['estimate']['mounting'] == pytest.approx([0.0, 0.0, 0.01], abs=1e-4)
