"""The path of the head on the wall."""

import math

from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
import pytest
from ruckig import Ruckig, RuckigError, Synchronization

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Pose
from facade_manipulator.motion.reference import (
    Approach,
    HeadMotion,
    ReferencePath,
    ReferenceSettings,
)

SETTINGS = ReferenceSettings()
poses = st.tuples(st.floats(-0.3, 0.3), st.floats(0.1, 0.3), st.floats(-0.3, 0.3)).map(
    lambda values: Pose(*values))


def planned(start, goal):
    reference = ReferencePath(SETTINGS)
    reference.initialise(100.0, HeadMotion(start), goal)
    return reference


@given(poses, poses)
def test_path_joins_start_and_goal_at_rest(start, goal):
    reference = planned(start, goal)
    assert reference.at(99.0).position == pytest.approx(start)
    end = reference.at(reference.arrival() + 1.0)
    assert end.position == pytest.approx(tuple(goal), abs=1e-8)
    assert end == HeadMotion(end.position)  # exactly


@given(poses, poses)
def test_limits_of_speed_acceleration_and_jerk_hold(start, goal):
    reference = planned(start, goal)
    times = np.linspace(100.0, reference.arrival(), 300)
    motions = [reference.at(time) for time in times]
    for i in range(3):
        speeds = [abs(motion.velocity[i]) for motion in motions]
        accelerations = np.array([motion.acceleration[i] for motion in motions])
        assert max(speeds) <= SETTINGS.speed[i] * (1 + 1e-6)
        assert abs(accelerations).max() <= SETTINGS.acceleration[i] * (1 + 1e-6)
        jerks = np.diff(accelerations) / np.maximum(np.diff(times), 1e-9)
        assert abs(jerks).max(initial=0.0) <= SETTINGS.jerk[i] * (1 + 1e-3)


@pytest.mark.parametrize('axis', range(3))
@pytest.mark.parametrize('share', [1.0, -1.0, 1.0 + 1e-12, 1.0 - 1e-12])
def test_border_of_two_kinds_of_path_has_one(axis, share):
    most, jerk = SETTINGS.acceleration[axis], SETTINGS.jerk[axis]
    start = [0.0, 0.25, 0.0]
    goal = start.copy()
    goal[axis] += share * 2.0 * most ** 3 / jerk ** 2  # the acceleration is just reached: 12 mm
    reference = planned(Pose(*start), Pose(*goal))
    assert reference.at(reference.arrival()).position == pytest.approx(goal, abs=1e-8)


@pytest.mark.parametrize('step', [0.001, 0.005])
def test_each_whole_millimetre_has_a_path(step):
    for number in range(1, 200):
        planned(Pose(0.0, 0.25, 0.0), Pose(number * step, 0.25 - 0.1 * number * step, 0.0))
        planned(Pose(0.0, 0.25, 0.0), Pose(0.0, 0.25 + number * step, 0.0))


@given(poses, poses, poses)
@example(Pose(0.02464045505922593, 0.25, 0.0), Pose(0.02464045505922593, 0.22, 0.03),
         Pose(-0.02464045505922593, 0.25, 0.0))  # ruckig ends it at 1e-17 m/s, and knew no way on
def test_path_from_rest_is_straight(before, start, goal):
    reference = planned(before, start)
    begin, start = reference.arrival(), reference.at(reference.arrival()).position
    reference.retarget(begin, goal)
    way = np.subtract(goal, start)
    for share in (0.2, 0.5, 0.8):
        time = begin + share * (reference.arrival() - begin)
        gone = np.subtract(reference.at(time).position, start)
        along = way * (gone @ way) / max(way @ way, 1e-30)
        assert gone == pytest.approx(along, abs=1e-6)


@given(poses, poses, poses, st.floats(0.05, 0.95))
def test_new_goal_changes_the_motion_continuously(start, goal, other, share):
    reference = planned(start, goal)
    time = 100.0 + share * (reference.arrival() - 100.0)
    before = reference.at(time)
    reference.retarget(time, other)
    after = reference.at(time)
    for old, new in zip(before, after, strict=True):
        assert new == pytest.approx(old, abs=1e-9)
    assert reference.at(reference.arrival()).position == pytest.approx(tuple(other), abs=1e-7)


def test_turn_takes_the_shorter_way():
    reference = planned(Pose(0.0, 0.25, math.radians(175)), Pose(0.0, 0.25, math.radians(-175)))
    assert reference.at(reference.arrival()).position.theta == pytest.approx(math.radians(185))


def test_approach_follows_the_path_to_each_goal():
    start, goal, other = Pose(0.0, 0.25, 0.0), Pose(0.1, 0.2, 0.1), Pose(-0.1, 0.22, 0.0)
    approach, path = Approach(SETTINGS), planned(start, goal)
    assert approach.pose(100.0) is None
    approach.begin(100.0, start, goal)
    for time in (100.0, 100.3):
        assert approach.pose(time) == path.at(time).position
    approach.begin(100.3, Pose(9.0, 9.0, 9.0), other)  # who is led is not asked where he is
    path.retarget(100.3, other)
    for time in (100.3, 100.6, path.arrival()):
        assert approach.is_under_way
        assert approach.pose(time) == path.at(time).position
    assert approach.pose(path.arrival()) is None
    approach.begin(200.0, other, goal)
    approach.is_under_way = False
    assert approach.pose(200.1) is None


class Reluctant:
    """A planner that fails for some kinds of synchronisation, as ruckig does now and then."""

    def __init__(self, *failing):
        self._planner, self._failing = Ruckig(3), failing

    def calculate(self, plan, trajectory):
        if plan.synchronization in self._failing:
            raise RuckigError('error in step 2')
        return self._planner.calculate(plan, trajectory)


def test_goal_without_straight_path_has_another_path():
    reference = planned(Pose(0.0, 0.25, 0.0), Pose(0.1, 0.2, 0.1))
    reference._planner = Reluctant(Synchronization.Phase)
    goal = Pose(0.0, 0.2, 0.0)
    reference.retarget(100.1, goal)
    assert reference.at(reference.arrival()).position == pytest.approx(tuple(goal), abs=1e-8)


def test_goal_without_path_leaves_the_path_unchanged():
    reference = planned(Pose(0.0, 0.25, 0.0), Pose(0.1, 0.2, 0.1))
    reference._planner = Reluctant(Synchronization.Phase, Synchronization.TimeIfNecessary)
    before = reference.at(100.1), reference.at(reference.arrival())
    with pytest.raises(ManipulatorError, match='no jerk-limited path'):
        reference.retarget(100.1, Pose(0.0, 0.2, 0.0))
    assert (reference.at(100.1), reference.at(reference.arrival())) == before
