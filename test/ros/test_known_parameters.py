"""What a user's parameters say is either used or named: nothing given is ignored in silence."""

from __future__ import annotations

from pathlib import Path
import re

from every_node import NODES
import pytest

import facade_manipulator
from facade_manipulator import interfaces
from facade_manipulator.errors import ParameterError
from facade_manipulator.ros import runtime
from facade_manipulator.ros.known_parameters import require_known_parameters

pytestmark = pytest.mark.quick
PACKAGE = Path(facade_manipulator.__file__).parent


@pytest.fixture
def nodes(ros):
    """Return two nodes of one process, as those of `manipulator` are."""
    first, second = ros.node('driver'), ros.node('ik_service')
    for name in ('limits.speed', 'limits.jerk', 'rate'):
        first.declare_parameter(name, 1.0)
    second.declare_parameter('geometry.link_length', 1.0)
    return [first, second]


@pytest.fixture
def check(nodes, tmp_path):
    def check(content: str = '', *arguments: str):
        file = tmp_path / 'parameters.yaml'
        file.write_text(content or '{}')
        require_known_parameters(nodes, ['--ros-args', '--params-file', str(file), *arguments])

    return check


@pytest.mark.parametrize('content', [
    '/**/driver: {ros__parameters: {limits: {speed: 0.3}, use_sim_time: false}}',
    'driver: {ros__parameters: {limits.speed: 0.3, start_type_description_service: false}}',
    'gondola_1: {driver: {ros__parameters: {rate: 2.0}}}',
    '/*/driver: {ros__parameters: {qos_overrides: {/tf: {publisher: {depth: 3}}}}}',
    '/**: {ros__parameters: {geometry: {link_length: 0.3}, use_sim_time: true}}',
    '/**/compensator: {ros__parameters: {whatever: 3}}',  # its own process looks at it
])
def test_what_is_known_is_accepted(check, content):
    check(content)


@pytest.mark.parametrize('content, message', [
    ('/**/driver: {ros__parameters: {limits: {sped: 0.3}}}',
     "driver has no parameter 'limits.sped' (in parameters.yaml): did you mean 'limits.speed'?"),
    ('driver: {ros__parameters: {nonsense: 1}}', "driver has no parameter 'nonsense'"),
    ('/gondola_2/driver: {ros__parameters: {limits: {sped: 0.3}}}', "'limits.speed'"),
    ('/**: {ros__parameters: {geometry: {link_lenght: 0.3}}}',
     "no parameter 'geometry.link_lenght' (in parameters.yaml): did you mean "
     "'geometry.link_length'?"),
    ('/**/drivr: {ros__parameters: {rate: 1.0}}',
     "no node is called 'drivr' (in parameters.yaml): did you mean 'driver'?"),
    ('/**/manipulator: {ros__parameters: {rate: 1.0}}', "no node is called 'manipulator'"),
])
def test_what_is_unknown_is_rejected_with_the_nearest_known_name(check, content, message):
    with pytest.raises(ParameterError, match=re.escape(message)):
        check(content)


@pytest.mark.parametrize('section, is_ours', [
    ('/**/driver', True), ('driver', True), ('/gondola_2/driver', False), ('/**', False)])
def test_what_an_argument_gives_in_vain_is_rejected(check, section, is_ours):
    content = f'{section}: {{ros__parameters: {{limits: {{speed: 0.3}}}}}}'
    check(content, '-p', 'limits.jerk:=0.2')
    check(content, '-p', 'limits.speed:=0.3')  # both say the same
    check(content, '-p', 'limits.speed:=3e-1')
    if is_ours:
        with pytest.raises(ParameterError, match=re.escape(
                "'limits.speed' (given by -p) has no effect beside that of driver "
                '(in parameters.yaml)')):
            check(content, '-p', 'limits.speed:=0.2')
    else:
        check(content, '-p', 'limits.speed:=0.2')


def test_an_argument_for_a_node_in_a_namespace_which_ros_does_not_read_is_rejected(ros):
    nodes = [ros.node('driver', namespace='gondola_1')]
    nodes[0].declare_parameter('rate', 1.0)
    require_known_parameters(nodes, ['--ros-args', '-p', 'rate:=2.0'])
    with pytest.raises(ParameterError, match='looks for driver in no namespace'):
        require_known_parameters(nodes, ['--ros-args', '-p', 'driver:rate:=2.0'])


def test_what_all_nodes_are_given_and_others_may_know_is_named_in_the_log(check, capfd):
    check('/**: {ros__parameters: {weather: fine}}')
    assert "no parameter 'weather' (in parameters.yaml)" in capfd.readouterr().err


def test_a_process_without_the_mechanism_leaves_its_parameters_to_those_that_have_it(
        check, nodes, capfd):
    nodes[:] = nodes[:1]
    check('/**: {ros__parameters: {geometry: {link_length: 0.3}}}')
    assert not capfd.readouterr().err


@pytest.mark.parametrize('argument', ['rate:=2.0', 'driver:limits.speed:=1.0',
                                      'ik_service:geometry.link_length:=0.3',
                                      'geometry.link_length:=0.3'])
def test_a_known_argument_is_accepted(check, argument):
    check('', '-p', argument)
    check('', '--param', argument, '--', 'positional', '-p', 'of:=another')


@pytest.mark.parametrize('argument, message', [
    ('nonsense:=1', "no parameter 'nonsense' (given by -p)"),
    ('limits.sped:=1', "did you mean 'limits.speed'?"),
    ('ik_service:rate:=1', "ik_service has no parameter 'rate'"),
    ('drivr:rate:=1', "no node is called 'drivr' (given by -p): did you mean 'driver'?"),
])
def test_an_unknown_argument_is_rejected(check, argument, message):
    with pytest.raises(ParameterError, match=re.escape(message)):
        check('', '-p', argument)


def test_a_node_that_got_another_name_is_known_by_it(ros, check, nodes):
    nodes.append(ros.node('left_driver'))
    check('left_driver: {ros__parameters: {use_sim_time: false}}')


def test_all_nodes_of_the_package_are_known():
    named = {name for path in PACKAGE.rglob('*.py')
             for name in re.findall(r"super\(\).__init__\('(\w+)'", path.read_text())}
    assert named == set(interfaces.NODES)


@pytest.mark.parametrize('node, arguments, message', [
    ('driver', ('-p', 'nonsense:=1'), "no parameter 'nonsense'"),
    ('compensator', ('-r', '__node:=box', '-p', 'compensator:rate:=50.0'),
     "box was started as compensator and renamed: nobody reads 'rate' of compensator (given by "
     '-p)'),
    ('driver', ('-p', 'limits.speed:=-1.0'),
     'could not start: limits.speed = -1 m/s is below its minimum 0.001 m/s\n'),
    ('driver', ('-p', 'limits.speed:=1'),
     'could not start: limits.speed = 1 is an integer, expected a double: write 1.0\n'),
    ('driver', ('-p', 'controller.rate:=300'), 'could not start: controller.rate = 300 Hz'),
    ('compensator', ('-p', 'reference.speed:=[1.0, 2.0]'),
     'could not start: reference.speed has 2 elements, expected 3'),
    ('compensator', ('-p', 'prediction.memory:=1.0'),
     'could not start: prediction.memory = 1 s is below'),
    ('ik_service', ('-p', 'geometry.link_lenght:=0.3'), "'geometry.link_length'"),
])
def test_a_wrong_parameter_ends_the_start_with_one_message_and_status_2(
        ros_domain, handlers, capfd, node, arguments, message):
    assert runtime.run(lambda: [NODES[node]()], ['--ros-args', *arguments]) == 2
    said = capfd.readouterr().err
    assert message in said and 'Traceback' not in said
