"""What a parameter file gives the nodes is looked at as they do when they start."""

from __future__ import annotations

from every_node import NODES
import pytest

from facade_manipulator import config_path
from facade_manipulator.nodes.parameter_files import complaints, examine
from facade_manipulator.parameter_file import OF_ROS


@pytest.mark.quick
def test_the_parameters_of_each_node_are_known_and_no_others(ros):
    for node, given in examine([]).items():
        declared = ros.add(NODES[node]()).list_parameters([], 0).names
        assert given.known == {name for name in declared if not name.startswith(OF_ROS)}


@pytest.mark.parametrize('files', [
    (), ('manipulator.yaml',), ('manipulator.yaml', 'simulation.yaml')])
def test_of_the_files_of_the_package_nothing_is_said(files):
    paths = [config_path(file) for file in files]
    assert complaints(paths, examine(paths)) == []


@pytest.mark.parametrize('section, content, wrong', [
    ('driver', 'limits: {nonsense: 1.0}', "driver has no parameter 'limits.nonsense'"),
    ('driver', 'q1.home_positon: 0.1', "did you mean 'q1.home_position'?"),
    ('compensator', 'horizn: 0.1', "'horizn' (in machine.yaml): did you mean 'horizon'?"),
    ('disturbance_estimator', 'range_3: {noise: 0.1}', "'range_3.noise'"),
    ('**', 'weather: fine', "no parameter 'weather' (in machine.yaml)"),
    ('**', 'geometry: {link_lenght: 0.3}', "did you mean 'geometry.link_length'?"),
    ('driver', 'limits: {speed: 0.61}', 'limits.speed = 0.61 m/s is above q1.max_speed'),
    ('**', 'geometry: {stroke: 5.0}', 'driver, compensator, ik_service: geometry.stroke = 5.0'),
    ('driver', 'limits: {speed: -1.0}', 'limits.speed = -1 m/s is below its minimum'),
    ('driver', 'controller: {rate: 100.0}', 'controller.rate = 100.0, expected an integer'),
    ('driver', 'software_stop_topics: [1]', 'software_stop_topics = 1, expected a string'),
    ('recorder', 'folder: 5', 'recorder: folder = 5, expected a string'),
    ('ik_service', 'workspace: {resolution: fine}', "resolution = 'fine', expected a double"),
    ('compensator', 'geometry.carriage_gap: 0.27, workspace_limit.margin: 0.1',
     'leaves no workspace'),
    ('disturbance_estimator', 'rate: true, imu: {delay: 0.01}', 'rate = True, expected a double'),
    ('driver', 'q1: {max_speed: 1, lead: 0.01}, limits.speed: 0.61', 'q1.max_speed = 1 is'),
    ('driver', 'geometry.stroke: [-0.05, 5.0], q1.lead: 0.01', 'q1.home_position = -0.1 m'),
])
def test_what_a_node_would_not_start_with_is_named_once(tmp_path, section, content, wrong):
    path = tmp_path / 'machine.yaml'
    path.write_text(f'/**/{section}: {{ros__parameters: {{{content}}}}}')
    found, = complaints([path], examine([path]))
    assert wrong in found
