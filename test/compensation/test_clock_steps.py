"""The system clock is set: the correction stays active and the head does not jump."""

import math

import numpy as np
import pytest

from facade_manipulator.compensation.compensator import Compensator
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.kinematics.planar import compose, invert

PERIOD = 0.01
GOAL = Pose(0.05, 0.25, 0.0)


def sway(time):
    return Pose(0.08 * math.sin(0.7 * time), 0.01 * math.sin(1.2 * time), 0.0)


class Course:
    """A compensator whose head follows at once, on a clock that can be set."""

    def __init__(self):
        self.compensator = Compensator(Geometry())
        self.compensator.set_goal(GOAL)
        self.true, self.set_by = 1000.0, 0.0
        self.head = compose(invert(sway(self.true)), GOAL)
        self.poses, self.rejected = [], 0

    def go(self, duration):
        for k in range(round(duration / PERIOD)):
            self.true += PERIOD
            now = self.true + self.set_by
            self.hear(self.compensator.following.add_head, now - PERIOD, self.head)
            if k % 2:
                self.hear(self.compensator.add_estimate, now, now - 0.05,
                          sway(self.true - 0.05), (0.0, 0.0, 0.0))
            corrected = self.compensator.update(now)
            self.head = corrected.pose
            self.poses.append(corrected.pose)

    def hear(self, take, *arguments):
        try:
            take(*arguments)
        except InputError:
            self.rejected += 1


@pytest.mark.parametrize('step', [-3600.0, -5.0, -0.6, 5.0, 3600.0])
def test_clock_step_keeps_correction_active_without_a_jump(step):
    course = Course()
    course.go(5.0)
    course.set_by = step
    course.go(6.0)
    assert course.compensator.correction.mode is CorrectionMode.ACTIVE
    here = compose(sway(course.true + 0.06), course.head)
    assert here == pytest.approx(tuple(GOAL), abs=4e-3)
    moves = abs(np.diff([pose[:2] for pose in course.poses], axis=0))
    assert moves.max() < 0.02
    assert course.rejected < 100


def test_clock_set_back_rejects_fewer_than_five_messages():
    course = Course()
    course.go(2.0)
    before = course.rejected
    course.set_by = -3600.0
    course.go(2.0)
    assert course.rejected - before < 5
