"""Scenario files and recordings, read or rejected with a reason."""

import math

import numpy as np
import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Pose
from facade_manipulator.simulation.world.motion import prescribed_motion, recorded_motion
from facade_manipulator.simulation.world.scenario import load_scenario

HEADER = 'time,x,y,theta\n'


def write(path, text):
    path.write_text(text)
    return str(path)


def test_missing_scenario_values_have_defaults(tmp_path):
    scenario = load_scenario(write(tmp_path / 'a.yaml', 'gondola: {mass: 400.0}\n'))
    assert scenario.gondola.mass == 400.0 and scenario.gondola.cable_length == 30.0


@pytest.mark.parametrize(('text', 'reason'), [
    ('gondola: {weight: 400.0}', 'weight'), ('weather: {rain: 1.0}', 'weather'),
    ('wind: {mean_speed: fast}', "mean_speed = 'fast'"), ('seed: no', 'seed = False'),
    ('mission: {goals: [0.0, 0.25, 0.0]}', 'goals = 0.0'),
    ('- 1', 'rejected'), ('gondola: 5', 'rejected'), ('{', 'rejected')])
def test_file_with_an_error_is_rejected_with_its_name(tmp_path, text, reason):
    with pytest.raises(ParameterError, match=reason):
        load_scenario(write(tmp_path / 'a.yaml', text))


def test_unknown_scenario_is_rejected_with_the_known_names():
    with pytest.raises(ParameterError, match=r'gale rejected: .* gusts'):
        load_scenario('gale')


def test_goals_of_a_mission_are_repeated():
    mission = load_scenario('pressing').mission
    assert mission.goal(0.0) == mission.goal(14.0) == Pose(-0.1, 0.22, 0.0)
    assert mission.goal(7.0) == Pose(0.1, 0.22, 0.0)


def test_recording_moves_the_gondola_of_a_scenario(tmp_path):
    times = np.arange(0.0, 10.0, 0.05)
    table = np.column_stack([times, 0.1 * np.sin(times), 0.02 * np.cos(times), 0.03 * times])
    write(tmp_path / 'sway.csv', HEADER + '\n'.join(
        ','.join(map(str, row)) for row in table))
    scenario = load_scenario(write(tmp_path / 'a.yaml', 'motion: {recording: sway.csv}'))
    motion = prescribed_motion(scenario.motion)
    for time in (0.5, 3.33, 9.0):
        expected = (0.1 * math.sin(time), 0.02 * math.cos(time), 0.03 * time)
        assert motion(time) == pytest.approx(expected, abs=1e-5)
    end = times[-1]
    assert motion(end + 1.0) == pytest.approx(motion(end - 1.0))


@pytest.mark.filterwarnings('ignore:loadtxt')
@pytest.mark.parametrize('rows', ['', '0,0,0,0\n', '0,0,0,0\n0,0,0,0\n', '0,0\n1,1\n'])
def test_recording_without_ascending_rows_is_rejected(tmp_path, rows):
    path = tmp_path / 'sway.csv'
    write(path, HEADER + rows)
    with pytest.raises(ParameterError, match='rejected'):
        recorded_motion(path)
