"""
Start one manipulator: driver, and compensator with ik_service in one process.

The driver is configured at once; powering the drives on stays an operator's request. With
`use_mock_hardware` the drives and the gondola are simulated. If one node ends, everything is
shut down and the driver stops its drives.
"""

from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.events import matches_action, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition

from facade_manipulator import config_path
from launch import LaunchDescription

PACKAGE = 'facade_manipulator'


def _parameters(context) -> list:
    """Return the parameter files and the arguments that stand above them."""
    mock = IfCondition(LaunchConfiguration('use_mock_hardware')).evaluate(context)
    files = [LaunchConfiguration('config').perform(context)]
    if mock:
        return [*files, str(config_path('simulation.yaml'))]
    channel = LaunchConfiguration('can_interface').perform(context)
    return [*files, {'bus.channel': channel}] if channel else files


def _nodes(context) -> list:
    common = {
        'package': PACKAGE,
        'namespace': LaunchConfiguration('namespace').perform(context),
        'parameters': _parameters(context),
        'ros_arguments': ['--log-level', LaunchConfiguration('log_level').perform(context)],
        'output': 'screen',
    }
    driver = LifecycleNode(executable='driver', name='driver', **common)
    nodes = [driver, Node(executable='manipulator', **common)]
    if IfCondition(LaunchConfiguration('use_mock_hardware')).evaluate(context):
        nodes.append(Node(executable='gondola_simulator', **common))
    configure = EmitEvent(event=ChangeState(
        lifecycle_node_matcher=matches_action(driver),
        transition_id=Transition.TRANSITION_CONFIGURE))
    ends = [
        RegisterEventHandler(OnProcessExit(
            target_action=node, on_exit=[EmitEvent(event=Shutdown(reason='a node ended'))]))
        for node in nodes
    ]
    return [*ends, *nodes, configure]


def generate_launch_description() -> LaunchDescription:
    """Describe the manipulator's nodes and arguments."""
    arguments = (
        ('use_mock_hardware', 'false', 'simulate the drives and the gondola'),
        ('namespace', '', 'namespace of the nodes, one per gondola'),
        ('config', str(config_path('manipulator.yaml')), 'parameter file'),
        ('can_interface', '', 'CAN interface of the drives; empty takes the parameter file'),
        ('log_level', 'info', 'debug, info, warn or error'),
    )
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=value, description=text)
          for name, value, text in arguments),
        OpaqueFunction(function=lambda context: _nodes(context)),
    ])
