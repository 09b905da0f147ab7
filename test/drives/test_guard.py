from dataclasses import replace
import math
from unittest.mock import Mock

from hypothesis import assume, given
from hypothesis import strategies as st
from mechanism import VARIANTS
import numpy as np
import pytest

from facade_manipulator.drives.guard import Guard, MechanismCheck
from facade_manipulator.drives.stopping_distances import Separation
from facade_manipulator.errors import LimitError, ParameterError
from facade_manipulator.kinematics import Geometry, Mechanism, Pose

GEOMETRY = Geometry()
MADE = Geometry(
    carriage_offsets=(0.004, 0.0, 0.0), rail_angle=0.01, link_errors=(1e-3, 0.0)
)
NEAR = (-0.1, 0.1, -0.09)
SEPARATION = Separation(0.0, 6.0, 0.04, 0.015, 0.02, 0.015, 0.02)


def guard_of(geometry, limit_margin=0.0):
    return Guard(geometry, SEPARATION, limit_margin)


exact = MechanismCheck(GEOMETRY).exact
measured = guard_of(GEOMETRY).check_measured
# carriages touch at 12 mm, so that a quarter of 8 mm is tolerated
LONG = replace(GEOMETRY, carriage_length=0.012)
measured_long = guard_of(LONG).check_measured


def rejection(check, *arguments):
    """Return the message of a rejection, '' if the check passes."""
    try:
        check(*arguments)
    except (ParameterError, LimitError) as error:
        return str(error)
    return ''


@pytest.mark.parametrize('geometry', [GEOMETRY, MADE], ids=['drawn', 'made'])
@given(x=st.floats(-0.5, 0.5), y=st.floats(0.01, 0.36), theta=st.floats(-0.5, 0.5))
def test_every_certified_pose_passes_the_guard(geometry, x, y, theta):
    try:
        carriages = Mechanism(geometry).certify(Pose(x, y, theta))
    except LimitError:
        assume(False)
    MechanismCheck(geometry).exact(tuple(carriages))


@pytest.mark.parametrize(
    ('check', 'positions', 'message'),
    [
        (exact, (-0.51, -0.1, -0.3), 'q1 = -0.51 m is below'),
        (exact, (0.31, 0.51, 0.4), 'q2 = 0.51 m is above'),
        (exact, (-0.1, 0.3, -0.085), 'q3 - q1 = 0.015 m is below'),
        (exact, (-0.4, 0.4, 0.0), ' is '),
        (exact, (0.1, -0.1, 0.0), ' is '),
        (exact, (-0.1, math.nan, 0.0), 'nan'),
        (exact, (-0.1, 0.1, math.inf), 'inf'),
        (measured, (-0.1, 0.1, 0.0), ''),
        # Measured positions may lag by 5 mm of the gap of 20 mm and by the margin of the drives.
        (measured, (-0.1, 0.1, -0.084), ''),
        (measured, (-0.1, 0.1, -0.086), 'q3 - q1 = 0.014 m'),
        (measured_long, (-0.1, 0.1, -0.0815), ''),
        (measured_long, (-0.1, 0.1, -0.0825), 'q3 - q1 = 0.0175 m'),
        (measured, (0.3, 0.504, 0.4), ''),
        (measured, (0.3, 0.506, 0.4), 'q2 = 0.506 m'),
        (guard_of(GEOMETRY, limit_margin=0.002).check_measured, (0.3, 0.506, 0.4), ''),
        (measured, (-0.347, 0.347, 0.0), ''),
        (measured, (-0.36, 0.36, 0.0), ' is '),
    ],
)
def test_impossible_positions_are_rejected_with_their_limit(check, positions, message):
    found = rejection(check, positions)
    assert message in found if message else not found


@given(st.lists(st.tuples(*[st.floats(-0.6, 0.6)] * 3), max_size=5))
def test_path_is_rejected_at_its_first_impossible_position(path):
    rejections = [rejection(exact, positions) for positions in path]
    assert rejection(exact, *path) == next(filter(None, rejections), '')


@pytest.mark.parametrize(
    'geometry',
    [
        GEOMETRY,
        MADE,
        *VARIANTS,
    ],
)
@pytest.mark.parametrize('tolerances', [(1e-6, 0.0), (0.005, 0.002)])
def test_fast_check_decides_as_the_exact_check(geometry, tolerances):
    check = MechanismCheck(geometry, *tolerances)
    distances = np.random.default_rng(0).uniform(-0.02, 0.65, (20_000, 2))
    for number, (left, right) in enumerate(distances.tolist()):
        q3 = 0.4 * math.sin(number)
        positions = (q3 - left, q3 + right, q3)
        assert rejection(check, positions) == rejection(check.exact, positions)


@pytest.mark.parametrize('geometry', [GEOMETRY, MADE], ids=['drawn', 'made'])
def test_positions_far_from_limits_need_no_exact_check(geometry):
    check = MechanismCheck(geometry)
    check.exact = Mock()
    check((-0.15, 0.15, 0.0))
    check.exact.assert_not_called()


@pytest.mark.parametrize(
    ('geometry', 'positions', 'homed', 'message'),
    [
        (GEOMETRY, NEAR, (False, False, False), ''),
        (GEOMETRY, NEAR, (True, True, False), ''),
        (GEOMETRY, NEAR, (False, True, True), ''),
        (GEOMETRY, NEAR, (True, False, False), ''),
        (
            GEOMETRY,
            NEAR,
            (True, False, True),
            'q3 - q1 = 0.01 m is below the limit 0.02 m (geometry.carriage_gap)',
        ),
        (GEOMETRY, (-0.1, 0.1, 0.0), (True, True, True), ''),
        (GEOMETRY, (-0.4, 0.4, 0.0), (True, True, True), ' is '),
        # 22 mm apart by the drive positions, 18 mm on the rail
        (GEOMETRY, (-0.022, 0.1, 0.0), (True, False, True), ''),
        (MADE, (-0.022, 0.1, 0.0), (True, False, True), 'q3 - q1 = 0.018 m'),
        (MADE, (-0.022, 0.1, 0.0), (True, True, True), 'q3 - q1 = 0.018 m'),
    ],
)
def test_homing_check_covers_neighbours_then_the_mechanism(
    geometry, positions, homed, message
):
    found = rejection(guard_of(geometry).check_homing, positions, homed)
    assert message in found if message else not found
