from dataclasses import dataclass, replace
import math

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from facade_manipulator.compensation.compensator import DEFAULTS
from facade_manipulator.compensation.following import ArrivalSettings
from facade_manipulator.errors import ParameterError
from facade_manipulator.motion.follower import StreamSettings
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import GoalSettings
from facade_manipulator.parameters import (
    check_parameters,
    METADATA_KEY,
    parameter,
    parameter_fields,
)
from facade_manipulator.ros.known_parameters import name_unknown_parameters
from facade_manipulator.ros.parameters import declare


@dataclass(frozen=True)
class Sample:
    """Settings as a core object has them."""

    low: float = parameter('Lower bound', default=0.1, unit='m', minimum=0.0, maximum=1.0)
    high: float = parameter('Upper bound', default=0.9, unit='m', minimum=0.0, maximum=1.0)
    count: int = parameter('How many', default=3, minimum=1, maximum=9)
    kind: str = parameter('Which', default='a', choices=('a', 'b'))
    span: tuple = parameter(
        'From and to', default=(0.0, 1.0), unit='m', read_only=True, elements=('from', 'to'))

    def __post_init__(self):
        check_parameters(self)
        if self.low >= self.high:
            raise ParameterError(f'low = {self.low:g} m is not below high = {self.high:g} m')


@pytest.mark.parametrize('values, message', [
    ({'low': -0.5}, 'low = -0.5 m is below its minimum 0 m'),
    ({'high': 1.5}, 'high = 1.5 m is above its maximum 1 m'),
    ({'low': math.nan}, 'low = nan is not a finite number'),
    ({'span': (0.0, math.inf)}, 'span = inf'),
    ({'span': (0.0, 1.0, 2.0)}, 'span has 3 elements, expected 2: from, to'),
    ({'kind': 'c'}, "kind = 'c' is not one of a, b"),
    ({'low': 0.95}, 'low = 0.95 m is not below high'),
])
def test_a_value_out_of_its_range_is_rejected_with_bound_and_unit(values, message):
    with pytest.raises(ParameterError, match=message):
        Sample(**values)


SETTINGS = (*DEFAULTS, ArrivalSettings(), GoalSettings(), MotionLimits(), StreamSettings())


@pytest.mark.parametrize(('made', 'name', 'info'), [
    pytest.param(made, name, item.metadata[METADATA_KEY], id=f'{type(made).__name__}.{name}')
    for made in SETTINGS for name, item in parameter_fields(type(made)).items()
    if not isinstance(getattr(made, name), bool)])
def test_no_settings_take_what_is_no_number_or_out_of_their_range(made, name, info):
    value = getattr(made, name)
    for bad in (math.nan, info.minimum - 1.0, info.maximum + 1.0):
        spoilt = (bad, *value[1:]) if isinstance(value, tuple) else bad
        with pytest.raises(ParameterError, match=name):
            replace(made, **{name: spoilt})


def test_without_a_listener_every_parameter_is_read_only(ros):
    node = ros.node('node')
    declare(node, Sample)
    assert not node.set_parameters([Parameter('low', value=0.2)])[0].successful


def test_a_live_change_reaches_the_listener_once_and_whole(ros):
    node, heard = ros.node('node'), []
    declare(node, Sample, '', heard.append)
    result = node.set_parameters_atomically(
        [Parameter('low', value=0.3), Parameter('high', value=0.4)])
    assert result.successful
    assert heard == [Sample(low=0.3, high=0.4)]


@pytest.mark.parametrize('name, value, message', [
    ('low', 0.95, 'low = 0.95 m is not below high = 0.9 m'),
    ('low', 2.0, ''),
    ('kind', 'z', 'is not one of a, b'),
    ('span', [0.0, 2.0], 'read-only'),
])
def test_an_invalid_live_change_is_rejected_with_the_reason_and_changes_nothing(
        ros, name, value, message):
    node, heard = ros.node('node'), []
    declare(node, Sample, '', heard.append)
    before = node.get_parameter(name).value
    result = node.set_parameters([Parameter(name, value=value)])[0]
    assert not result.successful
    assert message in result.reason
    assert node.get_parameter(name).value == before
    assert heard == []


@pytest.mark.parametrize('override', [
    Parameter('low', value='much'), Parameter('low', value=7.0), Parameter('high', value=0.05)])
def test_a_wrong_value_at_start_is_one_message(ros, override):
    node = ros.node('node', parameter_overrides=[override])
    with pytest.raises(ParameterError, match='low|high'):
        declare(node, Sample)


def test_the_default_of_one_node_may_differ_from_the_dataclass(ros):
    node = ros.node('node')
    assert declare(node, Sample, 'sample', low=0.5) == Sample(low=0.5)
    assert node.describe_parameter('sample.low').description == 'Lower bound [m]'


def test_who_sets_an_unknown_parameter_learns_the_nearest_known_one(ros):
    node = ros.node('node')
    name_unknown_parameters(node)
    declare(node, Sample, '', lambda _: None)
    request = SetParameters.Request(parameters=[
        Parameter(name, value=0.4).to_parameter_msg() for name in ('lo', 'low')])
    unknown, known = ros.call(
        ros.node('caller'), SetParameters, 'node/set_parameters', request).results
    assert not unknown.successful
    assert "parameter lo is not one of this node: did you mean 'low'?" in unknown.reason
    assert known.successful
