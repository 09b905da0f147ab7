"""The wall as the head feels it."""


from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.kinematics import Pose
from facade_manipulator.lab.gondola.facade import Facade, FacadeSettings, NO_CONTACT

STILL = Pose(0.0, 0.0, 0.0)
PLAIN = Facade(FacadeSettings(present=True, friction=0.0))
DISTANCE = PLAIN.settings.distance


@given(st.floats(-0.5, 0.5), st.floats(0.0, 0.05))
def test_pressing_straight_gives_the_stiffness_times_the_depth(x, depth):
    wrench = PLAIN.contact(Pose(x, DISTANCE + depth, 0.0), STILL)
    stiffness = PLAIN.settings.brush_share * PLAIN.settings.stiffness
    assert wrench.fy == pytest.approx(-stiffness * depth, abs=1e-9)
    assert (wrench.fx, wrench.mz) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_away_from_the_wall_nothing_is_felt():
    assert PLAIN.contact(Pose(0.0, DISTANCE - 0.001, 0.0), STILL) == NO_CONTACT
    absent = Facade(FacadeSettings(present=False))
    assert absent.contact(Pose(0.0, 10.0, 0.0), STILL) == NO_CONTACT


@given(st.floats(0.001, 0.05))
def test_a_turned_head_is_turned_back(yaw):
    for angle in (yaw, -yaw):
        wrench = PLAIN.contact(Pose(0.0, DISTANCE + 0.03, angle), STILL)
        assert wrench.mz * angle < 0.0


@given(st.floats(-0.3, 0.3), st.floats(0.0, 0.05), st.floats(-0.1, 0.1), st.floats(-0.5, 0.5))
def test_the_wall_never_pulls(x, depth, yaw, speed):
    head = Pose(x, DISTANCE + depth, yaw)
    wrench = PLAIN.contact(head, Pose(0.0, speed, 0.0))
    assert Facade.force_on_wall(head, wrench) >= -1e-9


def test_friction_opposes_the_slip_in_proportion_to_the_pressure():
    rough = Facade(FacadeSettings(present=True, friction=0.3))
    head = Pose(0.0, DISTANCE + 0.03, 0.0)
    right, left = (rough.contact(head, Pose(speed, 0.0, 0.0)) for speed in (0.2, -0.2))
    assert right.fx == pytest.approx(0.3 * right.fy)
    assert left.fx == pytest.approx(-right.fx)


def test_steps_change_the_distance_without_a_corner():
    frame = Facade(FacadeSettings(
        present=True, step_positions=(-0.05, 0.05), step_heights=(0.02, -0.02)))
    distances = np.array([frame.distance(x) for x in np.linspace(-0.2, 0.2, 2001)])
    assert distances[0] == distances[-1] == DISTANCE
    assert frame.distance(0.0) == pytest.approx(DISTANCE - 0.02)
    assert abs(np.diff(distances, 2)).max() < 2e-6
