from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from facade_manipulator.errors import InputError, LimitError
from facade_manipulator.kinematics import Geometry, MIN_CONDITIONING, Pose
from facade_manipulator.motion import setpoints
from facade_manipulator.motion.setpoints import Setpoint, SetpointStream, STREAM_GAP

HOME = Pose(0.0, 0.25, 0.0)
LIFTED = Pose(0.1, 0.26, 0.1)
triples = st.tuples(*[st.floats(-1.0, 1.0)] * 3)
intervals = st.floats(0.01, 0.5)


@pytest.fixture(name='stream')
def fixture_stream():
    return SetpointStream(Geometry(), MIN_CONDITIONING)


def along(time: float) -> Pose:
    """Return the pose of a smooth path of the head at a time [s]."""
    y = 0.25 + 0.02 * np.cos(3.0 * time)
    return Pose(0.1 * np.sin(2.0 * time), y, 0.1 * np.sin(time))


@given(triples, triples, intervals)
def test_extrapolation_continues_with_a_confirmed_velocity(position, velocity, ahead):
    last = Setpoint(7.0, position, velocity)
    reached, speed = setpoints.extrapolate([last, last], 7.0 + ahead)
    expected = np.array(position) + ahead * np.array(velocity)
    assert reached == pytest.approx(expected)
    assert speed == velocity
    assert setpoints.extrapolate([last], 7.0 + ahead) == (position, (0.0, 0.0, 0.0))


@given(st.tuples(triples, triples, triples, triples), intervals, st.floats(0.0, 1.0))
def test_interpolation_is_the_cubic_through_two_setpoints(ends, interval, share):
    (p, v, q, w) = map(np.array, ends)
    end = 3.0 + interval
    spline = CubicHermiteSpline([3.0, end], [p, q], [v, w])
    time = 3.0 + share * interval
    first = (3.0, Setpoint(3.0, p, v))
    second = (end, Setpoint(end, q, w))
    found = setpoints.interpolate(first, second, time)
    expected = [spline(time), spline(time, 1)]
    np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize('begin', np.linspace(0.0, 6.0, 31))
def test_setpoint_velocity_equals_the_carriage_velocity(stream, begin):
    end = begin + 1e-4
    before = stream.setpoint(begin, along(begin))
    after = stream.setpoint(end, along(end))
    moved = np.subtract(after.position, before.position)
    np.testing.assert_allclose(after.velocity, moved / 1e-4, atol=1e-3)


@pytest.mark.parametrize('pause', [-0.01, 0.0, STREAM_GAP + 0.001])
def test_first_pose_of_a_stream_has_zero_velocity(stream, pause):
    for time, pose in ((1.0 - pause, along(0.0)), (1.0, along(0.3))):
        assert stream.setpoint(time, pose).velocity == (0.0, 0.0, 0.0)


def test_rejected_pose_leaves_the_stream_unchanged(stream):
    stream.setpoint(0.0, along(0.0))
    with pytest.raises(LimitError):
        stream.setpoint(0.05, Pose(0.0, 0.6, 0.0))
    assert any(stream.setpoint(0.1, along(0.1)).velocity)


@pytest.mark.parametrize(
    'goal', [LIFTED, Pose(-0.1, 0.26, 0.0), Pose(0.0, 0.25, 0.1), HOME]
)
@pytest.mark.parametrize('spacing', [0.002, 0.05])
def test_path_includes_both_ends_and_keeps_the_spacing(stream, spacing, goal):
    path = stream.path(HOME, goal, spacing)
    mechanism = stream.mechanism
    assert path[0] == pytest.approx(tuple(mechanism.certify(HOME, 0.0)))
    assert path[-1] == pytest.approx(tuple(mechanism.certify(goal, 0.0)))
    heads = np.array([mechanism.forward_kinematics(point) for point in path])
    steps = np.diff(heads[:, :2], axis=0)
    assert np.hypot(*steps.T).max() <= spacing + 1e-9


@pytest.mark.parametrize('spacing', [-0.001, float('nan'), float('inf'), 1e-9, 5e-324])
def test_impossible_path_spacing_is_rejected(stream, spacing):
    with pytest.raises(InputError, match='tolerance|steps'):
        stream.path(HOME, LIFTED, spacing)
