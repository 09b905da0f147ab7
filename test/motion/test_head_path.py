"""Path of the head on the wall."""

import math

from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Pose
from facade_manipulator.motion.head_path import (
    HeadMotion,
    ReferencePath,
    ReferenceSettings,
)

SETTINGS = ReferenceSettings()
angles = st.floats(-0.3, 0.3)
poses = st.builds(Pose, st.floats(-0.3, 0.3), st.floats(0.1, 0.3), angles)


def planned(start, goal):
    reference = ReferencePath(SETTINGS)
    reference.initialise(100.0, HeadMotion(start), goal)
    return reference


def end_of(reference):
    return reference.at(reference.arrival())


@given(poses, poses)
def test_path_joins_start_and_goal_inside_the_limits(start, goal):
    reference = planned(start, goal)
    assert reference.at(99.0).position == pytest.approx(start)
    end = reference.at(reference.arrival() + 1.0)
    assert end.position == pytest.approx(tuple(goal), abs=1e-8)
    assert end == HeadMotion(end.position)  # exactly
    times = np.linspace(100.0, reference.arrival(), 300)
    motions = [reference.at(time) for time in times]
    _, speeds, accelerations = np.moveaxis(motions, 1, 0)
    intervals = np.maximum(np.diff(times), 1e-9)
    jerks = np.diff(accelerations, axis=0) / intervals[:, None]
    for found, limit in (
        (speeds, SETTINGS.speed),
        (accelerations, SETTINGS.acceleration),
        (jerks, SETTINGS.jerk),
    ):
        largest = abs(found).max(axis=0)
        assert (largest <= np.array(limit) * (1 + 1e-6)).all()


def test_path_exists_for_every_whole_millimetre():
    for step in np.arange(1, 1000) * 0.001:
        planned(Pose(0.0, 0.25, 0.0), Pose(step, 0.25 - 0.1 * step, 0.0))
        planned(Pose(0.0, 0.25, 0.0), Pose(0.0, 0.25 + step, 0.0))


@given(poses, poses, poses)
@example(
    Pose(0.02464045505922593, 0.25, 0.0),
    Pose(0.02464045505922593, 0.22, 0.03),
    # Ruckig ended this path at 1e-17 m/s and found no path from there.
    Pose(-0.02464045505922593, 0.25, 0.0),
)
def test_path_from_rest_is_straight(before, start, goal):
    reference = planned(before, start)
    begin = reference.arrival()
    start = end_of(reference).position
    reference.retarget(begin, goal)
    way = np.subtract(goal, start)
    for share in (0.2, 0.5, 0.8):
        time = begin + share * (reference.arrival() - begin)
        gone = np.subtract(reference.at(time).position, start)
        along = way * (gone @ way) / max(way @ way, 1e-30)
        assert gone == pytest.approx(along, abs=1e-6)


@given(poses, poses, poses | st.none(), st.floats(0.05, 0.95))
def test_new_goal_or_stop_keeps_the_motion_continuous(start, goal, other, share):
    reference = planned(start, goal)
    time = 100.0 + share * (reference.arrival() - 100.0)
    before = reference.at(time)
    end = (
        reference.stop(time)
        if other is None
        else reference.retarget(time, other) or other
    )
    for old, new in zip(before, reference.at(time), strict=True):
        assert new == pytest.approx(old, abs=1e-9)
    assert end_of(reference).position == pytest.approx(tuple(end), abs=1e-7)


def test_turn_takes_the_shorter_way():
    start = Pose(0.0, 0.25, math.radians(175))
    goal = Pose(0.0, 0.25, math.radians(-175))
    reference = planned(start, goal)
    assert end_of(reference).position.theta == pytest.approx(math.radians(185))


def test_goal_without_path_leaves_the_path_unchanged():
    reference = planned(Pose(0.0, 0.25, 0.0), Pose(0.1, 0.2, 0.1))
    before = reference.at(100.1), end_of(reference)
    with pytest.raises(ManipulatorError, match='no jerk-limited path'):
        reference.retarget(100.1, Pose(math.nan, 0.2, 0.0))
    assert (reference.at(100.1), end_of(reference)) == before
