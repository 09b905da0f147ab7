"""Parameters of the nodes: described, read-only unless marked live, unknown names rejected."""

from contextlib import nullcontext
import math
from pathlib import Path
import re

from nodes.node_rig import LoopThread, NODES, parameters_of
import pytest
from rclpy.parameter import Parameter
from support import wait_until

from facade_manipulator import config_path
from facade_manipulator.errors import ParameterError, SingularityError
from facade_manipulator.kinematics import Pose
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.nodes import run
from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.nodes.node_parameters import reject_unknown_parameters
from facade_manipulator.tools.parameter_files import read_machine

PAIR = ('compensator', 'ik_service')  # nodes of the process `manipulator`
DRIVER = '/**/driver: {ros__parameters: {%s}}'


@pytest.fixture
def arguments(tmp_path):
    """Write a parameter file; return the arguments of ROS with it."""

    def written(content):
        file = tmp_path / 'parameters.yaml'
        file.write_text(content)
        return ['--ros-args', '--params-file', str(file)]

    return written


@pytest.mark.parametrize(
    'content, argument, message',
    [
        (DRIVER % 'limits: {speed: 0.3}, use_sim_time: false', '', ''),
        ('driver: {ros__parameters: {limits.speed: 0.3}}', 'limits.speed:=0.3', ''),
        (
            '/*/driver: {ros__parameters: {qos_overrides: {/tf: {publisher: {depth: 3}}}}}',
            '',
            '',
        ),
        (
            '/**: {ros__parameters: {geometry: {link_length: 0.3}}}',
            'geometry.link_length:=3e-1',
            '',
        ),
        # the other process checks this section
        ('/**/compensator: {ros__parameters: {whatever: 3}}', '', ''),
        (
            '/**: {ros__parameters: {weather: fine}}',
            '',
            "log: .* no parameter 'weather'",
        ),
        (
            DRIVER % 'limits: {sped: 0.3}',
            '',
            "no parameter 'limits.sped', which is similar to 'limits.speed'; next: ",
        ),
        (
            '/**/ik_service: {ros__parameters: {rate: 1.0}}',
            '',
            "ik_service has no parameter 'rate'",
        ),
        (
            '/**: {ros__parameters: {geometry: {link_lenght: 0.3}}}',
            '',
            "no parameter 'geometry.link_lenght', which is similar to "
            "'geometry.link_length'; next: ",
        ),
        ('/**/drivr: {ros__parameters: {rate: 1.0}}', '', "no node is called 'drivr'"),
        ('{}', 'nonsense:=1', "no parameter 'nonsense'"),
        ('{}', 'ik_service:rate:=1', "no parameter 'rate'"),
        ('{}', 'drivr:rate:=1', "no node is called 'drivr'"),
        (
            '/**: {ros__parameters: {geometry: {link_length: 0.4}}}\n'  # -p overrides it
            f'{DRIVER}' % 'limits.speed: 0.3',
            'limits.speed:=0.2',
            ' has no effect on driver',
        ),
        (
            DRIVER % 'limits.speed: 0.3',
            'driver:limits.speed:=0.2',
            ' has no effect on driver',
        ),
        (
            'driver: {ros__parameters: {limits.speed: 0.3}}',
            'driver:limits.speed:=0.3',
            'not apply to /gondola_1/driver; next: rename it to /**/driver',
        ),
    ],
)
def test_unknown_or_ineffective_parameter_is_rejected_with_nearest_name(
    ros, arguments, capfd, content, argument, message
):
    args = arguments(content)
    if argument:
        args += ['-p', argument]
    # which is the driver if there is no name
    namespace = '/gondola_1' * argument.startswith('driver:')
    driver = ros.node('driver', namespace=namespace, cli_args=args)
    ik_service = ros.node('ik_service', namespace=namespace, cli_args=args)
    for name in ('limits.speed', 'limits.jerk', 'rate'):
        driver.declare_parameter(name, 1.0)
    ik_service.declare_parameter('geometry.link_length', 1.0)
    try:
        reject_unknown_parameters([driver, ik_service], args)
    except ParameterError as error:
        assert message
        assert 'log: ' not in message
        assert message in str(error)
    else:
        assert re.search(message.removeprefix('log: '), capfd.readouterr().err)


def test_name_of_another_process_is_accepted_for_all_nodes(ros, arguments, capfd):
    args = arguments('/**: {ros__parameters: {horizon: 0.05, contact.force: 20.0}}')
    node = ros.add(NODES['ik_service'](cli_args=args))
    reject_unknown_parameters([node], args)
    assert 'horizon' not in capfd.readouterr().err


def test_wrong_value_of_another_process_ends_no_node(ros, arguments):
    args = arguments(
        '/**: {ros__parameters: {limits.jerk: 100.0}}\n'
        '/**/driver: {ros__parameters: {limits.speed: -1.0}}\n'
    )
    node = ros.add(NODES['ik_service'](cli_args=args))
    reject_unknown_parameters([node], args)


@pytest.mark.parametrize(
    'argument, is_rejected',
    [('horizon:=0.05', False), ('limits.speed:=0.3', True), ('nonsense:=1', True)],
)
def test_argument_for_all_nodes_needs_one_node_in_process(ros, argument, is_rejected):
    args = ['--ros-args', '-p', argument]
    nodes = [ros.add(NODES[name](cli_args=args)) for name in PAIR]
    with pytest.raises(ParameterError) if is_rejected else nullcontext():
        reject_unknown_parameters(nodes, args)


def test_two_values_of_one_parameter_are_rejected(ros, arguments):
    args = arguments('/**/compensator: {ros__parameters: {geometry.link_length: 0.36}}')
    nodes = [ros.add(NODES[name](cli_args=args)) for name in PAIR]
    with pytest.raises(ParameterError) as error:
        reject_unknown_parameters(nodes, args)
    assert str(error.value) == (
        'geometry.link_length rejected: 0.36 of compensator differs from 0.352 of ik_service; '
        'next: set it in section /** for all nodes'
    )


STALE = DRIVER % 'stream.stale_after: 0.1'


@pytest.mark.parametrize(
    'node, rate, section, message',
    [
        ('compensator', 20.0, STALE, ''),
        (
            'compensator',
            12.5,
            STALE,
            'rate of compensator = 12.5 Hz is below 2 / stream.stale_after = 20 Hz; next: set '
            'at least 20 Hz, or stream.stale_after to at least 0.16 s',
        ),
        ('driver', 12.5, STALE, 'rate of compensator = 12.5 Hz is below'),
        # a process with neither of both nodes, a value that is not known, and a wrong value that
        # the process of the compensator reports
        ('ik_service', 12.5, STALE, ''),
        ('compensator', 12.5, '', ''),
        ('driver', 1.0, STALE, ''),
    ],
)
def test_compensator_slower_than_the_stale_stream_is_rejected(
    ros, arguments, node, rate, section, message
):
    args = arguments(
        f'/**/compensator: {{ros__parameters: {{rate: {rate}}}}}\n{section}'
    )
    nodes = [ros.add(NODES[node](cli_args=args))]
    if not message:
        reject_unknown_parameters(nodes, args)
        return
    with pytest.raises(ParameterError, match=re.escape(message)):
        reject_unknown_parameters(nodes, args)


def test_two_values_of_a_parameter_of_ros_are_accepted(ros, arguments):
    """Each node publishes its own type descriptions, for which the others do not matter."""
    service = 'start_type_description_service'
    args = arguments(f'/**/compensator: {{ros__parameters: {{{service}: false}}}}')
    nodes = [ros.add(NODES[name](cli_args=args)) for name in PAIR]
    assert [node.get_parameter(service).value for node in nodes] == [False, True]
    reject_unknown_parameters(nodes, args)


@pytest.mark.parametrize('section', ['/**', '/**/ik_service'])
@pytest.mark.parametrize(
    'former, present',
    [
        ('approach.speed: [0.1, 0.1, 0.1]', 'reference.speed'),
        ('min_conditioning: 0.1', 'reference.min_conditioning'),
    ],
)
def test_former_name_is_rejected_with_the_present_name(
    ros, arguments, section, former, present
):
    args = arguments(f'{section}: {{ros__parameters: {{{former}}}}}')
    node = ros.add(NODES['ik_service'](cli_args=args))
    step = f'next: write {present} in section /'
    with pytest.raises(ParameterError, match=step):
        reject_unknown_parameters([node], args)
    with pytest.raises(ParameterError, match=step):
        read_machine([Path(args[-1])], 'ik_service')


def test_pose_is_certified_alike_by_both_nodes(ros):
    overrides = [Parameter('reference.min_conditioning', value=0.4)]
    compensator, ik_service = (
        ros.add(NODES[name](parameter_overrides=overrides)) for name in PAIR
    )
    pose = Pose(0.0, 0.25, 0.0)
    for certify in (compensator._compensator.set_goal, ik_service._stream.certify):
        with pytest.raises(SingularityError, match='reference.min_conditioning'):
            certify(pose)


@pytest.mark.parametrize('name', NODES)
def test_shipped_parameter_file_starts_every_node(ros, name):
    args = ['--ros-args', '--params-file', str(config_path('manipulator.yaml'))]
    node = ros.add(NODES[name](cli_args=args))
    reject_unknown_parameters([node], args)


@pytest.mark.parametrize(
    'node, argument, message',
    [
        ('driver', 'nonsense:=1', "no parameter 'nonsense'"),
        (
            'driver',
            'limits.speed:=-1.0',
            'limits.speed = -1 m/s is below its minimum 0.001 m/s; next: set at least 0.001 m/s\n',
        ),
        ('driver', 'controller.rate:=300', 'controller.rate = 300 Hz'),
        (
            'driver',
            'controller.rate:=10',
            'controller.rate = 10 Hz is below 2 / stream.stale_after = 20 Hz; next: set at least '
            '20 Hz, or stream.stale_after to at least 0.2 s',
        ),
        (
            'driver',
            'axes.max_speed:=0.3',
            'limits.speed = 0.5 m/s is above axes.max_speed',
        ),
        (
            'ik_service',
            'use_sim_time:=true',
            'use_sim_time rejected: it is true and must be false',
        ),
        ('ik_service', '/nowhere.yaml', 'nowhere.yaml'),
    ],
)
def test_wrong_parameter_ends_start_with_status_2(
    ros_domain, handlers, capfd, node, argument, message
):
    option = '--params-file' if argument.endswith('.yaml') else '-p'
    arguments = ['--ros-args', option, argument]
    assert run.run(lambda: [NODES[node]()], arguments) == 2
    printed = capfd.readouterr().err
    assert re.search(f'could not start: .*{re.escape(message)}', printed)
    assert 'Traceback' not in printed


def test_live_limit_is_described_checked_and_applied(ros, capfd):
    started = []

    def launch(*ends):
        started.append(LoopThread(*ends))
        return started[0]

    driver = ros.add(DriverNode(launch))
    descriptor = driver.describe_parameter('limits.speed')
    assert descriptor.description.endswith(' [m/s]')
    assert not descriptor.read_only
    assert descriptor.additional_constraints == '0.001 to 5 m/s'
    for name, value, message in (
        (
            'limits.speed',
            0.61,
            'limits.speed = 0.61 m/s is above axes.max_speed = 0.6 m/s',
        ),
        ('limits.jerk', 1.0, 'jerk = 1 m/s^3 is below acceleration = 3 m/s^2'),
        ('limits.speed', 'much', 'expected'),
        ('controller.rate', 200, 'read-only'),
    ):
        before = driver.get_parameter(name).value
        (result,) = driver.set_parameters([Parameter(name, value=value)])
        assert not result.successful
        assert message in result.reason
        assert driver.get_parameter(name).value == before
    changes = {'limits.speed': 0.1, 'limits.acceleration': 0.2}
    result = driver.set_parameters_atomically(parameters_of(changes))
    assert result.successful
    assert (
        capfd.readouterr().err.count('limits of motion changed to 0.1 m/s, 0.2 m/s^2, ')
        == 1
    )
    follower = started[0].loop.follower
    wait_until(
        lambda: follower._limiter.limits == MotionLimits(0.1, 0.2), 'the new limits'
    )


def test_live_contact_force_and_arrival_reach_the_compensator(ros):
    node = ros.add(CompensatorNode())
    changes = {'contact.force': 20.0, 'arrival.distance': 0.01, 'lateral.enabled': True}
    results = node.set_parameters(parameters_of(changes))
    assert [result.reason for result in results] == [''] * len(changes)
    assert node._compensator.contact.pressing.settings.force == 20.0
    assert node._goals.settings.distance == 0.01


@pytest.mark.parametrize('name', NODES)
def test_each_live_number_is_checked_in_its_node(ros, name):
    """A live parameter without `accept_changes` would be accepted, and would change nothing."""
    node = ros.add(NODES[name]())
    for parameter in node.list_parameters([], 0).names:
        is_number = isinstance(node.get_parameter(parameter).value, float)
        if is_number and not node.describe_parameter(parameter).read_only:
            (result,) = node.set_parameters([Parameter(parameter, value=math.nan)])
            assert not result.successful, parameter


@pytest.mark.parametrize('name', ['distances', 'fixes', 'poses', 'wall.levels'])
@pytest.mark.parametrize('form', ['file', 'argument'])
def test_empty_array_is_an_array(ros, tmp_path, name, form):
    file = tmp_path / 'own.yaml'
    file.write_text(f'/**/disturbance_estimator: {{ros__parameters: {{{name}: []}}}}\n')
    given = {'file': ['--params-file', str(file)], 'argument': ['-p', f'{name}:=[]']}
    arguments = ['--ros-args', *given[form]]
    node = ros.add(NODES['disturbance_estimator'](cli_args=arguments))
    assert list(node.get_parameter(name).value) == []
    reject_unknown_parameters([node], arguments)
