import math

from hypothesis import assume, example, given
from hypothesis import strategies as st
from mechanism import certify, DESIGN, NO_GAP
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


@given(st.floats(-0.6, 0.6), st.floats(-0.36, 0.36), st.floats(-math.pi, math.pi),
       st.sampled_from([DESIGN, SHORT]))
def test_certified_pose_respects_every_limit(x, y, theta, geometry):
    pose = Pose(x, y, theta)
    try:
        q1, q2, q3 = certify(geometry, pose)
    except LimitError as error:
        assert error.quantity and math.isfinite(error.value) and math.isfinite(error.bound)
        return
    assert geometry.stroke[0] <= q1 and q2 <= geometry.stroke[1]
    assert min(q3 - q1, q2 - q3) >= geometry.carriage_gap
    assert y > 0.0 and parallel_singularity(geometry, pose) > 0.0
    assert local_conditioning_index(geometry, pose) >= MIN_CONDITIONING


def rejected(kind, pose, geometry=DESIGN, **settings):
    with pytest.raises(kind) as error:
        certify(geometry, pose, **settings)
    return error.value


def passes(check, *arguments):
    try:
        check(*arguments)
    except LimitError:
        return False
    return True


@given(st.floats(-0.5, 0.5), st.floats(-0.75, 0.0), st.floats(0.0, 0.75),
       st.sampled_from([DESIGN, NO_GAP, SHORT]))
@example(0.0, -0.18, 0.423, SHORT)  # N of hardly more than 0
@example(0.0, -0.419, 0.18, SHORT)
def test_carriages_pass_where_their_pose_passes(q3, left, right, geometry):
    carriages = Carriages(q3 + left, q3 + right, q3)
    assume(min(abs(distance - geometry.carriage_gap) for distance in (-left, right)) > HAIR)

    def by_the_pose():
        certify(geometry, forward_kinematics(geometry, carriages), 0.0)

    assert passes(Mechanism(geometry).check, carriages) == passes(by_the_pose)


def test_reach_is_certified_up_to_its_border():
    certify(DESIGN, Pose(0.0, 0.352 - HAIR, 0.0), min_conditioning=0.0)
    error = rejected(UnreachableError, Pose(0.0, 0.352, 0.0), min_conditioning=0.0)
    assert (error.value, error.bound, error.unit) == (0.352, 0.352, 'm')
    assert str(error) == '|y| + b |sin theta| = 0.352 m is not below the bound 0.352 m'


@pytest.mark.parametrize(('side', 'quantity'), [(-1.0, 'q1'), (1.0, 'q2')])
def test_stroke_is_certified_up_to_its_border(side, quantity):
    pose = Pose(0.0, 0.25, 0.0)
    room = 0.5 - abs(inverse_kinematics(DESIGN, pose).q1)
    certify(DESIGN, pose._replace(x=side * (room - HAIR)))
    error = rejected(StrokeLimitError, pose._replace(x=side * (room + HAIR)))
    assert (error.quantity, error.bound, error.unit) == (quantity, side * 0.5, 'm')
    assert error.value == pytest.approx(side * 0.5, abs=2 * HAIR)


def test_carriage_gap_is_certified_up_to_its_border():
    y_min = math.sqrt(0.352 ** 2 - (0.348 - 0.02) ** 2)
    certify(DESIGN, Pose(0.0, y_min + HAIR, 0.0))
    error = rejected(CarriageGapError, Pose(0.0, y_min - HAIR, 0.0))
    assert (error.quantity, error.bound, error.unit) == ('q3 - q1', 0.02, 'm')


def test_stroke_is_certified_before_the_gap():
    y_below_gap = math.sqrt(0.352 ** 2 - (0.348 - 0.02) ** 2) - 0.01
    error = rejected(StrokeLimitError, Pose(0.6, y_below_gap, 0.0))
    assert error.quantity == 'q2'


def test_carriages_without_gap_keep_their_order():
    y_min = math.sqrt(0.352 ** 2 - 0.348 ** 2)
    certify(NO_GAP, Pose(0.0, y_min + HAIR, 0.0))
    assert 'not above' in str(rejected(CarriageGapError, Pose(0.0, y_min - HAIR, 0.0), NO_GAP))


def test_pose_behind_the_rail_is_rejected():
    error = rejected(SingularityError, Pose(0.0, -0.25, 0.0))
    assert (error.quantity, error.value, error.bound, error.unit) == ('y', -0.25, 0.0, 'm')
    assert 'behind the rail, on the mirrored assembly branch' in str(error)


def test_pose_beyond_the_parallel_singularity_is_rejected():
    geometry = Geometry(0.15, 0.55, carriage_gap=0.0)
    error = rejected(SingularityError, Pose(0.0, 0.02, 0.1), geometry)
    assert error.quantity == 'N' and error.value < 0.0 and error.unit == 'm2'
    assert parallel_singularity(geometry, Pose(0.0, 0.10, 0.05)) > 0.0


def test_weak_conditioning_is_rejected_with_index_and_bound():
    pose = Pose(0.0, 0.3519, 0.0)
    index = local_conditioning_index(DESIGN, pose)
    error = rejected(SingularityError, pose)
    assert (error.value, error.bound, error.unit) == (pytest.approx(index), 0.05, '')
    certify(DESIGN, pose, min_conditioning=index - HAIR)
    certify(DESIGN, pose, min_conditioning=0.0)


@pytest.mark.parametrize('scale', [0.1, 1.0, 3.0])
def test_scaled_mechanism_is_conditioned_like_the_design(scale):
    geometry = Geometry(*(scale * length for length in (0.352, 0.348)),
                        tuple(scale * end for end in (-0.5, 0.5)), 0.02 * scale)
    for y, theta in ((0.13, 0.0), (0.25, 0.1), (0.3519, 0.0)):
        pose = Pose(0.0, scale * y, theta)
        answers = []
        for at, machine in ((Pose(0.0, y, theta), DESIGN), (pose, geometry)):
            try:
                answers.append(certify(machine, at) and 'certified')
            except SingularityError as error:
                answers.append(round(error.value, 9))
        assert answers[0] == answers[1]
