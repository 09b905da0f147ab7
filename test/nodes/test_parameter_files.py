"""Parameter files are checked as the nodes do when they start."""

from __future__ import annotations

from every_node import NODES
import pytest
import yaml

from facade_manipulator import config_path
from facade_manipulator.errors import ParameterError
from facade_manipulator.nodes.parameter_files import read_driver
from facade_manipulator.parameter_file import OF_ROS
from facade_manipulator.ros.known_parameters import require_known_parameters


@pytest.mark.quick
@pytest.mark.parametrize('name', NODES)
def test_shipped_parameter_file_starts_every_node(ros, name):
    arguments = ['--ros-args', '--params-file', str(config_path('manipulator.yaml'))]
    node = ros.add(NODES[name](cli_args=arguments))
    require_known_parameters([node], arguments)


@pytest.mark.quick
def test_every_parameter_of_the_driver_is_known_without_ros(ros, tmp_path):
    node = ros.add(NODES['driver']())
    values = {name: node.get_parameter(name).value
              for name in node.list_parameters([], 0).names if not name.startswith(OF_ROS)}
    path = tmp_path / 'machine.yaml'
    path.write_text(yaml.safe_dump({'driver': {'ros__parameters': values}}))
    read_driver([path]).check()


@pytest.mark.parametrize('section, content, wrong', [
    ('driver', 'limits: {nonsense: 1.0}', "driver has no parameter 'limits.nonsense'"),
    ('driver', 'q1.home_positon: 0.1', "did you mean 'q1.home_position'?"),
    ('**', 'geometry: {link_lenght: 0.3}', "did you mean 'geometry.link_length'?"),
    ('driver', 'limits: {speed: -1.0}', 'limits.speed = -1 m/s is below its minimum'),
    ('driver', 'controller: {rate: 100.0}', 'controller.rate = 100.0, expected an integer'),
    ('driver', 'software_stop_topics: [1]', 'software_stop_topics = 1, expected a string'),
])
def test_wrong_parameter_of_the_driver_is_named(tmp_path, section, content, wrong):
    path = tmp_path / 'machine.yaml'
    path.write_text(f'/**/{section}: {{ros__parameters: {{{content}}}}}')
    with pytest.raises(ParameterError) as raised:
        read_driver([path])
    assert wrong in str(raised.value)


@pytest.mark.parametrize('content, wrong', [
    ('limits: {speed: 0.61}', 'limits.speed = 0.61 m/s is above q1.max_speed'),
    ('q1: {max_speed: 1, lead: 0.01}, limits.speed: 0.61', 'q1.max_speed = 1 is'),
    ('geometry.stroke: [-0.05, 5.0], q1.lead: 0.01', 'q1.home_position = -0.1 m'),
])
def test_parameters_that_contradict_each_other_are_named(tmp_path, content, wrong):
    path = tmp_path / 'machine.yaml'
    path.write_text(f'/**/driver: {{ros__parameters: {{{content}}}}}')
    with pytest.raises(ParameterError) as raised:
        read_driver([path]).check()
    assert wrong in str(raised.value)
