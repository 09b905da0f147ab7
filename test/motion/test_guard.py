import math

from hypothesis import assume, given
from hypothesis import strategies as st
import pytest

from facade_manipulator.errors import (
    CarriageGapError,
    LimitError,
    ParameterError,
    StrokeLimitError,
)
from facade_manipulator.kinematics import Geometry, Mechanism, Pose
from facade_manipulator.motion.guard import homing_guard, measured_guard, mechanism_guard

GEOMETRY = Geometry()
MADE = Geometry(carriage_offsets=(0.004, 0.0, 0.0), rail_angle=0.01, link_errors=(1e-3, 0.0))
guard = mechanism_guard(GEOMETRY)


@pytest.mark.parametrize('geometry', [GEOMETRY, MADE], ids=['drawn', 'made'])
@given(x=st.floats(-0.5, 0.5), y=st.floats(0.01, 0.36), theta=st.floats(-0.5, 0.5))
def test_every_certified_pose_passes_the_guard(geometry, x, y, theta):
    try:
        carriages = Mechanism(geometry).certify(Pose(x, y, theta))
    except LimitError:
        assume(False)
    mechanism_guard(geometry)(tuple(carriages))


@pytest.mark.parametrize('positions, error, quantity', [
    ((-0.51, -0.1, -0.3), StrokeLimitError, 'q1'),
    ((0.31, 0.51, 0.4), StrokeLimitError, 'q2'),
    ((-0.1, 0.3, -0.085), CarriageGapError, 'q3 - q1'),
    ((-0.4, 0.4, 0.0), LimitError, ''),
    ((0.1, -0.1, 0.0), LimitError, ''),
])
def test_impossible_positions_are_rejected_by_their_limit(
        positions, error, quantity):
    with pytest.raises(error) as rejection:
        guard(positions)
    assert quantity in rejection.value.quantity
    assert isinstance(rejection.value, LimitError)


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize('axis', range(3))
def test_position_that_is_not_finite_is_rejected(bad, axis):
    positions = [-0.1, 0.1, 0.0]
    positions[axis] = bad
    with pytest.raises((ParameterError, LimitError)):
        guard(tuple(positions))


@given(st.lists(st.tuples(*[st.floats(-0.6, 0.6)] * 3), max_size=5))
def test_path_is_rejected_for_its_first_impossible_position(path):
    rejections = []
    for positions in path:
        try:
            guard(positions)
        except LimitError as error:
            rejections.append(str(error))
    if not rejections:
        guard(*path)
        return
    with pytest.raises(LimitError) as rejection:
        guard(*path)
    assert str(rejection.value) == rejections[0]


NEAR = (-0.1, 0.1, -0.09)


@pytest.mark.parametrize('homed', [
    (False, False, False), (True, True, False), (False, True, True), (True, False, False)])
def test_homing_checks_homed_neighbours_only(homed):
    homing_guard(GEOMETRY)(NEAR, homed)


def test_homed_neighbours_too_close_are_rejected():
    with pytest.raises(CarriageGapError, match='q3 - q1 = 0.01 m is below the bound 0.02 m'):
        homing_guard(GEOMETRY)(NEAR, (True, False, True))


def test_homed_carriages_are_checked_as_a_mechanism():
    homing_guard(GEOMETRY)((-0.1, 0.1, 0.0), (True, True, True))
    with pytest.raises(LimitError):
        homing_guard(GEOMETRY)((-0.4, 0.4, 0.0), (True, True, True))


def test_guard_uses_the_calibrated_positions():
    near = (-0.022, 0.1, 0.0)  # 22 mm apart by the drives, 18 mm on the rail
    guard(near)
    homing_guard(GEOMETRY)(near, (True, False, True))
    for check in (mechanism_guard(MADE), lambda q: homing_guard(MADE)(q, (True, False, True))):
        with pytest.raises(CarriageGapError):
            check(near)


@pytest.mark.parametrize(('positions', 'passes'), [
    ((-0.1, 0.1, 0.0), True),
    ((-0.1, 0.1, -0.084), True), ((-0.1, 0.1, -0.086), False),  # 5 mm of the gap of 20 mm
    ((0.3, 0.504, 0.4), True), ((0.3, 0.506, 0.4), False),  # what the drives allow themselves
    ((-0.347, 0.347, 0.0), True), ((-0.36, 0.36, 0.0), False),  # no links so far apart
])
def test_measured_positions_may_lag_within_the_tolerance(positions, passes):
    measured = measured_guard(GEOMETRY, margin=0.0)
    if passes:
        measured(positions)
        return
    with pytest.raises(LimitError):
        measured(positions)
