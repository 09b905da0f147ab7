"""The parameters of the nodes: described, ranged, live where they may be, the same in the YAML."""

from __future__ import annotations

import math
import re

from every_node import NODES
from hypothesis import given
from hypothesis import strategies as st
import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from support import wait_until

from facade_manipulator.errors import ParameterError
from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.parameters import check_value, ParameterInfo
from facade_manipulator.ros import parameters, runtime

pytestmark = pytest.mark.quick
OF_ROS = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')
MOST_PARAMETERS = 165  # more only for what a user must or may want to set, not for a constant
NUMBERS = ('INTEGER', 'DOUBLE', 'INTEGER_ARRAY', 'DOUBLE_ARRAY')


@pytest.fixture(params=NODES)
def node(ros, request):
    return ros.add(NODES[request.param]())


def own_parameters(node: Node) -> dict:
    names = [name for name in node._parameters if not name.startswith(OF_ROS)]
    return {name: node.describe_parameter(name) for name in names}


def test_every_parameter_is_described_every_number_has_a_range_and_no_live_one_takes_nan(node):
    for name, descriptor in own_parameters(node).items():
        assert len(descriptor.description) > 8, name
        is_number = Parameter.Type(descriptor.type).name in NUMBERS
        assert not is_number or name.endswith('phase') or (  # an angle has none
            descriptor.floating_point_range or descriptor.integer_range
            or descriptor.additional_constraints), name
        if not descriptor.read_only and descriptor.floating_point_range:
            require_rejection(node, name, math.nan)


def require_rejection(node: Node, name: str, value: object, reason: str = '') -> None:
    before = node.get_parameter(name).value
    result = node.set_parameters([Parameter(name, value=value)])[0]
    assert not result.successful and result.reason and reason in result.reason, name
    assert node.get_parameter(name).value == before


def test_the_parameters_that_a_user_meets_do_not_grow_unnoticed(ros):
    """Those of the mechanism count once, though every node has them, and so do the axes'."""
    met = {name if name.startswith('geometry.') else f'{node}: {re.sub("^q[123]", "q", name)}'
           for node, make in NODES.items() for name in own_parameters(ros.add(make()))}
    assert len(met) <= MOST_PARAMETERS


WRONG_CHANGES = {
    'driver': (
        ('limits.speed', 0.61, 'limits.speed = 0.61 m/s is above q1.max_speed = 0.6 m/s'),
        ('limits.acceleration', 6.5,
         'limits.acceleration = 6.5 m/s^2 is above q1.max_acceleration'),
        ('limits.jerk', 1.0, 'jerk = 1 m/s^3 is below limits.acceleration = 3 m/s^2'),
        ('limits.speed', -1.0, 'limits.speed'),
        ('stream.stale_after', 0.5, 'stream.stale_after'),
        ('controller.rate', 200, 'read-only'),
        ('q1.node_id', 7, 'read-only'),
        ('geometry.stroke', [-1.0, 1.0], 'read-only'),
        ('limits.speed', 'much', 'expected')),
    'compensator': (
        ('horizon', 0.1, 'read-only'),
        ('correction.enabled', False, 'read-only'),
        ('reference.speed', [0.1, 0.1], 'speed has 2 elements, expected 3'),
        ('reference.jerk', [1.0, 1.0, -1.0], 'jerk = -1'),
        ('prediction.memory', 1.0, 'prediction.memory out of range'),
        ('correction.fade_time', 0.0, 'correction.fade_time')),
    'ik_service': tuple(('min_conditioning', value, 'min_conditioning')
                        for value in (-0.1, 1.1, 10.0)),
}


@pytest.mark.parametrize('name', WRONG_CHANGES)
def test_a_wrong_live_change_is_rejected_with_its_reason(ros, name):
    node = ros.add(NODES[name]())
    for change in WRONG_CHANGES[name]:
        require_rejection(node, *change)


def test_limits_beyond_those_of_the_drives_are_rejected_at_start(ros):
    with pytest.raises(ParameterError, match='limits.speed = 0.5 m/s is above q2.max_speed'):
        DriverNode(parameter_overrides=[Parameter('q2.max_speed', value=0.3)])


def test_the_drivers_limits_and_stream_may_be_changed_while_it_runs(ros):
    driver = ros.add(NODES['driver']())
    results = driver.set_parameters([
        Parameter('limits.speed', value=0.1), Parameter('stream.first_step', value=0.02)])
    assert all(result.successful for result in results)
    follower = driver._loop._process.loop.follower
    wait_until(lambda: (follower._limiter.limits.speed, follower.settings.first_step)
               == (0.1, 0.02), 'the changes in the loop')


def test_what_the_compensator_does_may_be_changed_while_it_runs(ros):
    node = ros.add(CompensatorNode())
    changes = {
        'prediction.memory': 30.0, 'correction.fade_time': 1.0, 'workspace_limit.margin': 0.01,
        'reference.speed': [0.1, 0.1, 0.2], 'impedance.stiffness': 20.0, 'speed': [0.3, 0.3, 1.0],
    }
    results = node.set_parameters(
        [Parameter(name, value=value) for name, value in changes.items()])
    assert [result.reason for result in results] == [''] * len(changes)
    compensator = node._compensator
    assert compensator.correction.predictor.settings.memory == 30.0
    assert compensator.correction.settings.fade_time == 1.0
    assert compensator._reference.settings.speed == (0.1, 0.1, 0.2)
    assert compensator.contact.pressing.press.stiffness == 20.0


def test_a_file_of_the_release_before_may_choose_its_prediction(ros):
    node = ros.add(CompensatorNode(
        parameter_overrides=[Parameter('prediction.model', value='oscillations')]))
    assert not node.has_parameter('prediction.model')


def test_a_workspace_limit_that_leaves_no_workspace_is_rejected(ros):
    node = ros.add(CompensatorNode(
        parameter_overrides=[Parameter('geometry.carriage_gap', value=0.27)]))
    result = node.set_parameters([Parameter('workspace_limit.margin', value=0.1)])[0]
    assert not result.successful and 'leaves no workspace in y' in result.reason


@pytest.mark.parametrize('content, message', [
    (None, 'nowhere.yaml'),
    ('/**: {ros__parameters: [1, 2', 'yaml'),
])
def test_a_parameter_file_that_cannot_be_read_is_one_sentence_and_no_traceback(
        ros_domain, handlers, tmp_path, capfd, content, message):
    file = tmp_path / 'nowhere.yaml'
    if content is not None:
        file.write_text(content)
    assert runtime.run(pytest.fail, ['--ros-args', '--params-file', str(file)]) == 2
    said = capfd.readouterr().err
    assert 'could not start' in said and message in said and 'Traceback' not in said


BOUNDS = st.one_of(st.none(), st.integers(-100, 100))


@given(BOUNDS, BOUNDS, st.one_of(st.integers(-200, 200), st.integers(-200, 200).map(float)),
       st.sampled_from(['', 'm']), st.booleans())
def test_a_descriptor_has_the_range_that_is_checked(minimum, maximum, value, unit, read_only):
    info = ParameterInfo('a length', unit, minimum, maximum)
    descriptor = parameters._descriptor(info, value, read_only)
    assert descriptor.description == ('a length [m]' if unit else 'a length')
    assert descriptor.read_only is read_only and not descriptor.additional_constraints
    assert len(descriptor.floating_point_range) == (
        (minimum, maximum) != (None, None) and isinstance(value, float))
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    assert bool(ranges) == ((minimum, maximum) != (None, None))
    try:
        check_value('length', value, info)
        accepted = True
    except ParameterError:
        accepted = False
    assert accepted == all(one.from_value <= value <= one.to_value for one in ranges)


@pytest.mark.parametrize('info, text', [
    (ParameterInfo('', minimum=0.5), 'at least 0.5'),
    (ParameterInfo('', 'm', maximum=2.0, elements=('x', 'y')), '2 elements, at most 2 m'),
    (ParameterInfo('', choices=('a', 'b')), 'one of a, b'), (ParameterInfo(''), '')])
def test_what_a_descriptor_has_no_field_for_it_says_in_words(info, text):
    descriptor = parameters._descriptor(info, (1.0, 1.0), False)
    assert descriptor.additional_constraints == text
    assert not descriptor.floating_point_range and not descriptor.integer_range
