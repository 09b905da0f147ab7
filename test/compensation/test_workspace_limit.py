"""Limit of the workspace, reached without a corner in the path."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.compensation.workspace_limit import WorkspaceLimit
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry, Mechanism, MIN_CONDITIONING, Pose

GEOMETRY = Geometry()
MADE = Geometry(
    link_errors=(1e-3, -1e-3),
    platform_errors=(-1e-3, 1e-3),
    rail_angle=0.01,
    carriage_offsets=(2e-3, -1e-3, 1e-3),
    tool=(0.01, 0.08, 0.02),
)
#: platforms long in comparison with the links, and a stroke that the platform nearly fills
CONDITIONED = [Geometry(0.15, 0.55), Geometry(0.25, 0.45), Geometry(0.34, 0.36)]
NARROW = Geometry(0.578, 0.572)
GEOMETRIES = [GEOMETRY, MADE, *CONDITIONED, NARROW]
turns = st.floats(-1.0, 1.0)
anywhere = st.builds(Pose, st.floats(-1.0, 1.0), st.floats(-0.5, 0.6), turns)
small_turns = st.floats(-0.1, 0.1)
well_inside = st.builds(Pose, st.floats(-0.25, 0.25), st.floats(0.2, 0.28), small_turns)


@pytest.mark.parametrize('geometry', GEOMETRIES, ids=str)
@given(pose=anywhere)
def test_saturated_pose_plus_removed_part_is_the_input(geometry, pose):
    saturated = WorkspaceLimit(geometry, MIN_CONDITIONING).saturate(pose, slope=0.0)
    Mechanism(geometry).certify(saturated.pose)
    wanted = np.add(saturated.pose, saturated.saturation_error)
    assert wanted == pytest.approx(tuple(pose), abs=1e-12)


@given(anywhere)
def test_saturated_pose_has_the_required_conditioning(pose):
    saturated = WorkspaceLimit(GEOMETRY, min_conditioning=0.3).saturate(pose, slope=0.0)
    Mechanism(GEOMETRY).certify(saturated.pose, min_conditioning=0.3)


@pytest.mark.parametrize(
    ('min_conditioning', 'margin'),
    [
        (0.9, WorkspaceLimit.WORKSPACE_MARGIN),
        (MIN_CONDITIONING, 0.3),
        (MIN_CONDITIONING, math.inf),
    ],
)
def test_limit_without_workspace_is_rejected(monkeypatch, min_conditioning, margin):
    monkeypatch.setattr(WorkspaceLimit, 'WORKSPACE_MARGIN', margin)
    with pytest.raises(ParameterError, match='no workspace in y'):
        WorkspaceLimit(GEOMETRY, min_conditioning)


@given(well_inside)
def test_pose_well_inside_is_not_changed(pose):
    saturated = WorkspaceLimit(GEOMETRY, MIN_CONDITIONING).saturate(pose, slope=0.0)
    assert saturated.pose == pose
    assert saturated.saturation_error == (0.0, 0.0, 0.0)


@given(anywhere, st.floats(-0.3, 0.3))
def test_saturated_x_keeps_the_distance_from_an_oblique_wall(pose, slope):
    limit = WorkspaceLimit(GEOMETRY, MIN_CONDITIONING)
    pose = pose._replace(y=0.25, theta=0.0)
    inside = limit.saturate(pose, slope)
    Mechanism(GEOMETRY).certify(inside.pose)
    if not inside.saturation_error.y:
        gained = inside.pose.y - pose.y
        expected = slope * inside.saturation_error.x
        tolerance = 0.12 * abs(gained) + 1e-9
        assert gained == pytest.approx(expected, abs=tolerance)


@pytest.mark.parametrize(
    ('axis', 'bounds'), [(0, (-0.7, 0.7)), (1, (0.0, 0.4)), (2, (-0.6, 0.6))]
)
def test_sweep_across_the_workspace_limit_is_smooth(axis, bounds):
    limit = WorkspaceLimit(GEOMETRY, MIN_CONDITIONING)
    places = []
    for value in np.linspace(*bounds, 4001):
        wanted = [0.0, 0.25, 0.0]
        wanted[axis] = value
        places.append(limit.saturate(Pose(*wanted), slope=0.0).pose[axis])
    slopes = np.diff(places) / ((bounds[1] - bounds[0]) / 4000)
    assert slopes.min() >= -1e-9
    assert slopes.max() <= 1.0 + 1e-9
    assert abs(np.diff(slopes)).max() < 0.03


@pytest.mark.parametrize('margin', [0.004, 0.03])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_pose_far_outside_is_saturated_at_the_margin(monkeypatch, margin, sign):
    monkeypatch.setattr(WorkspaceLimit, 'WORKSPACE_MARGIN', margin)
    limit = WorkspaceLimit(GEOMETRY, MIN_CONDITIONING)
    aside = limit.saturate(Pose(sign, 0.25, 0.0), slope=0.0).pose
    left, right, _ = Mechanism(GEOMETRY).inverse_kinematics(aside)
    lower, upper = GEOMETRY.stroke
    assert min(left - lower, upper - right) == pytest.approx(margin)
    at_full_reach = limit.saturate(Pose(0.0, 1.0, 0.0), slope=0.0).pose
    reach = GEOMETRY.link_length - margin
    assert at_full_reach.y == pytest.approx(reach)
    turned = limit.saturate(Pose(0.0, 0.3, sign), slope=0.0).pose
    rise = GEOMETRY.platform_half_length * math.sin(abs(turned.theta))
    assert abs(turned.y) + rise == pytest.approx(reach)
