"""A goal is reached when the head, as measured, is near it for a while."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.compensation.compensator import Compensator
from facade_manipulator.compensation.following import ArrivalSettings, ArrivalWatch, GoalState
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import compose, Geometry, Pose, relative

SETTINGS = ArrivalSettings(distance=0.005, angle=0.01, dwell=0.2)
NEAR, FAR = Pose(0.003, 0.003, 0.005), Pose(0.006, 0.0, 0.0)
PERIOD = 0.01


def states(*steps):
    """Return the state after each (seconds, error, path time), updated at 100 Hz."""
    watch, now, found = ArrivalWatch(SETTINGS), 0.0, []
    for duration, error, path_time in steps:
        for _ in range(round(duration / PERIOD)):
            now += PERIOD
            progress = watch.update(now, error, path_time, False)
        found.append(progress.state.value)
    return found


def test_goal_near_for_the_dwell_is_reached():
    assert states((0.15, NEAR, 0.0), (0.1, NEAR, 0.0)) == ['moving', 'reached']
    assert states((0.15, NEAR, 0.0), (0.02, FAR, 0.0), (0.15, NEAR, 0.0)) == ['moving'] * 3


def test_goal_on_the_way_or_unmeasured_is_not_reached():
    assert states((1.0, NEAR, 0.5)) == ['moving']
    assert states((1.0, None, 0.0)) == ['moving']
    assert states((1.0, Pose(0.0, 0.0, 0.02), 0.0)) == ['moving']


def test_reached_goal_stays_reached_within_twice_the_tolerance():
    assert states((0.3, NEAR, 0.0), (0.3, Pose(0.009, 0.0, 0.0), 0.0),
                  (0.1, Pose(0.011, 0.0, 0.0), 0.0)) == ['reached', 'reached', 'moving']


@given(st.lists(st.tuples(
    st.floats(0.0, 0.5), st.floats(0.0, 0.02), st.floats(-1.0, 1.0), st.booleans(),
    st.booleans()), max_size=40))
def test_reached_goal_was_always_near_for_the_dwell(steps):
    watch, now, near_since = ArrivalWatch(SETTINGS), 0.0, None
    for step, distance, path_time, held, pressed in steps:
        now += step
        progress = watch.update(now, Pose(distance, 0.0, 0.0), path_time, held, pressed)
        near = pressed and path_time <= 0.0 and distance <= 2.0 * SETTINGS.distance
        near_since = (now if near_since is None else near_since) if near else None
        if progress.state is GoalState.REACHED:
            assert near and now - near_since >= SETTINGS.dwell
            assert progress.time_to_go == 0.0
        else:
            assert (progress.state is GoalState.HELD_BACK) == held
            assert progress.time_to_go >= 0.0


# --- the compensator's side

GOAL = Pose(0.1, 0.26, 0.02)


class Head:
    """A compensator on a displaced rail whose head follows with a lag [s]."""

    def __init__(self, lag=0.0):
        self.compensator, self.now, self.lag = Compensator(Geometry()), 100.0, lag
        self.rail = Pose(0.02, -0.005, 0.01)
        self.places = []

    def run(self, duration):
        for _ in range(round(duration / PERIOD)):
            self.now += PERIOD
            self.compensator.add_estimate(self.now, self.now - 0.02, self.rail, [1e-8] * 3)
            corrected = self.compensator.update(self.now)
            if corrected is not None:
                self.places.append((corrected.time, corrected.pose, corrected.reference))
            due = [place for place in self.places if place[0] <= self.now - self.lag]
            if due:
                self.compensator.following.add_head(self.now, due[-1][1])
        return self


def test_goal_error_is_measured_on_the_wall():
    head = Head()
    assert head.compensator.goal_error(head.now) is None
    head.run(5.0)
    head.compensator.set_goal(GOAL)
    head.run(3.0)
    error = head.compensator.goal_error(head.now)
    assert max(map(abs, error)) < 1e-4
    assert head.compensator.path_time(head.now) < 0.0
    head.compensator.following.add_head(head.now + 1e-3, relative(
        head.rail, compose(Pose(0.0, 0.0, 0.0), GOAL._replace(x=GOAL.x - 0.03))))
    assert head.compensator.goal_error(head.now).x == pytest.approx(0.03, abs=1e-4)
    assert head.compensator.goal_error(head.now + 5.0) is None  # the pose of the head is too old


@pytest.mark.parametrize(('lag', 'most'), [(0.0, 0.61), (0.04, 0.63)])
def test_hold_brakes_within_the_limits_and_stays(lag, most):
    head = Head(lag).run(5.0)
    head.compensator.set_goal(Pose(-0.1, 0.25, 0.0))
    head.run(3.0)
    head.compensator.set_goal(GOAL)
    head.run(0.6)
    begin = head.places[-1][2]
    place = head.compensator.hold(head.now)
    held = len(head.places)
    head.run(3.0)
    references = [reference for _, _, reference in head.places[held - 3:]]
    assert head.compensator.goal == place != GOAL
    assert begin.x < place.x < GOAL.x
    assert references[-1] == pytest.approx(place)
    speeds = [(b.x - a.x) / PERIOD for a, b in zip(references, references[1:], strict=False)]
    assert max(abs(b - a) / PERIOD for a, b in zip(speeds, speeds[1:], strict=False)) < most
    assert math.dist(head.places[-1][2], place) < 1e-6


def test_hold_without_a_goal_is_rejected():
    with pytest.raises(ManipulatorError, match='no goal'):
        Head().run(1.0).compensator.hold(101.0)
