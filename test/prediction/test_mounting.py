import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import compose, Pose, ZERO_POSE
from facade_manipulator.prediction.estimate import EstimateGate, EstimateSettings, LARGEST_TILT
from facade_manipulator.prediction.mounting import estimator_motion, rail_pose

poses = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-0.5, 0.5)).map(
    lambda values: Pose(*values))
MOUNTING = (0.5, 0.3, 0.01)


@given(poses, poses, st.floats(-math.pi, math.pi))
def test_the_rail_is_where_it_was_before_the_estimator_was_mounted(rail, mounting, axes):
    published = estimator_motion(rail, mounting, axes)
    assert rail_pose(published, mounting, axes) == pytest.approx(rail, abs=1e-14)


def test_axes_turned_by_a_quarter_swap_x_and_y_and_their_variances():
    settings = EstimateSettings(axes=math.pi / 2.0)
    assert estimator_motion(Pose(0.1, 0.02, 0.03), ZERO_POSE, settings.axes) == pytest.approx(
        (0.02, -0.1, 0.03))
    estimate = EstimateGate(settings).check(10.0, 9.97, Pose(0.02, -0.1, 0.03), (1e-6, 4e-6, 1e-6))
    assert estimate.pose == pytest.approx((0.1, 0.02, 0.03))
    assert estimate.variances == pytest.approx((4e-6, 1e-6, 1e-6))


def test_a_rail_at_rest_is_published_at_rest_wherever_the_estimator_is():
    assert estimator_motion(ZERO_POSE, Pose(*MOUNTING)) == (0.0, 0.0, 0.01)


def test_a_turn_of_the_rail_swings_the_estimator_on_its_lever_arm():
    moved = estimator_motion(Pose(0.0, 0.0, 0.02), Pose(0.5, 0.3, 0.0))
    assert moved == pytest.approx((-0.3 * 0.02, 0.5 * 0.02, 0.02), abs=2e-4)


def test_the_gate_returns_the_rail_at_the_time_of_the_motion():
    gate = EstimateGate(EstimateSettings(mounting=MOUNTING, delay=0.02))
    rail = Pose(0.1, 0.0, 0.02)
    estimate = gate.check(10.0, 9.97, estimator_motion(rail, Pose(*MOUNTING)), (1e-6, 1e-6, 1e-6))
    assert estimate.stamp == pytest.approx(9.95)
    assert estimate.pose == pytest.approx(rail)
    assert estimate.variances == pytest.approx((1.09e-6, 1.25e-6, 1e-6))


@given(poses, poses, st.floats(-math.pi, math.pi))
def test_where_the_estimator_is_says_the_same_as_how_far_it_has_moved(rail, mounting, axes):
    gate = EstimateGate(EstimateSettings(mounting=tuple(mounting), axes=axes))
    place = compose(rail, mounting)
    seen = compose(Pose(0.0, 0.0, -axes), place)._replace(theta=place.theta)
    assert gate.displacement(seen) == pytest.approx(
        estimator_motion(rail, mounting, axes), abs=1e-12)


def test_tilt_is_accepted_up_to_its_bound():
    gate = EstimateGate(EstimateSettings())
    assert gate.check(10.0, 9.97, ZERO_POSE, tilt=LARGEST_TILT).pose == ZERO_POSE
    with pytest.raises(InputError, match='0.051 rad .* bound 0.05 rad') as rejection:
        gate.check(10.02, 9.99, ZERO_POSE, tilt=0.051)
    assert rejection.value.reason == 'out_of_plane'


def test_stamps_ahead_of_the_clock_are_accepted_when_their_lead_is_known():
    ahead = 10.05
    with pytest.raises(InputError):
        EstimateGate(EstimateSettings()).check(10.0, ahead, ZERO_POSE)
    EstimateGate(EstimateSettings(delay=0.1)).check(10.0, ahead, ZERO_POSE)
