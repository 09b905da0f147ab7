"""The data of the page: nothing old, nothing that is no number, never too much of it."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st
from panel_bench import HEALTHY, Machine, STOPPED
import pytest

from facade_manipulator.interfaces import CORRECTED_POSE, END_EFFECTOR_POSE
from facade_manipulator.kinematics import compose, Pose
from facade_manipulator.nodes.overview import of_one, OPERATION
from facade_manipulator.tools.panel.view import gondolas, MOST_GONDOLAS, PERIOD, SPAN, wall_line

NOW = 1000.0


@pytest.fixture
def machine():
    made = Machine()
    made.speak(NOW)
    return made


@pytest.mark.parametrize('statuses', [HEALTHY, STOPPED])
def test_what_the_page_says_is_what_the_monitor_says(machine, statuses):
    machine.speak(NOW, statuses)
    shown, said = machine.view.look(NOW), of_one(machine.seen, NOW)
    assert (shown['title'], shown['troubles'], shown['tables']) == (
        said.title, said.troubles, said.tables)


def test_nothing_of_a_silent_machine_is_left_but_its_past(machine):
    assert {'joints', 'target', 'wall'} <= machine.view.look(NOW)['picture'].keys()
    shown = machine.view.look(NOW + 2.0)
    assert shown['picture'].keys() == {'rail', 'carriage', 'reach'}
    assert shown['row'][1:] == [None] * 4
    assert 'silent' in shown['title'].text and shown['title'].level == 'stale'
    assert '1864' not in json.dumps(shown, default=vars)


def test_a_trace_has_a_gap_as_soon_as_nothing_comes(machine):
    assert machine.view.look(NOW + 0.5)['row'][1:] == [None] * 4


def test_the_past_is_a_minute(machine):
    for k in range(round(2 * SPAN / PERIOD)):
        machine.view.look(NOW + PERIOD * k)
    past = machine.view.past
    assert past[-1][0] - past[0][0] == pytest.approx(SPAN - PERIOD)


@given(st.lists(st.floats(), max_size=5), st.lists(st.text(max_size=3), max_size=5), st.floats(),
       st.floats())
def test_whatever_is_published_is_json_that_a_browser_reads(numbers, names, x, y):
    machine = Machine(past=PERIOD)
    machine.speak(NOW, {**HEALTHY, OPERATION: ('error', str(x), {'state': str(y)})})
    machine.seen.joints = NOW, SimpleNamespace(
        name=names, position=numbers, velocity=[], effort=numbers)
    if math.isfinite(x) and math.isfinite(y):  # planar_pose rejects others
        machine.seen.poses[END_EFFECTOR_POSE] = NOW, Pose(min(1e6, abs(x)), min(1e6, abs(y)), 0.0)
    json.dumps(machine.view.look(NOW), default=vars, allow_nan=False)


@given(*[st.floats(-1.0, 1.0)] * 6)
def test_the_wall_is_at_its_distance_from_the_rail_as_the_goal_has_moved(x, y, turn, gx, gy, g):
    facade, goal = Pose(x, y, turn), Pose(gx, gy, g)
    (x0, y0), (x1, y1) = wall_line(compose(facade, goal), goal, 300.0)
    middle = compose(facade, Pose(0.0, 0.3, 0.0))
    assert (0.5 * (x0 + x1), 0.5 * (y0 + y1)) == pytest.approx(
        (1e3 * middle.x, 1e3 * middle.y), abs=0.2)


@given(st.lists(st.sets(st.sampled_from([f'g{k}' for k in range(40)]), max_size=20), max_size=9))
def test_however_names_come_and_go_those_shown_are_bounded_and_stay(rounds):
    shown, ever = [], set()
    for names in rounds:
        before = shown
        shown, more = gondolas({name: {OPERATION: None} for name in names} | {
            'camera': {}}, [], shown)
        ever |= {*shown}
        assert {*before} <= {*shown} and shown == sorted(shown)
        assert len(ever) <= MOST_GONDOLAS and more == len({*before} | names) - len(shown)


def test_those_that_are_asked_for_are_shown_alone():
    assert gondolas({'c': {OPERATION: None}}, ['b', 'a'], []) == (['a', 'b'], 0)


def test_a_head_where_the_mechanism_cannot_be_is_not_drawn(machine):
    machine.seen.poses[END_EFFECTOR_POSE] = NOW, Pose(5.0, 5.0, 0.0)
    assert 'joints' not in machine.view.look(NOW)['picture']
    del machine.seen.poses[CORRECTED_POSE]
    assert machine.view.look(NOW)['row'][1] is None
