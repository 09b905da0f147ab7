"""What the bench says of predictions side by side."""

import copy
from types import SimpleNamespace

import pytest

from facade_manipulator.kinematics import Pose
from facade_manipulator.lab.gondola.bench import comparison
from facade_manipulator.lab.gondola.bench.__main__ import Run


def test_errors_within_two_deviations_are_counted_while_the_goal_stands():
    steps = [SimpleNamespace(sample=SimpleNamespace(
        time=float(k), rail=Pose(0.1 * k, 0.0, 0.0), settled=k >= 3)) for k in range(11)]
    expected = {
        time: (0.1 * time + off, 0.0, 0.3, 0.01, 0.01, 0.1)
        for time, off in ((1.0, 0.5), (3.5, 0.015), (4.5, -0.015), (6.5, 0.025), (8.25, 0.0))}
    assert Run(None, steps, expected).within() == pytest.approx([0.75, 1.0, 0.0])


CASES = {
    'gusts': {'rms': {'without': [0.1, None, 0.02], 'learnt': [0.001, None, 0.0005],
                      'oracle': [0.0009, None, 0.0004]},
              'within_two_deviations': [0.95, 0.9, 1.0]},
    'rest': {'rms': {'without': [0.0, 0.0, 0.0], 'learnt': [0.0001, 0.0001, 0.0001]},
             'within_two_deviations': [0.95, 0.9, 1.0]},
}


def test_a_table_tells_units_or_shares_and_leaves_pressed_axes_out():
    values, shares = (
        list(comparison.comparison({'gusts': CASES['gusts']}, (1e3, 1e3, 1e3), in_percent))
        for in_percent in (False, True))
    assert '| 100 / – / 20.0  | 1.00 / – / 0.500 ' in values[2]
    assert '| 100 / – / 20.0  | 1.00 / – / 2.50 ' in shares[2]
    assert len({len(line) for line in values}) == 1


def test_the_bound_explains_what_lies_between_it_and_the_oracle():
    rms = {'learnt': [3.0, 2.0, None], 'bound': [2.0, 2.0, None], 'oracle': [1.0, 1.0, None]}
    assert comparison.explained(rms) == [0.5, 1.0, None]
    assert comparison.explained(CASES['gusts']['rms']) is None


def test_an_earlier_report_is_put_beside_where_it_has_the_case():
    now = copy.deepcopy(CASES)
    comparison.put_beside(now, {'gusts': {'rms': {'learnt': [2.0, None, 1.0]}}, 'gone': {}})
    assert now['gusts']['rms']['before'] == [2.0, None, 1.0]
    assert 'before' not in now['rest']['rms']


def test_what_a_case_lacks_is_not_drawn(tmp_path):
    path = tmp_path / 'predictions.png'
    comparison.draw_comparison(path, CASES, (1e3, 1e3, 57.3), ('x', 'y', 'θ'), 'RMS')
    assert path.stat().st_size > 0
