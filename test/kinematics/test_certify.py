import math

from hypothesis import assume, example, given
from hypothesis import strategies as st
from mechanism import certify, DESIGN, NO_GAP, passes
import pytest

from facade_manipulator.errors import (
    CarriageGapError,
    LimitError,
    SingularityError,
    StrokeLimitError,
    UnreachableError,
)
from facade_manipulator.kinematics import (
    Carriages,
    forward_kinematics,
    Geometry,
    inverse_kinematics,
    local_conditioning_index,
    Mechanism,
    MIN_CONDITIONING,
    parallel_singularity,
    Pose,
)

HAIR = 1e-9
SHORT = Geometry(0.25, 0.45, carriage_gap=0.0)


@given(
    st.floats(-0.6, 0.6),
    st.floats(-0.36, 0.36),
    st.floats(-math.pi, math.pi),
    st.sampled_from([DESIGN, SHORT]),
)
def test_certified_pose_respects_every_limit(x, y, theta, geometry):
    pose = Pose(x, y, theta)
    try:
        q1, q2, q3 = certify(geometry, pose)
    except LimitError as error:
        assert error.quantity
        assert math.isfinite(error.value)
        assert math.isfinite(error.bound)
        return
    assert geometry.stroke[0] <= q1
    assert q2 <= geometry.stroke[1]
    assert min(q3 - q1, q2 - q3) >= geometry.carriage_gap
    assert y > 0.0
    assert parallel_singularity(geometry, pose) > 0.0
    assert local_conditioning_index(geometry, pose) >= MIN_CONDITIONING


def rejected(kind, pose, geometry=DESIGN, **settings):
    with pytest.raises(kind) as error:
        certify(geometry, pose, **settings)
    return error.value


@given(
    st.floats(-0.5, 0.5),
    st.floats(-0.75, 0.0),
    st.floats(0.0, 0.75),
    st.sampled_from([DESIGN, NO_GAP, SHORT]),
)
@example(0.0, -0.18, 0.423, SHORT)  # N is barely positive here.
@example(0.0, -0.419, 0.18, SHORT)
def test_carriages_of_certified_poses_pass_the_check(q3, left, right, geometry):
    carriages = Carriages(q3 + left, q3 + right, q3)
    assume(
        min(abs(distance - geometry.carriage_gap) for distance in (-left, right)) > HAIR
    )

    def by_the_pose():
        certify(geometry, forward_kinematics(geometry, carriages), 0.0)

    assert passes(Mechanism(geometry).check, carriages) == passes(by_the_pose)


def height_at_gap(gap):
    """Return y of the level head whose carriages have a gap [m]."""
    return math.sqrt(0.352**2 - (0.348 - gap) ** 2)


Y_GAP = height_at_gap(0.02)
Y_ORDER = height_at_gap(0.0)
ROOM = 0.5 - abs(inverse_kinematics(DESIGN, Pose(0.0, 0.25, 0.0)).q1)


@pytest.mark.parametrize(
    ('geometry', 'border', 'outwards', 'kind', 'quantity', 'bound'),
    [
        (
            DESIGN,
            Pose(0.0, 0.352, 0.0),
            (0.0, 1.0),
            UnreachableError,
            '|y| + b |sin theta|',
            0.352,
        ),
        (DESIGN, Pose(-ROOM, 0.25, 0.0), (-1.0, 0.0), StrokeLimitError, 'q1', -0.5),
        (DESIGN, Pose(ROOM, 0.25, 0.0), (1.0, 0.0), StrokeLimitError, 'q2', 0.5),
        (DESIGN, Pose(0.0, Y_GAP, 0.0), (0.0, -1.0), CarriageGapError, 'q3 - q1', 0.02),
        (
            NO_GAP,
            Pose(0.0, Y_ORDER, 0.0),
            (0.0, -1.0),
            CarriageGapError,
            'q3 - q1',
            0.0,
        ),
    ],
    ids=['reach', 'left', 'right', 'gap', 'order'],
)
def test_each_limit_is_certified_up_to_its_bound(
    geometry, border, outwards, kind, quantity, bound
):
    x_step = HAIR * outwards[0]
    y_step = HAIR * outwards[1]
    inside = Pose(border.x - x_step, border.y - y_step, 0.0)
    outside = Pose(border.x + x_step, border.y + y_step, 0.0)
    certify(geometry, inside, min_conditioning=0.0)
    error = rejected(kind, outside, geometry, min_conditioning=0.0)
    assert error.quantity == quantity
    assert error.bound == bound
    assert error.unit == 'm'
    assert error.value == pytest.approx(bound, abs=1e-7)
    assert str(error).startswith(f'{quantity} = ')


def test_violated_stroke_is_reported_before_the_gap():
    assert rejected(StrokeLimitError, Pose(0.6, Y_GAP - 0.01, 0.0)).quantity == 'q2'


@pytest.mark.parametrize(
    ('geometry', 'pose', 'quantity', 'unit'),
    [
        (DESIGN, Pose(0.0, -0.25, 0.0), 'y', 'm'),
        (Geometry(0.15, 0.55, carriage_gap=0.0), Pose(0.0, 0.02, 0.1), 'N', 'm2'),
    ],
    ids=['behind_the_rail', 'beyond_the_singularity'],
)
def test_pose_on_another_assembly_branch_is_rejected(geometry, pose, quantity, unit):
    error = rejected(SingularityError, pose, geometry)
    assert error.quantity == quantity
    assert error.bound == 0.0
    assert error.unit == unit
    assert error.value < 0.0
    assert parallel_singularity(geometry, Pose(0.0, 0.10, 0.05)) > 0.0


def test_weak_conditioning_is_rejected_with_index_and_bound():
    pose = Pose(0.0, 0.3519, 0.0)
    index = local_conditioning_index(DESIGN, pose)
    error = rejected(SingularityError, pose)
    assert error.value == pytest.approx(index)
    assert error.bound == 0.05
    assert error.unit == ''
    certify(DESIGN, pose, min_conditioning=index - HAIR)
    certify(DESIGN, pose, min_conditioning=0.0)


def conditioning_index(geometry, pose):
    """Return the index from a rejection, because no index is above 1."""
    return rejected(SingularityError, pose, geometry, min_conditioning=2.0).value


@pytest.mark.parametrize('scale', [0.1, 1.0, 3.0])
def test_scaled_mechanism_has_the_conditioning_of_the_design(scale):
    stroke = (-0.5 * scale, 0.5 * scale)
    geometry = Geometry(0.352 * scale, 0.348 * scale, stroke, 0.02 * scale)
    for y, theta in ((0.13, 0.0), (0.25, 0.1), (0.3519, 0.0)):
        design = conditioning_index(DESIGN, Pose(0.0, y, theta))
        scaled = conditioning_index(geometry, Pose(0.0, scale * y, theta))
        assert scaled == pytest.approx(design, rel=1e-9)
