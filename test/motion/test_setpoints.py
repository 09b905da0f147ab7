from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.errors import InputError, LimitError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.motion.setpoints import (
    extrapolate,
    GoalSettings,
    interpolate,
    Setpoint,
    SetpointStream,
    STREAM_GAP,
)

GEOMETRY, GOALS = Geometry(), GoalSettings()
triples = st.tuples(*[st.floats(-1.0, 1.0)] * 3)
moments = st.floats(0.01, 0.5)


def along(time: float) -> Pose:
    """A smooth way of the head."""
    return Pose(0.1 * np.sin(2.0 * time), 0.25 + 0.02 * np.cos(3.0 * time), 0.1 * np.sin(time))


@given(triples, triples, moments)
def test_extrapolation_keeps_the_velocity(position, velocity, ahead):
    there, speed = extrapolate(Setpoint(7.0, position, velocity), 7.0 + ahead)
    assert speed == velocity
    np.testing.assert_allclose(np.subtract(there, position), ahead * np.array(velocity), atol=1e-9)


@given(st.tuples(triples, triples, triples, triples), moments, st.floats(0.0, 1.0))
def test_interpolation_is_the_cubic_through_two_setpoints(ends, interval, share):
    p, v, q, w = map(np.array, ends)
    a, b = Setpoint(3.0, ends[0], ends[1]), Setpoint(3.0 + interval, ends[2], ends[3])
    for end, position, velocity in ((a, p, v), (b, q, w)):
        at = interpolate(a, b, end.time)
        np.testing.assert_allclose(at[0], position, atol=1e-9)
        np.testing.assert_allclose(at[1], velocity, atol=1e-9)
    time, step = a.time + interval * (0.01 + 0.98 * share), 1e-3 * interval
    before, after = (np.array(interpolate(a, b, time + s)[0]) for s in (-step, step))
    bend = np.abs(np.concatenate((q - p, interval * v, interval * w))).max()
    np.testing.assert_allclose(  # the cubic's third derivative bounds the difference
        interpolate(a, b, time)[1], (after - before) / (2.0 * step), atol=1e-4 * bend / interval)


@given(st.floats(0.0, 6.0))
def test_setpoint_velocity_is_that_of_the_carriages(begin):
    stream, step = SetpointStream(GEOMETRY, GOALS), 1e-4
    stream.setpoint(begin, along(begin))
    setpoint = stream.setpoint(begin + step, along(begin + step))
    moved = np.subtract(*(stream.mechanism.inverse_kinematics(along(begin + ahead))
                          for ahead in (step, 0.0)))
    np.testing.assert_allclose(setpoint.velocity, moved / step, atol=1e-3)


@pytest.mark.parametrize('pause', [None, -0.01, 0.0, STREAM_GAP + 0.001])
def test_first_pose_of_a_stream_is_passed_at_rest(pause):
    stream = SetpointStream(GEOMETRY, GOALS)
    if pause is not None:
        stream.setpoint(1.0 - pause, along(0.0))
    assert stream.setpoint(1.0, along(0.3)).velocity == (0.0, 0.0, 0.0)


def test_rejected_pose_leaves_the_stream_unchanged():
    stream = SetpointStream(GEOMETRY, GOALS)
    stream.setpoint(0.0, along(0.0))
    with pytest.raises(LimitError):
        stream.setpoint(0.05, Pose(0.0, 0.6, 0.0))
    assert any(stream.setpoint(0.1, along(0.1)).velocity)


@given(st.floats(0.002, 0.05), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))
def test_path_has_its_ends_and_spacing(spacing, x, theta):
    start, goal = Pose(0.0, 0.25, 0.0), Pose(x, 0.26, theta)
    stream = SetpointStream(GEOMETRY, GOALS)
    path, mechanism = stream.path(start, goal, spacing), stream.mechanism
    assert path[0] == mechanism.certify(start, 0.0) and path[-1] == mechanism.certify(goal, 0.0)
    heads = np.array([mechanism.forward_kinematics(point) for point in path])
    assert np.hypot(*np.diff(heads[:, :2], axis=0).T).max() <= spacing + 1e-9


@pytest.mark.parametrize('spacing', [-0.001, float('nan'), float('inf'), 1e-9])
def test_impossible_spacing_is_rejected(spacing):
    with pytest.raises(InputError, match='tolerance|bound'):
        SetpointStream(GEOMETRY, GOALS).path(
            Pose(0.0, 0.25, 0.0), Pose(0.1, 0.25, 0.0), spacing)
