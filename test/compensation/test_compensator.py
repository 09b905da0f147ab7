"""Goals on the wall, disturbances and heads in; corrected poses out."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.compensation.compensator import (
    CompensationSettings,
    Compensator,
    CompensatorSettings,
)
from facade_manipulator.compensation.contact import ContactSettings, LateralSettings, PressMode
from facade_manipulator.compensation.correction import CorrectionMode, CorrectionSettings
from facade_manipulator.errors import LimitError, ParameterError
from facade_manipulator.kinematics import add, compose, Geometry, Mechanism, Pose, relative, Wrench

GEOMETRY = Geometry()
GOAL = Pose(0.05, 0.25, 0.05)
PERIOD = 0.01
NO_VARIANCES = (0.0, 0.0, 0.0)


class Run:
    """A compensator at 100 Hz with a perfect estimator; the head follows if asked to."""

    def __init__(self, motion, **settings):
        self.compensator = Compensator(GEOMETRY, CompensatorSettings(**settings))
        self.motion = motion
        self.now = 1000.0
        self.outputs = []

    def go(self, duration, head=None):
        for k in range(round(duration / PERIOD)):
            self.now += PERIOD
            if k % 2:
                self.compensator.add_estimate(
                    self.now, self.now, self.motion(self.now), NO_VARIANCES)
            if head is not None:
                self.compensator.following.add_head(self.now, head)
            self.outputs.append(self.compensator.update(self.now))
        return self

    @property
    def last(self):
        return self.outputs[-1]


@pytest.mark.long
@given(
    st.floats(-0.1, 0.1), st.floats(-0.03, 0.03), st.floats(-0.08, 0.08),
    st.floats(-0.1, 0.1), st.floats(0.23, 0.27), st.floats(-0.05, 0.05))
def test_disturbance_and_corrected_pose_compose_to_the_reference(dx, dy, dtheta, x, y, theta):
    disturbance = Pose(dx, dy, dtheta)
    run = Run(lambda _: disturbance)
    run.compensator.set_goal(Pose(x, y, theta))
    run.go(1.0)
    for output in run.outputs[-20:]:
        wanted = add(output.pose, output.saturation_error)
        assert wanted == pytest.approx(
            tuple(relative(output.disturbance, output.reference)), abs=1e-12)


def test_constant_disturbance_is_corrected_to_the_goal():
    disturbance = Pose(0.08, 0.02, 0.03)
    run = Run(lambda _: disturbance)
    run.compensator.set_goal(GOAL)
    run.go(8.0)
    assert compose(disturbance, run.last.pose) == pytest.approx(tuple(GOAL), abs=2e-4)


def test_update_without_a_goal_returns_no_pose():
    run = Run(lambda _: Pose(0.0, 0.0, 0.0)).go(0.5)
    assert set(run.outputs) == {None}


def test_corrected_pose_is_for_one_horizon_ahead():
    run = Run(lambda _: Pose(0.0, 0.0, 0.0))
    run.compensator.set_goal(GOAL)
    run.go(0.1)
    assert run.last.time == pytest.approx(run.now + CompensationSettings().horizon)


@pytest.mark.long
def test_lag_of_the_head_extends_the_prediction():
    def motion(time):
        return Pose(0.05 * math.sin(time - 1020.0), 0.0, 0.0)

    run = Run(motion)
    run.compensator.set_goal(GOAL)
    run.go(20.0)
    run.compensator.following.lag = 0.04
    run.go(0.1)
    assert run.last.disturbance.x == pytest.approx(motion(run.last.time + 0.04).x, abs=5e-4)


@pytest.mark.parametrize('goal', [
    Pose(0.0, 0.40, 0.0), Pose(0.48, 0.25, 0.0), Pose(0.0, 0.06, 0.0), Pose(0.0, 0.25, 0.5)])
def test_rejected_goal_outside_the_workspace_keeps_the_previous_goal(goal):
    run = Run(lambda _: Pose(0.0, 0.0, 0.0))
    run.compensator.set_goal(GOAL)
    with pytest.raises(LimitError, match='bound'):
        run.compensator.set_goal(goal)
    assert run.compensator.goal == GOAL


@pytest.mark.parametrize('goal', [Pose(math.nan, 0.25, 0.0), Pose(0.0, math.inf, 0.0)])
def test_goal_that_is_not_finite_is_rejected(goal):
    with pytest.raises(ParameterError, match='finite'):
        Compensator(GEOMETRY).set_goal(goal)


@pytest.mark.long
def test_axis_is_held_at_its_workspace_limit_and_returns():
    def sway(time):
        return Pose(0.45 * math.sin(0.4 * (time - 1000.0)), 0.0, 0.0)

    run = Run(sway)
    run.compensator.set_goal(Pose(0.0, 0.25, 0.0))
    run.go(16.0)  # once to and fro
    poses = np.array([output.pose for output in run.outputs])
    for pose in run.outputs[::7]:
        Mechanism(GEOMETRY).certify(pose.pose)
    held = [abs(output.saturation_error.x) > 1e-3 for output in run.outputs]
    assert any(held)
    assert not held[-1]
    assert max(abs(output.saturation_error.y) for output in run.outputs) == 0.0
    assert abs(np.diff(poses, 2, axis=0)).max() < 1e-3
    assert compose(sway(run.last.time), run.last.pose).x == pytest.approx(0.0, abs=5e-3)


@pytest.mark.parametrize('head', [Pose(-0.1, 0.24, 0.0), None])
def test_path_begins_at_the_measured_head_or_the_goal(head):
    run = Run(lambda _: Pose(0.0, 0.0, 0.0))
    if head:
        run.compensator.following.add_head(1000.0, head)
    run.compensator.set_goal(GOAL)
    run.go(PERIOD)
    assert run.last.pose == pytest.approx(tuple(head or GOAL), abs=1e-9)


def test_path_not_followed_restarts_at_the_head():
    run = Run(lambda _: Pose(0.0, 0.0, 0.0))
    head = Pose(-0.1, 0.25, 0.0)
    run.compensator.following.add_head(1000.0, head)
    run.compensator.set_goal(Pose(0.1, 0.25, 0.0))
    run.go(4.0, head)
    away = [abs(output.pose.x - head.x) for output in run.outputs]
    assert run.compensator.initialisations > 2
    assert max(away) < 0.2
    assert min(away[200:]) < 1e-6


def test_path_followed_by_the_head_is_not_restarted():
    run = Run(lambda _: Pose(0.0, 0.0, 0.0))
    run.compensator.following.add_head(1000.0, Pose(-0.1, 0.25, 0.0))
    run.compensator.set_goal(Pose(0.1, 0.25, 0.0))
    for _ in range(300):
        run.go(PERIOD, run.outputs[-6].pose if len(run.outputs) > 6 else None)
    assert run.compensator.initialisations == 1
    assert run.last.pose == pytest.approx((0.1, 0.25, 0.0), abs=1e-9)


def test_disabled_correction_ignores_the_disturbance():
    run = Run(lambda _: Pose(0.1, 0.0, 0.0), correction=CorrectionSettings(enabled=False))
    run.compensator.set_goal(GOAL)
    run.go(2.0)
    assert run.last.pose == pytest.approx(tuple(GOAL), abs=1e-9)


@pytest.mark.parametrize(('variances', 'reason'), [
    (None, CorrectionMode.SILENT.value),
    ((0.0, 1e6, 0.0), 'the estimate of y or theta is too uncertain')])
def test_lost_estimate_retracts_the_head_with_its_reason(variances, reason):
    run = Run(lambda _: Pose(0.02, 0.0, 0.01), contact=ContactSettings(enabled=True))
    run.compensator.following.add_head(1000.0, Pose(0.0, 0.27, 0.0))
    run.compensator.set_goal(Pose(0.0, 0.25, 0.0))
    run.go(4.0)
    pressing = run.compensator.contact.pressing
    pressing.mode = PressMode.HOLDING
    for k in range(80):
        run.now += PERIOD
        run.compensator.contact.add_wrench(
            run.now, run.now, Wrench(0.0, -30.0 - 0.01 * (k % 3), 0.0))
        if variances:
            run.compensator.add_estimate(run.now, run.now, Pose(0.02, 0.0, 0.01), variances)
        run.compensator.update(run.now)
    assert (pressing.mode, pressing.last_reason) == (PressMode.RETRACTED, reason)


def test_contact_settings_change_without_a_jump():
    run = Run(lambda _: Pose(0.0, 0.0, 0.0))
    run.compensator.set_goal(GOAL)
    run.go(1.0)
    run.compensator.change('contact', ContactSettings(enabled=True))
    run.compensator.change('lateral', LateralSettings(enabled=True))
    run.go(2.0)
    run.compensator.change('contact', ContactSettings())
    run.go(2.0)
    y = np.array([output.pose.y for output in run.outputs])
    assert y.min() == pytest.approx(GOAL.y - 0.05) and y[-1] == pytest.approx(GOAL.y)
    assert abs(np.diff(y)).max() <= 0.04 * PERIOD + 1e-9
