"""Settings of the compensation that change while it runs: the head never jumps."""

from __future__ import annotations

from dataclasses import replace
import math

import pytest

from facade_manipulator.compensation.compensator import Compensator, DEFAULTS
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.compensation.limits import WorkspaceLimitSettings
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry, Pose

PERIOD = 0.01
GOAL = Pose(0.0, 0.25, 0.0)


class Course:
    """A compensator at work in the wind, cycle by cycle."""

    def __init__(self, amplitude=0.1):
        self.compensator = Compensator(Geometry())
        self.compensator.set_goal(GOAL)
        self.amplitude = amplitude
        self.now = 100.0
        self.poses = []

    def sway(self, time):
        return Pose(self.amplitude * math.sin(0.7 * time), 0.0, 0.0)

    def run(self, duration):
        for _ in range(round(duration / PERIOD)):
            self.now += PERIOD
            if round(self.now / PERIOD) % 2 == 0:
                self.compensator.add_estimate(
                    self.now, self.now - 0.05, self.sway(self.now - 0.05), (1e-6, 1e-6, 1e-6))
            self.poses.append(self.compensator.update(self.now).pose)
        return self

    def quickest(self):
        return max(math.dist(a[:2], b[:2]) / PERIOD
                   for a, b in zip(self.poses, self.poses[1:], strict=False))


CHANGES = {
    'estimate': {'mounting': (0.5, 0.3, 0.02), 'axes': 0.05, 'delay': 0.02},
    'prediction': {'memory': 30.0, 'speed': (1.0, 1.0, 1.0)},
    'correction': {'fade_time': 1.0},
    'reference': {'speed': (0.1, 0.1, 0.1)},
    'workspace_limit': {'margin': 0.05},
    'lateral': {'range': 0.01},
    'impedance': {'stiffness': 50.0},
    'yaw_impedance': {'stiffness': 5.0},
    'suspension': {'mass': 500.0},
    'compensation': {'speed': (0.3, 0.3, 0.3), 'acceleration': (1.0, 1.0, 1.0)},
}


@pytest.mark.long
@pytest.mark.parametrize('part', DEFAULTS._fields)
def test_a_change_of_any_part_moves_the_head_without_a_jump(part):
    course = Course().run(8.0)
    course.poses.clear()
    course.run(0.5)
    usual = course.quickest()
    course.compensator.change(part, replace(getattr(DEFAULTS, part), **CHANGES[part]))
    course.run(6.0)
    assert course.quickest() < usual + 0.25  # m/s; a jump of 1 cm would be 1 m/s


def test_other_bounds_of_the_estimate_forget_nothing():
    course = Course().run(8.0)
    course.compensator.change('estimate', replace(DEFAULTS.estimate, yaw_noise=0.01))
    course.run(PERIOD)
    assert course.compensator.correction.mode is CorrectionMode.ACTIVE


def test_a_wider_workspace_limit_is_kept_after_a_while():
    course = Course(amplitude=0.6).run(12.0)
    before = max(abs(pose.x) for pose in course.poses)
    course.compensator.change('workspace_limit', WorkspaceLimitSettings(margin=0.05))
    course.run(3.0)
    course.poses.clear()
    course.run(10.0)
    after = max(abs(pose.x) for pose in course.poses)
    assert after == pytest.approx(before - 0.05 + 0.004, abs=2e-3)
    assert course.quickest() < 1.0


def test_a_workspace_limit_that_is_moved_while_it_holds_the_head_moves_it_without_a_jump():
    course = Course(amplitude=0.6).run((math.tau * 12.25) / 0.7 - 100.0)  # the sway is greatest
    del course.poses[:-1]
    course.compensator.change('workspace_limit', WorkspaceLimitSettings(margin=0.05))
    course.run(1.0)
    assert abs(course.poses[-1].x) < abs(course.poses[0].x) - 0.02
    assert course.quickest() < 0.5


def test_a_workspace_limit_that_leaves_nothing_is_rejected_and_the_old_one_stays():
    compensator = Compensator(Geometry(carriage_gap=0.27))
    compensator.set_goal(Pose(0.0, 0.345, 0.0))
    before = compensator.update(1.0).pose
    with pytest.raises(ParameterError, match='leaves no workspace'):
        compensator.change('workspace_limit', WorkspaceLimitSettings(margin=0.1))
    assert compensator.update(1.01).pose == pytest.approx(before)


def test_another_prediction_learns_anew_and_is_trusted_again():
    course = Course().run(8.0)
    correction = course.compensator.correction
    assert correction.mode is CorrectionMode.ACTIVE
    course.compensator.change('prediction', replace(DEFAULTS.prediction, memory=30.0))
    assert correction.mode is not CorrectionMode.ACTIVE
    course.run(2.0)
    assert correction.mode is CorrectionMode.ACTIVE


def test_pressing_that_is_switched_on_moves_the_head_off_the_goal_and_off_again_back_to_it():
    compensator, now = Compensator(Geometry()), 1.0
    compensator.set_goal(GOAL)

    def updated(duration):
        nonlocal now
        for _ in range(round(duration / PERIOD)):
            now += PERIOD
            last = compensator.update(now)
        return last

    assert updated(1.0).shifted == GOAL
    compensator.change('impedance', replace(DEFAULTS.impedance, enabled=True))
    assert updated(3.0).shifted.y == pytest.approx(GOAL.y - DEFAULTS.impedance.retreat)
    compensator.change('impedance', DEFAULTS.impedance)
    assert updated(3.0).shifted == GOAL
    assert compensator.contact.is_idle
