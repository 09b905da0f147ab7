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
    LATEST_WRENCH,
)
from facade_manipulator.compensation.contact import LateralSettings, SHIFT_SPEED
from facade_manipulator.compensation.correction import CorrectionMode, CorrectionSettings
from facade_manipulator.compensation.force_watch import OLDEST_WRENCH
from facade_manipulator.compensation.impedance import ImpedanceSettings
from facade_manipulator.compensation.pressing import PressMode
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


@given(
    st.floats(-0.1, 0.1), st.floats(-0.03, 0.03), st.floats(-0.08, 0.08),
    st.floats(-0.1, 0.1), st.floats(0.23, 0.27), st.floats(-0.05, 0.05))
def test_disturbance_and_corrected_pose_compose_to_the_reference(dx, dy, dtheta, x, y, theta):
    disturbance = Pose(dx, dy, dtheta)
    run = Run(lambda _: disturbance)
    run.compensator.set_goal(Pose(x, y, theta))
    run.go(1.0)
    for output in run.outputs[-20:]:
        tracked = max(map(abs, output.tracking_error)) <= 1e-12
        if tracked and not any(output.saturation_error):
            on_the_wall = compose(output.disturbance, output.pose)
            assert on_the_wall == pytest.approx(tuple(output.reference), abs=1e-12)


def test_what_limits_hold_back_is_what_the_head_lacks():
    run = Run(lambda t: Pose(0.1 * math.sin(2.0 * t), 0.0, 0.0),
              compensation=CompensationSettings(speed=(0.05, 0.4, 1.2)))
    run.compensator.set_goal(GOAL)
    run.go(10.0)
    assert max(abs(output.tracking_error.x) for output in run.outputs) > 0.02
    for output in run.outputs:
        wanted = relative(output.disturbance, output.shifted)
        held_back = add(output.saturation_error, output.tracking_error)
        assert add(output.pose, held_back) == pytest.approx(tuple(wanted), abs=1e-12)


def test_forces_are_turned_with_the_head_before_it_presses_as_well():
    run = Run(lambda _: Pose(0.0, 0.0, 0.0))
    run.compensator.set_goal(Pose(0.05, 0.25, 0.1))
    run.go(5.0)
    contact = run.compensator.contact
    assert contact.is_idle
    contact.add_wrench(run.now, run.now, Wrench(3.0, -30.0, 0.5))
    assert contact.pressing.y.measured == pytest.approx(
        30.0 * math.cos(0.1) - 3.0 * math.sin(0.1))


def test_a_standing_disturbance_is_corrected_to_the_goal():
    disturbance = Pose(0.08, 0.02, 0.03)
    run = Run(lambda _: disturbance)
    run.compensator.set_goal(GOAL)
    run.go(8.0)
    assert compose(disturbance, run.last.pose) == pytest.approx(tuple(GOAL), abs=2e-4)


def test_the_first_pose_is_not_shifted_yet():
    compensator = Compensator(GEOMETRY, CompensatorSettings(lateral=LateralSettings(enabled=True)))
    compensator.set_goal(GOAL)
    shifts = []
    for now in (1000.0, 1000.01):
        compensator.contact.add_lateral_offset(now, now, 0.02)
        output = compensator.update(now)
        shifts.append(output.shifted.x - output.reference.x)
    assert shifts[0] == 0.0 < shifts[1] <= SHIFT_SPEED * PERIOD + 1e-12


def test_nothing_is_published_before_there_is_a_goal():
    run = Run(lambda _: Pose(0.0, 0.0, 0.0)).go(0.5)
    assert set(run.outputs) == {None}


def test_a_corrected_pose_is_meant_for_one_horizon_ahead():
    run = Run(lambda _: Pose(0.0, 0.0, 0.0))
    run.compensator.set_goal(GOAL)
    run.go(0.1)
    assert run.last.time == pytest.approx(run.now + CompensationSettings().horizon)


def test_a_head_that_lags_is_told_sooner_where_to_be():
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
def test_a_goal_out_of_the_workspace_is_rejected_and_the_one_before_stays(goal):
    run = Run(lambda _: Pose(0.0, 0.0, 0.0))
    run.compensator.set_goal(GOAL)
    with pytest.raises(LimitError, match='bound'):
        run.compensator.set_goal(goal)
    assert run.compensator.goal == GOAL


@pytest.mark.parametrize('goal', [Pose(math.nan, 0.25, 0.0), Pose(0.0, math.inf, 0.0)])
def test_a_goal_that_is_not_finite_is_rejected(goal):
    with pytest.raises(ParameterError, match='finite'):
        Compensator(GEOMETRY).set_goal(goal)


def test_beyond_the_workspace_each_axis_is_held_at_its_workspace_limit_and_comes_back():
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
def test_the_course_begins_where_the_head_stands_or_at_the_goal_if_that_is_not_known(head):
    run = Run(lambda _: Pose(0.0, 0.0, 0.0))
    if head:
        run.compensator.following.add_head(1000.0, head)
    run.compensator.set_goal(GOAL)
    run.go(PERIOD)
    assert run.last.pose == pytest.approx(tuple(head or GOAL), abs=1e-9)


def test_a_course_that_the_head_does_not_follow_begins_anew_at_the_head():
    run = Run(lambda _: Pose(0.0, 0.0, 0.0))
    head = Pose(-0.1, 0.25, 0.0)
    run.compensator.following.add_head(1000.0, head)
    run.compensator.set_goal(Pose(0.1, 0.25, 0.0))
    run.go(4.0, head)
    away = [abs(output.pose.x - head.x) for output in run.outputs]
    assert run.compensator.initialisations > 2
    assert max(away) < 0.2
    assert min(away[200:]) < 1e-6


def test_a_head_that_follows_is_left_alone():
    run = Run(lambda _: Pose(0.0, 0.0, 0.0))
    run.compensator.following.add_head(1000.0, Pose(-0.1, 0.25, 0.0))
    run.compensator.set_goal(Pose(0.1, 0.25, 0.0))
    for _ in range(300):
        run.go(PERIOD, run.outputs[-6].pose if len(run.outputs) > 6 else None)
    assert run.compensator.initialisations == 1
    assert run.last.pose == pytest.approx((0.1, 0.25, 0.0), abs=1e-9)


def test_disabled_the_rail_is_taken_for_the_wall():
    run = Run(lambda _: Pose(0.1, 0.0, 0.0), correction=CorrectionSettings(enabled=False))
    run.compensator.set_goal(GOAL)
    run.go(2.0)
    assert run.last.pose == pytest.approx(tuple(GOAL), abs=1e-9)


@pytest.mark.parametrize(('variance', 'patience'), [(1e-6, LATEST_WRENCH), (1e6, OLDEST_WRENCH)])
def test_an_estimate_waits_for_what_the_head_felt_then_longer_where_only_that_tells(
        variance, patience):
    compensator = Compensator(GEOMETRY, CompensatorSettings(
        impedance=ImpedanceSettings(enabled=True)))
    compensator.contact.pressing.mode = PressMode.HOLDING
    for age, stamp, heard in ((0.8, 1000.0, -math.inf), (1.1, 1000.001, 1000.0)):
        compensator.add_estimate(
            1000.0 + age * patience, stamp, Pose(0.0, 0.0, 0.0), (variance, 1e-6, 1e-6))
        assert compensator.correction.predictor.stamp == heard


def pressed_in(monkeypatch, motion, duration, **settings):
    """Return a run that presses, and what pressing was told of each cycle."""
    run, told = Run(motion, impedance=ImpedanceSettings(enabled=True), **settings), []
    step = run.compensator.contact.pressing.step

    def noted(*arguments):
        told.append(arguments[-1])
        step(*arguments)

    monkeypatch.setattr(run.compensator.contact.pressing, 'step', noted)
    run.compensator.following.add_head(1000.0, Pose(0.0, 0.27, 0.0))
    run.compensator.set_goal(Pose(0.0, 0.25, 0.0))
    return run.go(duration), told


def test_pressing_is_told_how_far_beyond_the_goal_the_path_is_and_where_the_rail(monkeypatch):
    _, told = pressed_in(monkeypatch, lambda _: Pose(0.02, 0.0, 0.01), 4.0)
    begin = 0.27 + ImpedanceSettings().retreat  # for the offset is that of the retreat
    assert [told[k].place for k in (0, -1)] == pytest.approx([begin, 0.25], abs=1e-9)
    assert [told[k].beyond for k in (0, -1)] == pytest.approx([begin - 0.25, 0.0], abs=1e-9)
    assert told[-1].rail == pytest.approx((0.02, 0.0, 0.01), abs=2e-3)
    assert (told[-1].silence, told[-1].held_back) == ('', '')


@pytest.mark.parametrize(('speed', 'is_held_back'), [(0.4, False), (0.005, True)])
def test_pressing_is_told_what_holds_the_head_back_in_y(monkeypatch, speed, is_held_back):
    _, told = pressed_in(
        monkeypatch, lambda time: Pose(0.0, 0.01 * math.sin(2.0 * time), 0.0), 4.0,
        compensation=CompensationSettings(speed=(0.4, speed, 1.2)))
    assert any(around.held_back for around in told[300:]) == is_held_back


def test_a_wall_is_forgotten_whose_frame_is_another_one(monkeypatch):
    run, told = pressed_in(monkeypatch, lambda _: Pose(0.02, 0.0, 0.01), 4.0)
    pressing, correction = run.compensator.contact.pressing, run.compensator.correction
    for change, wall in ((None, 0.3), (lambda: correction.tare(run.now), None),
                         (lambda: setattr(correction, 'enabled', False), None)):
        pressing.wall = 0.3
        if change:
            change()
        run.go(0.1)
        assert pressing.wall == wall
    assert told[-1].silence == ''  # nothing should be corrected


def test_pressing_is_told_why_the_disturbance_is_not_corrected(monkeypatch):
    run, told = pressed_in(monkeypatch, lambda _: Pose(0.02, 0.0, 0.01), 4.0)
    for _ in range(80):
        run.now += PERIOD
        run.compensator.update(run.now)
    assert told[-1].silence == CorrectionMode.SILENT.value
    for _ in range(100):
        run.now += PERIOD
        run.compensator.add_estimate(
            run.now, run.now, Pose(0.02, 0.0, 0.01), (0.0, 1e6, 0.0))
        run.compensator.update(run.now)
    assert told[-1].silence == 'the estimate of y or theta is too uncertain'
