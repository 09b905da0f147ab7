"""Scenarios: every file that comes with the package, and files that are no scenario."""

import math

import pytest

from facade_manipulator.compensation.compensator import Compensator
from facade_manipulator.compensation.suspension import SuspensionSettings
from facade_manipulator.errors import ManipulatorError, ParameterError
from facade_manipulator.kinematics import certify, Geometry, Pose
from facade_manipulator.lab.gondola.scenario import (
    compensator_parameters,
    load_scenario,
    make_scenario,
    read_sections,
    Scenario,
    scenario_names,
)

WANTED = {'calm', 'breeze', 'gusty', 'storm', 'window_frames', 'estimator_lost', 'high_cable',
          'resonance'}


def test_the_scenarios_that_were_asked_for_are_there():
    assert set(scenario_names()) >= WANTED


@pytest.mark.parametrize('name', scenario_names())
def test_every_scenario_can_be_run(name):
    scenario = load_scenario(name)
    assert scenario.mission.description
    motion = scenario.motion()
    for time in (0.0, 0.5, 20.0):
        assert all(map(math.isfinite, motion(time)))
    Compensator(Geometry(), scenario.compensator)
    for k in range(len(scenario.mission.goals) // 3):
        certify(Geometry(), scenario.mission.goal(k * scenario.mission.goal_period))


def test_the_breeze_is_the_default_wind():
    assert load_scenario('breeze').motion()(7.0) == pytest.approx(
        tuple(Scenario().motion()(7.0)), abs=1e-5)


def test_goals_come_one_after_the_other_and_again():
    mission = make_scenario(
        {'mission': {'goals': [0.0, 0.25, 0.0, 0.1, 0.25, 0.0], 'goal_period': 5}}).mission
    assert [mission.goal(t).x for t in (0.0, 4.9, 5.0, 10.0)] == [0.0, 0.0, 0.1, 0.0]
    assert mission.goal(0.0) == Pose(0.0, 0.25, 0.0)


def test_the_compensator_is_set_by_its_sections():
    scenario = make_scenario({'compensator': {'impedance': {'enabled': True, 'force': 20}}})
    assert scenario.compensator.impedance.enabled
    assert scenario.compensator.impedance.force == 20.0


def test_where_there_is_a_wall_the_compensator_knows_how_the_gondola_hangs():
    gondola = {'mass': 400.0, 'cable_length': 20.0}
    wall = {'facade': {'present': True}, 'gondola': gondola}
    known = make_scenario(wall).compensator.suspension
    assert (known.mass, known.cable_length, known.guide_lever) == (400.0, 20.0, 0.6)
    assert make_scenario({'gondola': gondola}).compensator.suspension == SuspensionSettings()
    unknown = make_scenario({**wall, 'compensator': {'suspension': {'mass': 0.0}}})
    assert unknown.compensator.suspension == SuspensionSettings()


def test_what_the_compensator_is_asked_for_can_be_given_to_its_node():
    scenario = make_scenario({'compensator': {
        'compensation': {'horizon': 0.05}, 'impedance': {'enabled': True, 'force': 30.0}}})
    assert compensator_parameters(scenario) == {'horizon': 0.05, 'impedance.enabled': True}
    assert compensator_parameters(Scenario()) == {}


@pytest.mark.parametrize(('sections', 'message'), [
    ({'wind': {'mean_speed': -1.0}}, 'mean_speed'),
    ({'wind': {'speed': 1.0}}, 'wind has no setting speed'),
    ({'wind': {'mean_speed': 'strong'}}, 'expected float'),
    ({'wind': 3.0}, 'wind is not a section'),
    ({'sway': {'x_amplitude': 0.1}}, 'not a list'),
    ({'compensator': {'impedance': {'strength': 1.0}}}, 'compensator.impedance has no setting'),
    ({'compensator': {'hope': {}}}, 'compensator.hope is not a section'),
    ({'mission': {'goals': [1.0, 2.0]}}, 'goals has 2'),
    ({'mission': {'motion': 'ghost'}}, 'ghost'),
])
def test_sections_that_make_no_sense_are_rejected(sections, message):
    with pytest.raises(ParameterError, match=message):
        make_scenario(sections)


@pytest.mark.parametrize(('text', 'message'), [
    ('ghosts: {}', 'unknown sections: ghosts'), ('- 1', 'not a mapping'),
    ('a: [', 'cannot be read')])
def test_files_that_are_no_scenario_are_rejected(tmp_path, text, message):
    path = tmp_path / 'scenario.yaml'
    path.write_text(text)
    with pytest.raises(ParameterError, match=message):
        read_sections(path)


def test_a_scenario_that_is_not_there_is_rejected_and_the_known_ones_are_told():
    with pytest.raises(ParameterError, match='breeze, burst, calm'):
        load_scenario('tornado')


@pytest.mark.parametrize(('name', 'sound'), [('mine', False), ('mine_without_reaction', True)])
def test_only_a_scenario_that_says_so_has_a_gondola_that_does_not_feel_the_head(
        tmp_path, name, sound):
    path = tmp_path / f'{name}.yaml'
    path.write_text('gondola: {reaction: false}')
    if sound:
        assert not load_scenario(str(path)).gondola.reaction
    else:
        with pytest.raises(ParameterError, match='without_reaction'):
            load_scenario(str(path))


RECORDED = 'time,x,y,theta\n0,0,0,0\n1,0.1,0,0\n2,0.1,0,0\n3,0.1,0,0\n'


def recorded_scenario(folder, recording):
    path = folder / 'mine.yaml'
    path.write_text(f'mission: {{motion: recording, recording: {recording}}}')
    return load_scenario(str(path))


def test_a_recording_is_found_beside_its_scenario_or_by_its_whole_path(tmp_path):
    (tmp_path / 'wind.csv').write_text(RECORDED)
    for recording in ('wind.csv', tmp_path / 'wind.csv'):
        motion = recorded_scenario(tmp_path, recording).motion()
        assert motion(1.5).x == pytest.approx(0.1, abs=1e-3)


def test_a_recording_that_is_not_there_is_rejected_by_its_path(tmp_path):
    with pytest.raises(ManipulatorError, match=f'{tmp_path}/calm.csv cannot be read'):
        recorded_scenario(tmp_path, 'calm.csv').motion()
