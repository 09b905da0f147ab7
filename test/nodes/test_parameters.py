"""Parameters of the nodes: described, read-only unless marked live, unknown names rejected."""

from __future__ import annotations

import re

from every_node import NODES
import pytest
from rclpy.parameter import Parameter
from support import wait_until

from facade_manipulator import config_path
from facade_manipulator.errors import ParameterError
from facade_manipulator.nodes import run
from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.nodes.parameters import declare, OF_ROS, reject_unknown_parameters
from facade_manipulator.parameters import parameter, settings

pytestmark = pytest.mark.quick


@settings
class Sample:
    """Settings with live and read-only parameters."""

    low: float = parameter(
        'Lower bound', default=0.1, unit='m', minimum=0.0, maximum=1.0, live=True)
    high: float = parameter(
        'Upper bound', default=0.9, unit='m', minimum=0.0, maximum=1.0, live=True)
    count: int = parameter('Number of samples', default=3, minimum=1, maximum=9)

    def __post_init__(self) -> None:
        if self.low >= self.high:
            raise ParameterError(f'low = {self.low:g} m is not below high = {self.high:g} m')


def test_declared_parameter_has_description_unit_and_range(ros):
    node = ros.node('node')
    assert declare(node, Sample, 'sample', low=0.5) == Sample(low=0.5)
    descriptor = node.describe_parameter('sample.low')
    assert descriptor.description == 'Lower bound [m]'
    assert descriptor.additional_constraints == '0 to 1 m'
    assert not descriptor.read_only and node.describe_parameter('sample.count').read_only


def test_live_change_is_handed_on_once_and_complete(ros):
    node, received = ros.node('node'), []
    declare(node, Sample, '', received.append)
    result = node.set_parameters_atomically(
        [Parameter('low', value=0.3), Parameter('high', value=0.4)])
    assert result.successful
    assert received == [Sample(low=0.3, high=0.4)]


@pytest.mark.parametrize('name, value, message', [
    ('low', 0.95, 'low = 0.95 m is not below high = 0.9 m'),
    ('low', 2.0, 'low = 2 m is above its maximum 1 m'),
    ('low', float('nan'), 'low = nan is not a finite number'),
    ('low', 'much', 'expected'), ('count', 4, 'read-only'),
])
def test_wrong_live_change_is_rejected_and_changes_nothing(ros, name, value, message):
    node, received = ros.node('node'), []
    declare(node, Sample, '', received.append)
    before = node.get_parameter(name).value
    result = node.set_parameters([Parameter(name, value=value)])[0]
    assert not result.successful and message in result.reason
    assert node.get_parameter(name).value == before and received == []


@pytest.mark.parametrize('override', [
    Parameter('low', value='much'), Parameter('low', value=7.0), Parameter('high', value=0.05),
    Parameter('low', value=1)])
def test_wrong_value_at_start_is_rejected(ros, override):
    node = ros.node('node', parameter_overrides=[override])
    with pytest.raises(ParameterError, match='low|high'):
        declare(node, Sample)


# --- unknown names


@pytest.fixture
def check(ros, tmp_path):
    """Return a function that starts two nodes with a parameter file and arguments."""
    def start(content: str = '', *arguments: str, namespace: str = ''):
        file = tmp_path / 'parameters.yaml'
        file.write_text(content or '{}')
        args = ['--ros-args', '--params-file', str(file), *arguments]
        driver, ik = (ros.node(name, namespace=namespace, cli_args=args)
                      for name in ('driver', 'ik_service'))
        for name in ('limits.speed', 'limits.jerk', 'rate'):
            driver.declare_parameter(name, 1.0)
        ik.declare_parameter('geometry.link_length', 1.0)
        reject_unknown_parameters([driver, ik], args)

    return start


@pytest.mark.parametrize('content', [
    '/**/driver: {ros__parameters: {limits: {speed: 0.3}, use_sim_time: false}}',
    'driver: {ros__parameters: {limits.speed: 0.3, start_type_description_service: false}}',
    '/*/driver: {ros__parameters: {qos_overrides: {/tf: {publisher: {depth: 3}}}}}',
    '/**: {ros__parameters: {geometry: {link_length: 0.3}, use_sim_time: true}}',
    '/**/compensator: {ros__parameters: {whatever: 3}}',  # its own process checks it
])
def test_known_parameters_are_accepted(check, content):
    check(content)


@pytest.mark.parametrize('content, message', [
    ('/**/driver: {ros__parameters: {limits: {sped: 0.3}}}',
     "no parameter 'limits.sped': did you mean 'limits.speed'?"),
    ('driver: {ros__parameters: {nonsense: 1}}', "no parameter 'nonsense'"),
    ('/**/ik_service: {ros__parameters: {rate: 1.0}}', "ik_service has no parameter 'rate'"),
    ('/**: {ros__parameters: {geometry: {link_lenght: 0.3}}}',
     "no parameter 'geometry.link_lenght': did you mean 'geometry.link_length'?"),
    ('/**/drivr: {ros__parameters: {rate: 1.0}}', "no node is called 'drivr'"),
    ('/**/manipulator: {ros__parameters: {rate: 1.0}}', "no node is called 'manipulator'"),
])
def test_unknown_parameter_is_rejected_with_nearest_known_name(check, content, message):
    with pytest.raises(ParameterError, match=re.escape(message)):
        check(content)


def test_unknown_parameter_for_all_nodes_is_logged(check, capfd):
    check('/**: {ros__parameters: {weather: fine}}')
    assert "no parameter 'weather'" in capfd.readouterr().err


@pytest.mark.parametrize('argument', [
    'rate:=2.0', 'driver:limits.speed:=1.0', 'geometry.link_length:=3e-1'])
def test_known_argument_is_accepted(check, argument):
    check('', '-p', argument)


@pytest.mark.parametrize('argument, message', [
    ('nonsense:=1', "no parameter 'nonsense'"),
    ('limits.sped:=1', "did you mean 'limits.speed'?"),
    ('ik_service:rate:=1', "no parameter 'rate'"),
    ('drivr:rate:=1', "no node is called 'drivr'"),
])
def test_unknown_argument_is_rejected(check, argument, message):
    with pytest.raises(ParameterError, match=re.escape(message)):
        check('', '-p', argument)


@pytest.mark.parametrize('section, argument, namespace', [
    ('/**/driver', 'limits.speed:=0.2', ''), ('driver', 'limits.speed:=0.2', ''),
    ('/**/driver', 'driver:limits.speed:=0.2', '/gondola_1')])
def test_argument_without_effect_is_rejected(check, section, argument, namespace):
    content = ('/**: {ros__parameters: {geometry: {link_length: 0.4}}}\n'  # -p has its priority
               f'{section}: {{ros__parameters: {{limits: {{speed: 0.3}}}}}}')
    check(content, '-p', 'limits.speed:=0.3')
    with pytest.raises(ParameterError, match='limits.speed.* has no effect on driver'):
        check(content, '-p', argument, namespace=namespace)


# --- the nodes of the package


@pytest.mark.parametrize('name', NODES)
def test_shipped_parameter_file_starts_every_node(ros, name):
    args = ['--ros-args', '--params-file', str(config_path('manipulator.yaml'))]
    node = ros.add(NODES[name](cli_args=args))
    reject_unknown_parameters([node], args)
    for parameter_name in node.list_parameters([], 0).names:
        if not parameter_name.startswith(OF_ROS):
            assert len(node.describe_parameter(parameter_name).description) > 8


@pytest.mark.parametrize('node, arguments, message', [
    ('driver', ('-p', 'nonsense:=1'), "no parameter 'nonsense'"),
    ('driver', ('-p', 'limits.speed:=-1.0'),
     'could not start: limits.speed = -1 m/s is below its minimum 0.001 m/s\n'),
    ('driver', ('-p', 'limits.speed:=1'),
     'could not start: limits.speed = 1 is an integer, expected a double; next: write 1.0\n'),
    ('driver', ('-p', 'controller.rate:=300'), 'could not start: controller: rate = 300 Hz'),
    ('compensator', ('-p', 'reference.speed:=[1.0, 2.0]'),
     'could not start: reference.speed has 2 elements, expected 3'),
    ('ik_service', ('-p', 'geometry.link_lenght:=0.3'), "'geometry.link_length'"),
])
def test_wrong_parameter_ends_start_with_status_2(
        ros_domain, handlers, capfd, node, arguments, message):
    assert run.run(lambda: [NODES[node]()], ['--ros-args', *arguments]) == 2
    printed = capfd.readouterr().err
    assert message in printed and 'Traceback' not in printed


@pytest.mark.parametrize('content', [None, '/**: {ros__parameters: [1, 2'])
def test_unreadable_parameter_file_ends_start_with_status_2(
        ros_domain, handlers, tmp_path, capfd, content):
    file = tmp_path / 'nowhere.yaml'
    if content is not None:
        file.write_text(content)
    assert run.run(pytest.fail, ['--ros-args', '--params-file', str(file)]) == 2
    printed = capfd.readouterr().err
    assert 'could not start' in printed and 'Traceback' not in printed


def test_limits_beyond_those_of_the_drives_are_rejected(ros):
    driver = ros.add(DriverNode())
    for name, value, message in (
            ('limits.speed', 0.61, 'limits.speed = 0.61 m/s is above axes.max_speed = 0.6 m/s'),
            ('limits.jerk', 1.0, 'jerk = 1 m/s^3 is below acceleration = 3 m/s^2'),
            ('controller.rate', 200, 'read-only')):
        result = driver.set_parameters([Parameter(name, value=value)])[0]
        assert not result.successful and message in result.reason
    with pytest.raises(ParameterError, match='limits.speed = 0.5 m/s is above axes.max_speed'):
        DriverNode(parameter_overrides=[Parameter('axes.max_speed', value=0.3)])


def test_live_limit_reaches_the_control_loop(ros):
    driver = ros.add(NODES['driver']())
    assert driver.set_parameters([Parameter('limits.speed', value=0.1)])[0].successful
    follower = driver._loop._process.loop.follower
    wait_until(lambda: follower._limiter.limits.speed == 0.1, 'the limit in the loop')


def test_live_contact_force_and_arrival_reach_the_compensator(ros):
    node = ros.add(CompensatorNode())
    changes = {'contact.force': 20.0, 'arrival.distance': 0.01, 'lateral.enabled': True}
    results = node.set_parameters(
        [Parameter(name, value=value) for name, value in changes.items()])
    assert [result.reason for result in results] == [''] * len(changes)
    assert node._compensator.contact.pressing.settings.force == 20.0
    assert node._progress.watch.settings.distance == 0.01
