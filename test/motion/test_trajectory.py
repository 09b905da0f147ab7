"""Jerk-limited trajectories, including motions for which ruckig first finds none."""

import sys
from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from ruckig import RuckigError, Synchronization

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.motion import trajectory
from facade_manipulator.motion.trajectory import plan_trajectory

ZERO = [0.0] * 3
LIMITS = ([0.5] * 3, [3.0] * 3, [150.0] * 3)
small = st.floats(-1e-12, 1e-12)


def end_of(path):
    return path.at_time(path.duration)


# inputs of one axis that users of ruckig have reported as "error in step 1" (issues 100 and 160)
@pytest.mark.parametrize(
    ('position', 'velocity', 'acceleration', 'goal', 'limits'),
    [
        (
            0.02853333333333339,
            0.6800000000000006,
            7.999999999999993,
            0.0,
            (1.0, 10.0, 100.0),
        ),
        (
            -0.04895883258572608,
            1.425883388427091e-14,
            -2.370282711878416e-12,
            -0.04895883258572691,
            (5.0, 10.0, 150.0),
        ),
        (0.0, 0.0, 0.0, 0.012, (0.2, 0.6, 6.0)),
    ],
)
def test_path_is_found_where_ruckig_reports_errors(
    position, velocity, acceleration, goal, limits
):
    start = [[value, 0.0, 0.0] for value in (position, velocity, acceleration)]
    speed, largest_acceleration, jerk = limits
    path = plan_trajectory(
        start, [goal, 0.0, 0.0], [speed] * 3, [largest_acceleration] * 3, [jerk] * 3
    )
    assert end_of(path)[0] == pytest.approx([goal, 0.0, 0.0], abs=1e-8)


@given(
    speed=st.floats(-0.49, 0.49),
    apart=st.tuples(small, small, small),
    sign=st.sampled_from((-1.0, 1.0)),
    beyond=st.tuples(*[st.integers(-4, 4)] * 3),
    goal=st.sampled_from((None, [-0.05, 0.15, 0.05])),
)
def test_acceleration_rounded_beyond_its_limit_has_a_path(
    speed, apart, sign, beyond, goal
):
    acceleration = [sign * 3.0 * (1.0 + n * sys.float_info.epsilon) for n in beyond]
    start = (-0.1, 0.1, 0.0), [speed + a for a in apart], acceleration
    end = end_of(plan_trajectory(start, goal, *LIMITS))
    assert np.array(end[1:]) == pytest.approx(0.0, abs=1e-9)
    assert goal is None or end[0] == pytest.approx(goal)


def test_goal_without_straight_path_gets_a_curved_path(monkeypatch):
    # fails in the same way as ruckig sometimes does
    def calculate(plan, path, planner=trajectory.PLANNER):
        if plan.synchronization == Synchronization.Phase:
            raise RuckigError('error in step 2')
        return planner.calculate(plan, path)

    monkeypatch.setattr(trajectory, 'PLANNER', SimpleNamespace(calculate=calculate))
    path = plan_trajectory([ZERO] * 3, [0.1, 0.2, 0.1], *LIMITS)
    assert end_of(path)[0] == pytest.approx([0.1, 0.2, 0.1])


def test_negative_speed_limit_has_no_path():
    message = r'no jerk-limited path from .* m to \[0.1, 0.1, 0.1\] m; next: '
    with pytest.raises(ManipulatorError, match=message):
        negative = [-1.0, -1.0, -1.0]
        plan_trajectory([ZERO] * 3, [0.1] * 3, negative, *LIMITS[1:])
