import math

from hypothesis import assume, example, given
from hypothesis import strategies as st
from mechanism import (
    certify,
    DESIGN,
    HOME,
    NO_GAP,
    passes,
    regular_poses,
    workspace_poses,
)
import numpy as np
import pytest

from facade_manipulator.errors import LimitError, SingularityError, UnreachableError
from facade_manipulator.kinematics import (
    assembly_modes,
    Carriages,
    forward_kinematics,
    Geometry,
    inverse_kinematics,
    joints,
    Pose,
    working_modes,
)
from facade_manipulator.kinematics.closure import require_branch


def link_errors(geometry, pose, carriages):
    """Return the length errors of both links and the distance of q3 from x [m]."""
    rise = geometry.platform_half_length * math.sin(pose.theta)
    span = geometry.platform_half_length * math.cos(pose.theta)
    link_1 = math.hypot(carriages.q1 - pose.x + span, pose.y - rise)
    link_2 = math.hypot(carriages.q2 - pose.x - span, pose.y + rise)
    error_1 = abs(link_1 - geometry.link_length)
    error_2 = abs(link_2 - geometry.link_length)
    return max(error_1, error_2, abs(carriages.q3 - pose.x))


@given(regular_poses())
def test_forward_undoes_inverse_kinematics_for_other_geometries(drawn):
    geometry, pose = drawn
    found = forward_kinematics(geometry, inverse_kinematics(geometry, pose))
    assert found == pytest.approx(pose, rel=0.0, abs=1e-12)  # 1e-9 mm


@pytest.mark.parametrize(
    'theta', [0.0, -0.0, 1e-300, 1e-16, 1e-12, -1e-9, 1e-9, 1e-7, -1e-5]
)
@pytest.mark.parametrize('y', [0.053, 0.13, 0.25, 0.3519])
def test_forward_kinematics_near_zero_angle_keeps_all_digits(y, theta):
    pose = Pose(0.1, y, theta)
    found = forward_kinematics(NO_GAP, inverse_kinematics(NO_GAP, pose))
    assert found == pytest.approx(pose, rel=0.0, abs=1e-12)


@pytest.mark.parametrize(
    ('geometry', 'carriages', 'words'),
    [
        (NO_GAP, (0.05, -0.05, 0.0), 'q2 - q1 = -0.1 m is not above'),
        (DESIGN, (-1.0, 1.0, 0.0), 'y squared = -0.3012 m2 is not above'),
        (DESIGN, (-1.0, 1.0, 0.1), 'closure residual'),
        (Geometry(0.30, 0.40), (-0.1, 0.1, 0.0), 'y squared'),
    ],
    ids=['passed', 'too_far', 'too_far_aside', 'on_the_rail'],
)
def test_carriages_without_a_pose_are_rejected(geometry, carriages, words):
    with pytest.raises(UnreachableError, match=words):
        forward_kinematics(geometry, Carriages(*carriages))


@pytest.mark.parametrize('theta', [-0.1, 0.0, 0.2])
@pytest.mark.parametrize(('side', 'name'), [('q1', 'q1 - q3'), ('q2', 'q3 - q2')])
def test_carriages_of_another_working_mode_are_rejected(theta, side, name):
    pose = Pose(0.1, 0.2, theta)
    at = inverse_kinematics(DESIGN, pose)
    span = 0.348 * math.cos(theta)
    joint = pose.x + (-span if side == 'q1' else span)
    mirrored = 2.0 * joint - getattr(at, side)  # in the joint of the platform
    with pytest.raises(UnreachableError, match='another working mode') as error:
        forward_kinematics(DESIGN, at._replace(**{side: mirrored}))
    assert error.value.quantity == f'{name} + b cos(theta)'
    assert error.value.value == pytest.approx(-abs(mirrored - joint))
    assert error.value.bound == 0.0


@pytest.mark.parametrize(
    ('carriages', 'name'),
    [((-0.45, 0.5, 0.0), 'q3 - q2'), ((-0.5, 0.45, 0.0), 'q1 - q3')],
)
def test_links_of_another_working_mode_name_the_worse_side(carriages, name):
    q1, q2, q3 = carriages
    with pytest.raises(UnreachableError, match='another working mode') as error:
        forward_kinematics(DESIGN, Carriages(q1, q2, q3))
    assert error.value.quantity == f'{name} + b cos(theta)'
    # at most 0.348 m are added to the greater distance from A3
    assert -0.5 <= error.value.value <= -0.5 + 0.348


def test_platform_behind_the_rail_has_no_assembly_mode():
    with pytest.raises(UnreachableError) as error:
        require_branch((0.352, 0.352, 0.348, 0.348), -0.1, 0.1, -0.2, 0.0)
    assert error.value.quantity == 'assembly modes on the branch'
    assert error.value.value == 0
    assert error.value.bound == 1


def test_forward_pose_at_a_double_root_closes_the_links():
    geometry = Geometry(0.25, 0.45, carriage_gap=0.0)
    for q2 in [0.1 + k * 1e-3 for k in range(800)]:
        carriages = Carriages(-0.3, q2, 0.0)
        try:
            pose = forward_kinematics(geometry, carriages)
        except LimitError:
            continue
        assert link_errors(geometry, pose, carriages) < 1e-12


@pytest.mark.parametrize(
    ('pose', 'reach'),
    [
        (Pose(0.0, 0.352, 0.0), 0.352),
        (Pose(0.0, -0.36, 0.0), 0.36),
        (Pose(0.0, 0.3, 0.2), 0.3 + 0.348 * math.sin(0.2)),
    ],
)
def test_pose_beyond_the_links_is_unreachable(pose, reach):
    with pytest.raises(UnreachableError) as error:
        inverse_kinematics(DESIGN, pose)
    assert error.value.value == pytest.approx(reach)
    assert error.value.bound == 0.352
    assert error.value.unit == 'm'


@pytest.mark.filterwarnings('error')
@given(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 3))
@example((1.7e308, 1.7e308, -1.7e308))
@example((-0.7, -1.7e308, 0.0))
@example((0.0, 1.4e-313, 5e-324))
def test_extreme_inputs_give_finite_poses_or_rejections(values):
    carriages = Carriages(*values)
    try:
        assert all(map(math.isfinite, forward_kinematics(DESIGN, carriages)))
    except UnreachableError as error:
        assert math.isfinite(error.bound)
    except SingularityError:
        pass


@given(workspace_poses())
def test_joint_points_keep_link_lengths_and_head(pose):
    at = joints(DESIGN, pose)
    for carriage, end in ((at.a1, at.b1), (at.a2, at.b2)):
        assert math.dist(carriage, end) == pytest.approx(DESIGN.link_length)
    middle = np.mean([at.b1, at.b2], axis=0)
    assert middle == pytest.approx(at.p)


@given(regular_poses())
def test_working_modes_are_the_four_intersections(drawn):
    geometry, pose = drawn
    modes = working_modes(geometry, pose)
    assert len(modes) == 4
    assert modes[1] == pytest.approx(inverse_kinematics(geometry, pose), abs=1e-15)
    assert all(link_errors(geometry, pose, mode) < 1e-6 for mode in modes)
    assert modes[0].q1 > modes[3].q1
    assert modes[0].q2 > modes[3].q2


@given(regular_poses())
@example(
    (Geometry(link_length=0.15, platform_half_length=0.55), Pose(0.0, 0.0375, 0.0))
)
def test_assembly_modes_close_and_start_with_machine_branch(drawn):
    geometry, pose = drawn
    carriages = inverse_kinematics(geometry, pose)
    modes = assembly_modes(geometry, carriages)
    assert 2 <= len(modes) <= 4
    assert all(link_errors(geometry, mode, carriages) < 1e-6 for mode in modes)
    assume(passes(certify, geometry, pose, 0.0))
    assert modes[0] == pytest.approx(forward_kinematics(geometry, carriages), abs=1e-6)


def test_home_position_of_table_4_has_two_poses():
    pose = forward_kinematics(DESIGN, HOME)
    assert pose == (0.0, pytest.approx(0.24979992, abs=1e-8), 0.0)
    branch, mirror, *_ = assembly_modes(DESIGN, HOME)
    assert branch == pytest.approx(pose, abs=1e-8)
    assert mirror == pytest.approx((0.0, -branch.y, 0.0), abs=1e-12)
    assert assembly_modes(DESIGN, Carriages(-1.0, 1.0, 0.1)) == ()
