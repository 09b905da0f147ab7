"""
Start one manipulator: driver, and compensator with ik_service in one process.

The driver is configured at once; powering the drives on stays an operator's request. With
`use_mock_hardware` the drives and the gondola are simulated.

If one node ends, however it ends, all are ended, and launch has exit status 1 unless that node's
was 0. Whatever order they end in, the driver goes its lifecycle backwards by itself: carriages to
rest, power off, bus closed.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.events import matches_action, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition

from facade_manipulator import config_path

PACKAGE = 'facade_manipulator'
BOOLEAN = ['true', 'false', 'True', 'False']
RESPAWN_DELAY = 2.0  # s
DRIVER_PATIENCE = '15.0'  # s: it ramps down, powers off and closes the bus before it ends


def _is_mock(context) -> bool:
    return IfCondition(LaunchConfiguration('use_mock_hardware')).evaluate(context)


def _parameters(context, executable: str) -> list:
    """Return the parameter files and, for the driver, the argument that stands above them."""
    config = LaunchConfiguration('config').perform(context)
    if not Path(config).is_file():  # launch itself would go on with the defaults
        raise RuntimeError(f'config: {config} is not a file')
    if _is_mock(context):
        return [config, str(config_path('simulation.yaml'))]
    channel = LaunchConfiguration('can_interface').perform(context)
    above = [{'bus.channel': channel}] if channel and executable == 'driver' else []
    return [config, *above]


def _nodes(context) -> list:
    driver = LifecycleNode(
        executable='driver', name='driver', sigterm_timeout=DRIVER_PATIENCE,
        **_common(context, 'driver'))
    nodes = [driver, Node(executable='manipulator', **_common(context, 'manipulator'))]
    if _is_mock(context):
        nodes.append(
            Node(executable='gondola_simulator', **_common(context, 'gondola_simulator')))
    recorder = Node(  # alone it does not end the others, and is started again
        executable='recorder', name='recorder', respawn=True, respawn_delay=RESPAWN_DELAY,
        condition=IfCondition(LaunchConfiguration('record')), **_common(context, 'recorder'))
    estimator = Node(  # likewise: without it the correction fades out
        executable='disturbance_estimator', name='disturbance_estimator', respawn=True,
        respawn_delay=RESPAWN_DELAY, condition=IfCondition(LaunchConfiguration('estimator')),
        **_common(context, 'disturbance_estimator'))
    configure = EmitEvent(event=ChangeState(
        lifecycle_node_matcher=matches_action(driver),
        transition_id=Transition.TRANSITION_CONFIGURE))
    return [*(_end_with(node) for node in nodes), *nodes, recorder, estimator, configure]


def _common(context, executable: str) -> dict:
    """Return what the nodes have in common; the enclave is that of config/sros2_policy.xml."""
    namespace = LaunchConfiguration('namespace').perform(context).strip('/')
    enclave = '/'.join(('', *filter(None, (namespace, executable))))
    level = LaunchConfiguration('log_level').perform(context)
    return {
        'package': PACKAGE,
        'namespace': namespace,
        'parameters': _parameters(context, executable),
        'ros_arguments': ['--log-level', level, '--enclave', enclave],
        'output': 'screen',
    }


def _end_with(node: Node) -> RegisterEventHandler:
    """End everything when this node ends: the driver then stops its drives."""
    def shut_down(event, context):
        if context.is_shutdown:
            return []
        reason = f'{event.process_name} ended with exit status {event.returncode}'
        if event.returncode != 0:
            raise RuntimeError(reason)  # ends everything too, and launch with exit status 1
        return [EmitEvent(event=Shutdown(reason=reason))]

    return RegisterEventHandler(OnProcessExit(target_action=node, on_exit=shut_down))


def generate_launch_description() -> LaunchDescription:
    """Describe the manipulator's nodes and arguments."""
    arguments = (
        ('use_mock_hardware', 'false', 'simulate the drives and the gondola', BOOLEAN),
        ('estimator', 'false', 'estimate the disturbance from raw sensors on the rail', BOOLEAN),
        ('record', 'true', 'keep a black box of the last minutes', BOOLEAN),
        ('namespace', '', 'namespace of the nodes, one per gondola', None),
        ('config', str(config_path('manipulator.yaml')), 'parameter file', None),
        ('can_interface', '', "CAN interface of the drives; empty takes the parameter file's",
         None),
        ('log_level', 'info', 'least severity that is logged', ['debug', 'info', 'warn', 'error']),
    )
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=value, description=text, choices=choices)
          for name, value, text, choices in arguments),
        OpaqueFunction(function=_nodes),
    ])
