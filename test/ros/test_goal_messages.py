"""What compensator/goal_status and a rejection say of a goal, and who reads it back."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.compensation.following import GoalProgress, GoalState
from facade_manipulator.errors import DriveError, InputError
from facade_manipulator.interfaces import Quality
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import status_level, status_values
from facade_manipulator.ros.conversions import stamp
from facade_manipulator.ros.diagnostics import (
    FOLLOWED,
    goal_status,
    RejectedGoal,
    rejection_status,
    stamp_text,
)
from facade_manipulator.ros.interfaces import profile

numbers = st.floats(-3.0, 3.0)
WORST = {GoalState.MOVING: 'ok', GoalState.REACHED: 'ok', GoalState.HELD_BACK: 'warn',
         GoalState.ENDED: 'warn', GoalState.REJECTED: 'error'}


@given(st.sampled_from(sorted(WORST, key=str)), numbers, numbers, st.builds(
    Pose, numbers, numbers, numbers), st.sampled_from(['', 'a wall']))
def test_a_goals_status_says_what_becomes_of_it_in_the_units_of_its_keys(
        state, distance, angle, followed, reason):
    progress = GoalProgress(state, distance, angle, 2.5)
    status = goal_status(stamp(12.25), progress, reason, followed,
                         RejectedGoal(stamp(11.5), 'far'), {'force [N]': 30.0})
    values = status_values(status)
    assert status_level(status) == WORST[state]
    assert status.message == (f'{state.value}: {reason}' if reason else state.value)
    assert (values['state'], values['reason'], values['time to go [s]']) == (
        state.value, reason, '2.5')
    assert float(values['distance [mm]']) == pytest.approx(1e3 * distance, rel=1e-5)
    assert float(values['angle [deg]']) == pytest.approx(math.degrees(angle), rel=1e-5)
    assert (values['goal stamp'], values['rejected goal stamp'], values['rejection']) == (
        '12.250000000', '11.500000000', 'far')
    assert values['force [N]'] == '30'
    assert [float(values[key]) / scale for key, scale in FOLLOWED.items()] == pytest.approx(
        list(followed), rel=1e-5)


def test_without_a_goal_that_is_followed_there_is_none():
    status = goal_status(stamp(1.0), GoalProgress(GoalState.REACHED), '', None)
    assert not {'rejection', *FOLLOWED} & status_values(status).keys()


@pytest.mark.parametrize('error, reason', [
    (InputError('stale', 'too old'), 'stale'), (DriveError('q1 is silent'), 'other')])
def test_a_rejection_has_the_goals_stamp_and_its_reason(error, reason):
    status = rejection_status('goal', error, stamp(12.5))
    assert (status_level(status), status.message) == ('error', str(error))
    assert status_values(status) == {'goal stamp': '12.500000000', 'reason': reason}


@given(st.integers(1, 99), st.booleans(), st.booleans())
def test_a_quality_of_service_is_that_of_the_table(depth, reliable, latched):
    made = profile(Quality(depth, reliable, latched))
    assert made.depth == depth
    assert made.reliability.name == ('RELIABLE' if reliable else 'BEST_EFFORT')
    assert made.durability.name == (
        'TRANSIENT_LOCAL' if latched else 'SYSTEM_DEFAULT' if reliable else 'VOLATILE')


@given(st.integers(0, 2 ** 31 - 1), st.integers(0, 10 ** 9 - 1))
def test_a_stamp_is_a_text_to_the_nanosecond(sec, nanosec):
    message = stamp(0.0)
    message.sec, message.nanosec = sec, nanosec
    whole, part = stamp_text(message).split('.')
    assert (int(whole), int(part), len(part)) == (sec, nanosec, 9)
