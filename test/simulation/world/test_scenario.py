"""Scenario files, read or rejected with a reason."""

import json

import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Pose
from facade_manipulator.package_files import config_path
from facade_manipulator.parameters import read_parameters
from facade_manipulator.simulation.world.scenario import (
    load_scenario,
    simulation_parameters,
)


def write(path, text):
    path.write_text(text)
    return str(path)


def test_missing_scenario_values_have_defaults(tmp_path):
    scenario = load_scenario(
        write(tmp_path / 'a.yaml', 'gondola: {guide_lever: 0.4}\n')
    )
    assert scenario.gondola.guide_lever == 0.4
    assert scenario.gondola.cable_length == 30.0


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('gondola: {weight: 400.0}', 'weight'),
        ('weather: {rain: 1.0}', 'weather'),
        ('wind: {mean_speed: fast}', "mean_speed = 'fast'"),
        ('seed: no', 'seed = False'),
        ('mission: {goals: [0.0, 0.25, 0.0]}', 'goals = 0.0'),
        ('mission: {goals: []}', 'goals is empty'),
        ('mission: {goals: [[0.1]]}', r'goals = \[0.1\], expected three numbers'),
        ('motion: {x: [0.1]}', 'x = 0.1, expected three numbers'),
        ('- 1', 'rejected'),
        ('gondola: 5', 'rejected'),
        ('{', 'rejected'),
    ],
)
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


def test_parameters_of_a_scenario_override_other_files(tmp_path):
    file = tmp_path / 'simulation.yaml'
    file.write_text(json.dumps(simulation_parameters('pressing', viewer=True)))
    files = [config_path('manipulator.yaml'), config_path('simulation.yaml'), file]
    contact = read_parameters(files, 'compensator')
    assert contact['contact.enabled']
    assert contact['contact.force'] == 30.0
    simulator = read_parameters(files, 'gondola_simulator')
    assert simulator['scenario'] == 'pressing'
    assert simulator['viewer']


def test_viewer_alone_keeps_the_scenario_of_other_files():
    sections = simulation_parameters(viewer=True)
    assert sections['/**/gondola_simulator'] == {'ros__parameters': {'viewer': True}}
    assert sections['/**/compensator'] == {'ros__parameters': {}}
