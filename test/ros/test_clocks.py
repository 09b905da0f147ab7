"""A system clock that is set, or time that is simulated, stops no supervision."""

from pathlib import Path

import pytest
from rcl_interfaces.msg import ParameterType
from rclpy.clock import ClockType
from rclpy.parameter import Parameter

from facade_manipulator import nodes
from facade_manipulator.errors import ParameterError
from facade_manipulator.ros.clocks import reject_simulated_time, steady_timer, steady_timers

pytestmark = pytest.mark.quick
SIMULATED = Parameter('use_sim_time', value=True)


def test_a_timer_runs_on_a_clock_that_nobody_sets(ros):
    timer = steady_timer(ros.node(), 0.01, lambda: None)
    assert timer.clock.clock_type is ClockType.STEADY_TIME


@pytest.mark.parametrize('longer, turns', [
    (0.0, 6 * ['often', 'seldom']), (1e3, ['often', 'seldom', *6 * ['often']])])
def test_one_timer_calls_a_second_function_after_the_first_once_in_its_longer_period(
        ros, longer, turns):
    calls = []
    steady_timers(ros.node(), 0.002, lambda: calls.append('often'),
                  longer, lambda: calls.append('seldom'))
    ros.until(lambda: len(calls) >= len(turns), 'the calls')
    assert calls[:len(turns)] == turns


def test_a_node_rejects_simulated_time_at_its_start_and_later(ros):
    with pytest.raises(ParameterError, match='use_sim_time = true is not possible'):
        reject_simulated_time(ros.node(parameter_overrides=[SIMULATED]))
    node = ros.node('another')
    reject_simulated_time(node)
    result, = node.set_parameters([SIMULATED])
    assert not result.successful
    assert 'start without it' in result.reason
    assert node.get_parameter('use_sim_time').value is False
    assert node.describe_parameter('use_sim_time').type == ParameterType.PARAMETER_BOOL


@pytest.mark.parametrize('path', sorted(Path(nodes.__file__).parent.glob('*.py')),
                         ids=lambda path: path.name)
def test_no_node_makes_a_timer_that_a_set_clock_stops(path):
    assert 'create_timer(' not in path.read_text().replace('steady_timer(', '')
