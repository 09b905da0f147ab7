import math

from hypothesis import given
from hypothesis import strategies as st
from mechanism import DESIGN, NO_GAP, VARIANTS
import numpy as np
import pytest

from facade_manipulator.errors import LimitError, ParameterError
from facade_manipulator.kinematics import (
    Carriages,
    forward_kinematics,
    forward_kinematics_batch,
    inverse_kinematics,
    inverse_kinematics_batch,
    Pose,
)

geometries = st.sampled_from((DESIGN, *VARIANTS))
seeds = st.integers(0, 2 ** 31)


def answers(solve, kind, geometry, rows):
    """What the scalar path says of every row; NaN where it rejects."""
    results = []
    for row in rows.tolist():
        try:
            results.append(solve(geometry, kind(*row)))
        except (LimitError, ParameterError):
            results.append((math.nan,) * 3)
    return np.array(results)


@given(geometries, seeds)
def test_inverse_kinematics_of_a_batch_are_those_of_every_pose(geometry, seed):
    poses = np.random.default_rng(seed).uniform([-1, -0.5, -4], [1, 0.5, 4], (60, 3))
    carriages, valid = inverse_kinematics_batch(geometry, poses)
    expected = answers(inverse_kinematics, Pose, geometry, poses)
    assert np.array_equal(valid, ~np.isnan(expected[:, 0]))
    assert np.allclose(carriages, expected, rtol=0.0, atol=1e-12, equal_nan=True)


@given(geometries, seeds)
def test_forward_kinematics_of_a_batch_are_those_of_every_row_in_any_order(geometry, seed):
    carriages = np.random.default_rng(seed).uniform(-0.4, 0.4, (40, 3))
    poses, valid = forward_kinematics_batch(geometry, carriages)
    expected = answers(forward_kinematics, Carriages, geometry, carriages)
    assert np.array_equal(valid, ~np.isnan(expected[:, 0]))
    assert np.allclose(poses, expected, rtol=0.0, atol=1e-9, equal_nan=True)


def test_a_hundred_thousand_poses_come_back_to_a_billionth_of_a_millimetre():
    random = np.random.default_rng(4)
    y = random.uniform(0.053, 0.3519, 100_000)
    sine = np.minimum((y ** 2 - 0.0028) / (2 * y * 0.348), (0.352 - y) / 0.348)
    theta = np.arcsin(sine * random.uniform(-0.999, 0.999, y.size))
    poses = np.stack([random.uniform(-0.2, 0.2, y.size), y, theta], axis=1)
    poses[::1000, 2] *= 1e-9
    carriages, reachable = inverse_kinematics_batch(NO_GAP, poses)
    found, closed = forward_kinematics_batch(NO_GAP, carriages)
    assert reachable.all() and closed.all()
    assert np.abs(found - poses)[:, :2].max() <= 1e-12
    assert np.abs(found - poses)[:, 2].max() <= 1e-12


def test_rows_that_are_not_finite_or_out_of_reach_are_not_valid_and_nan():
    poses = np.array([[0, 0.25, 0], [math.nan, 0.25, 0], [0, math.inf, 0], [0, 0.25, math.nan],
                      [-math.inf, 0.25, 0], [0, 0.25, math.inf], [0, 0.352, 0], [0, 0.2, 0.1]])
    carriages, valid = inverse_kinematics_batch(DESIGN, poses)
    assert valid.tolist() == [True, False, False, False, False, False, False, True]
    assert np.array_equal(np.isnan(carriages).all(axis=1), ~valid)
    assert np.array_equal(np.isnan(carriages).any(axis=1), ~valid)


def test_carriages_that_are_not_finite_or_cannot_be_joined_are_not_valid_and_nan():
    rows = np.array([[-0.1, 0.1, 0.0], [math.nan, 0.1, 0], [-0.1, math.inf, 0],
                     [-0.1, 0.1, -math.inf], [-1.0, 1.0, 0.0]])
    poses, valid = forward_kinematics_batch(DESIGN, rows)
    assert valid.tolist() == [True, False, False, False, False]
    assert np.array_equal(np.isnan(poses).all(axis=1), ~valid)


def test_the_input_is_left_alone_and_may_be_lists_or_views():
    poses = [[0.0, 0.25, 0.1], [0.1, 0.2, -0.1]]
    array = np.array(poses)
    view = np.repeat(array, 2, axis=0)[::2]
    for given_poses in (poses, array, view, np.asfortranarray(array)):
        carriages, valid = inverse_kinematics_batch(DESIGN, given_poses)
        found, _ = forward_kinematics_batch(DESIGN, carriages)
        assert valid.all() and np.allclose(found, poses, rtol=0.0, atol=1e-12)
    assert array.tolist() == poses


@pytest.mark.parametrize('count', [0, 1, 4095, 4096, 4097, 9000])
def test_blocks_leave_no_row_out(count):
    poses = np.tile([0.01, 0.25, 0.05], (count, 1))
    carriages, valid = inverse_kinematics_batch(DESIGN, poses)
    found, closed = forward_kinematics_batch(DESIGN, carriages)
    assert valid.shape == closed.shape == (count,)
    assert valid.all() and closed.all() and np.allclose(found, poses, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize('shape', [(3,), (4, 2), (2, 3, 1), ()])
def test_a_batch_of_another_shape_is_a_value_error_with_the_shape(shape):
    for solve in (inverse_kinematics_batch, forward_kinematics_batch):
        with pytest.raises(ValueError, match=r'not \(n, 3\)'):
            solve(DESIGN, np.zeros(shape))
